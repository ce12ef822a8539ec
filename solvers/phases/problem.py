"""A problem of several phases: the problem of each, how they are linked, and what counts over all of them.

    min  sum_k J_k + phi(x_1(t0), x_K(tf), I, t0, tf),      t0_(k+1) = tf_k,
         x_(k+1)(t0_(k+1)) = x_k(tf_k),  or what a jump makes of the end of phase k

(Betts, Practical Methods for Optimal Control, SIAM 2010, 3.7). Each J_k with its constraints is an
:class:`~solvers.problem.OptimalControlProblem` like any other.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY, Backend
from solvers.errors import pointer
from solvers.expressions import Expression
from solvers.formulation.integral_costs import exact_integrals, held_integral, said_at_the_ends
from solvers.formulation.lifting import (
    FLIGHT_PEAK,
    corners,
    has_corners,
    nonsmooth,
)
from solvers.formulation.plants import Plant
from solvers.formulation.quantities import Constraint, Total
from solvers.formulation.time_knots import corner_warnings
from solvers.problem import End, OptimalControlProblem, Parameters, Values, at_the_ends, names_of
from solvers.spec import (
    PhaseView,
    ProblemSpec,
)
from solvers.spec.places import place_in_document
from solvers.spec.pointers import parse_pointer
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

    def says(self, alone: str) -> bool:
        """Whether what stands at a pointer of the problem of this phase alone is said of it, not of others.

        Times are where neighbours meet unless it says them; design parameters are common to all phases.
        """
        _, key, *_ = parse_pointer(alone)
        if key == "design":
            return self.view.index == 0
        at_the_edge = {"initial_time": 0, "final_time": self.view.count - 1}
        return self.view.index == at_the_edge.get(key, self.view.index) or key in self.view.said

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
    def exact_integrals(self) -> frozenset[str]:
        """The integrals that may not be more than they are; see :mod:`solvers.formulation.integral_costs`."""
        held = [*said_at_the_ends(self.boundary, self.terminal_cost), *map(held_integral, self.totals)]
        return exact_integrals(self.totals, held, self.parameters)

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
        found = [nonsmooth(*item) for item in dict.fromkeys(kept)]
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
