"""From a checked document to its flight of phases: the problem of each, where it starts, and the links."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from solvers.expressions import named, parse, total
from solvers.formulation.attitude import guessed_attitude
from solvers.formulation.lifting import lifted, with_peak
from solvers.formulation.plants import Plant
from solvers.formulation.quantities import FREE, Interval, Total
from solvers.formulation.reading import constraints, integrals
from solvers.formulation.scenarios import cases_of
from solvers.formulation.stated import stated_problem, within_tables
from solvers.phases.guess import chained_guesses, histories, nodes_by_phase, phase_times
from solvers.phases.problem import Link, Phase, PhasedProblem, start_after
from solvers.problem import End, OptimalControlProblem
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
    exact = found.exact_integrals
    started = (_started(*pair, exact) for pair in zip(phases, guesses, strict=True))
    return replace(found, phases=tuple(started))


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
    problem = stated_problem(alone)
    common = None if view.has_own_model else spec.objective.running
    costs = [parse(cost) for cost in (common, objective.running) if cost is not None]
    own_start = view.index == 0 or view.phase.get("initial_time") is not None
    begin = bound_interval(fields["initial_time"], problem.parameters)
    problem = replace(
        problem,
        running_cost=total(costs) if costs else None,
        # A later phase begins when the one before ends, which the document may say.
        initial_time=begin if own_start or begin[0] == begin[1] else FREE,
    )
    problem = within_tables(problem)
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


def _started(phase: Phase, guess: Any, exact: Collection[str]) -> Phase:
    problem = replace(phase.plant.problem, guess=guess)
    solved = lifted(with_peak(problem), exact=exact)
    return replace(phase, plant=replace(phase.plant, problem=problem), problem=solved)


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
