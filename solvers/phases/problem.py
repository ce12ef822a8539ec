"""A problem of several phases: the problem of each, how they are linked, and what counts over all of them.

    min  sum_k J_k + phi(x_1(t0), x_K(tf), I, t0, tf),      t0_(k+1) = tf_k,
         x_(k+1)(t0_(k+1)) = x_k(tf_k),  or what a jump makes of the end of phase k

(Betts, Practical Methods for Optimal Control, SIAM 2010, 3.7). Each J_k with its constraints is an
:class:`~solvers.problem.OptimalControlProblem` like any other.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.attitude import guessed_attitude
from solvers.backends import NUMPY, Backend
from solvers.elastic import place_in_document
from solvers.errors import pointer
from solvers.expressions import Expression, named, parse, total
from solvers.lifting import FLIGHT_PEAK, corners, has_corners, lifted, nonsmooth, with_peak
from solvers.phases.guess import chained_guesses, histories, nodes_by_phase, phase_times
from solvers.plants import Plant
from solvers.problem import End, OptimalControlProblem, Parameters, Values, at_the_ends, names_of
from solvers.quantities import FREE, Constraint, Interval, Total
from solvers.reading import constraints, integrals
from solvers.scenarios import cases_of
from solvers.spec import (
    Guess,
    Objective,
    PhaseView,
    ProblemSpec,
    bound_interval,
    fields_of,
    phase_fields,
    phase_views,
    written_out,
)
from solvers.spec.pointers import parse_pointer
from solvers.time_knots import corner_warnings
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Phase:
    """A phase: the problem that is solved, the one that the document says, and where that stands.

    ``spec``: the document's problem of this phase alone.
    """

    view: PhaseView
    spec: ProblemSpec
    problem: OptimalControlProblem
    plant: Plant

    @property
    def name(self) -> str:
        """Its name."""
        return self.plant.name

    def place(self, alone: str) -> str:
        """See :meth:`located`; as submitted, where a pointer names a state of which ``*`` speaks."""
        return self.located(place_in_document(self.spec, alone))

    def located(self, alone: str) -> str:
        """The pointer into the document of what stands at a pointer into the problem of this phase alone."""
        path = [int(part) if part.isdigit() else part for part in parse_pointer(alone)]
        return pointer(self.view.located(tuple(path)))


@dataclass(frozen=True)
class Link:
    """How a phase begins: state -> expression in what is known at the end of the phase before."""

    starts: Mapping[str, Expression]


@dataclass(frozen=True)
class PhasedProblem:
    """Phases in their order, the links between them, and what the document says of the whole flight.

    ``parameters``: those of the common model; ``design``: names of design parameters that phases share;
    ``totals``: what adds up over the whole flight, as integrals do. The peak is that of phases of the common
    model.
    """

    phases: tuple[Phase, ...]
    links: tuple[Link, ...]
    parameters: Mapping[str, float]
    design: tuple[str, ...]
    totals: tuple[Total, ...]
    boundary: tuple[Constraint, ...]
    terminal_cost: Expression | None
    peak_cost: Expression | None = None

    @property
    def structure(self) -> Hashable:
        """Names and expressions: all that the joints of the program are made of but numbers."""
        return (
            tuple(tuple((name, item.text) for name, item in link.starts.items()) for link in self.links),
            tuple(self.parameters),
            self.design,
            tuple(item.name for item in self.totals),
            tuple(item.expression.text for item in self.boundary),
            self.terminal_cost and self.terminal_cost.text,
        )

    @property
    def states(self) -> list[str]:
        """The states of all phases, each once."""
        return list(dict.fromkeys(name for phase in self.phases for name in phase.plant.problem.states))

    @property
    def joints(self) -> int:
        """The number of equations by which phases begin where others end, and share design parameters."""
        problems = [phase.problem for phase in self.phases]
        times = sum(not meet_when_given(before, after) for before, after in pairwise(problems))
        owners = [sum(name == item.name for own in problems for item in own.design) for name in self.design]
        return (
            times + sum(len(link.starts) for link in self.links) + sum(max(count - 1, 0) for count in owners)
        )

    def place(self, index: int, alone: str) -> str:
        """See :meth:`Phase.place`."""
        return self.phases[index].place(alone)

    @property
    def warnings(self) -> list[dict[str, str]]:
        """Corners of the objective of a phase that no slack takes away, and of tables that no mesh meets."""
        kept = [
            (phase.located(pointer), text)
            for phase in self.phases
            for pointer, text in corners(phase.problem)
        ]
        kept += {
            ("/problem/objective/maximum", item.expression.text): None
            for phase in self.phases
            for item in phase.problem.path
            if item.name.startswith(FLIGHT_PEAK) and has_corners(item.expression)
        }
        found = [nonsmooth(*item) for item in kept]
        for item in [item for phase in self.phases for item in corner_warnings(phase.problem)]:
            found += [item] if item not in found else []
        return found

    @property
    def at_the_ends(self) -> list[Expression]:
        """What is evaluated at the ends of the whole flight."""
        return at_the_ends(self.boundary, self.terminal_cost)

    def ends_scope(
        self,
        initial: End,
        final: End,
        parameters: tuple[Parameters, Parameters],
        backend: Backend,
        totals: Values,
    ) -> dict[str, Any]:
        """Name what expressions over the whole flight know: begin of the first phase, end of the last one.

        ``parameters``: those of the flight, and those of its last phase.
        """
        first, last = self.phases[0].plant.problem, self.phases[-1].plant.problem
        return {
            **last.end_scope(_of(last, final), parameters[1], backend, names_of(self.at_the_ends)),
            **first.begin_scope(_of(first, initial)),
            **parameters[0],
            # What adds up over phases may be an unknown of each of them.
            **dict(zip((item.name for item in self.totals), totals, strict=True)),
        }


def _of(problem: OptimalControlProblem, end: End) -> End:
    """The controls of the document at an end; behind them may be what was added to solve it."""
    return end[0], end[1][: len(problem.controls)], end[2]


def meet_when_given(before: OptimalControlProblem, after: OptimalControlProblem) -> bool:
    """Whether the time at which one phase ends and the next one begins is a given number."""
    end, begin = before.final_time, after.initial_time
    return end == begin and end[0] == end[1]


def start_after(
    link: Link, before: OptimalControlProblem, end: End, parameters: Parameters, backend: Backend = NUMPY
) -> dict[str, Any]:
    """The values with which a phase begins after ``end`` of the problem before, by state."""
    wanted = names_of(link.starts.values())
    scope = before.end_scope(end, parameters, backend, wanted)
    return {name: item.evaluate(scope, backend.functions) for name, item in link.starts.items()}


def begin_after(
    link: Link,
    before: OptimalControlProblem,
    flown: Trajectory,
    end: Vector,
    after: OptimalControlProblem,
    promised: Vector,
) -> Vector:
    """The states (n,) of ``after`` with which a phase begins after ``end``, to which ``before`` was flown.

    ``flown`` has its controls; states that the link leaves free begin as ``promised``.
    """
    controls = flown.controls_at(np.ones(1))[:, 0]
    with np.errstate(all="ignore"):
        values = start_after(link, before, (end, controls, flown.tf), before.parameters_of(flown))
    return np.array(
        [values.get(name, value) for name, value in zip(after.states, promised, strict=True)], float
    )


def phased_problem(spec: ProblemSpec) -> PhasedProblem:
    """The flight of a checked document as that says it; under one command that of the leading plant."""
    return flight_of(spec if spec.scenarios is None else cases_of(spec)[0].spec)


def flight_of(spec: ProblemSpec) -> PhasedProblem:
    """The flight of a checked document without scenarios."""
    outer = fields_of(spec)
    views = phase_views(outer)
    fields = list(phase_fields(views, _interval))
    times = phase_times(spec, fields, _interval)
    common = histories(spec, (times[0][0], times[-1][1]), len(views))
    earlier = dict(enumerate(nodes_by_phase(spec, len(views))))
    phases = tuple(
        _phase(spec, view, {**item, "guess": _guess(view, common, earlier.get(view.index), pair)}, pair)
        for view, item, pair in zip(views, fields, times, strict=True)
    )
    jumps = {link.after: link.jump for link in spec.links}
    links = tuple(_link(before, after, jumps.get(after.name, {})) for before, after in pairwise(phases))
    found = PhasedProblem(
        phases,
        links,
        {
            name: value
            for name, value in spec.model.parameter_values().items()
            if name not in {*spec.design, *spec.model.depending_on(spec.design)}
        },
        tuple(spec.design),
        tuple(
            Total(item.name, item.pointer, item.interval)
            for item in integrals(spec, spec.model.parameter_values())
        ),
        constraints(spec, "boundary_constraints", spec.model.parameter_values()),
        None if spec.objective.terminal is None else parse(spec.objective.terminal),
        None if spec.objective.maximum is None else parse(spec.objective.maximum),
    )
    guesses = chained_guesses(
        list(_aimed(phases)),
        [_said(phase) for phase in phases],
        lambda index, end: _begin(found, index, end),
    )
    return replace(found, phases=tuple(map(_started, phases, guesses)))


def _aimed(phases: Sequence[Phase]) -> Iterator[OptimalControlProblem]:
    """The problems of the phases, each ending in the attitude that it is to have, near the one before."""
    near: dict[str, Interval] = {}
    for phase in phases:
        problem = phase.plant.problem
        known = dict(zip(problem.states, problem.initial_state, strict=True))
        begin = [near.get(name, own) if own == FREE else own for name, own in known.items()]
        end = guessed_attitude(phase.spec, problem.parameters, begin, problem.final_state)
        near = dict(zip(problem.states, begin if end == problem.final_state else end, strict=True))
        yield replace(problem, final_state=end)


def _phase(spec: ProblemSpec, view: PhaseView, fields: Mapping[str, Any], times: Interval) -> Phase:
    """The phase between these times of the guess."""
    objective = fields["objective"]
    if not isinstance(objective, Objective):
        objective = Objective.model_construct(**objective)
    own = {
        **{key: value for key, value in fields.items() if key != "model"},
        "submitted_model": view.model,
        "initial_time": times[0],
        "objective": objective,
        "phases": [],
        "links": [],
    }
    alone = spec.changed(**own)
    problem = OptimalControlProblem.from_spec(alone)
    common = None if view.has_own_model else spec.objective.running
    costs = [parse(cost) for cost in (common, objective.running) if cost is not None]
    own_start = view.index == 0 or view.phase.get("initial_time") is not None
    begin = bound_interval(fields["initial_time"], problem.parameters)
    problem = replace(
        problem,
        running_cost=total(costs) if costs else None,
        # A later phase begins when the one before ends, which the document may say.
        initial_time=begin if own_start or begin[0] == begin[1] else FREE,
    ).within_tables()
    return Phase(view, alone, problem, Plant(view.phase["name"], problem))


def _link(before: Phase, after: Phase, jump: Mapping[str, Any]) -> Link:
    """Every state of the same name goes on, unless the jump says otherwise."""
    starts = {}
    for name in after.plant.problem.states:
        if jump.get(name) is not None:
            starts[name] = parse(jump[name])
        elif name not in jump and name in before.plant.problem.states:
            starts[name] = named(f"{name}_f")
    return Link(starts)


def _started(phase: Phase, guess: Any) -> Phase:
    problem = replace(phase.plant.problem, guess=guess)
    return replace(phase, plant=replace(phase.plant, problem=problem), problem=lifted(with_peak(problem)))


def _begin(problem: PhasedProblem, index: int, end: End) -> Mapping[str, float]:
    """The finite ones of the states with which a phase begins after this end of the one before."""
    before = problem.phases[index - 1]
    parameters = {**before.problem.parameters, **before.problem.guess.design}
    with np.errstate(all="ignore"):
        values = start_after(problem.links[index - 1], before.problem, end, parameters)
    return {name: float(value) for name, value in values.items() if np.isfinite(value)}


def _guess(
    view: PhaseView,
    common: Mapping[str, Mapping[str, Any]],
    earlier: Mapping[str, Any] | None,
    times: Interval,
) -> Guess:
    """What a phase says of where it starts, and of its own names what is said of the whole flight.

    ``earlier``: the nodes of the phase in a result.
    """
    own: Guess = view.phase.get("guess") or Guess()
    if own.from_result is None:
        if not view.has_own_model:
            own = own.changed(
                states={**common["states"], **own.states}, controls={**common["controls"], **own.controls}
            )
        own = own.changed(from_result=earlier)
    return own.changed(final_time=times[1])


def _said(phase: Phase) -> frozenset[str]:
    """The states and controls of which the document says how they go in a phase."""
    guess = fields_of(phase.spec.guess)
    earlier = guess.get("from_result") or {}
    return frozenset().union(
        *(table.get(key) or {} for table in (guess, earlier) for key in ("states", "controls"))
    )


def _interval(bound: Any, model: Any) -> Interval:
    return bound_interval(bound, written_out(model).parameter_values())
