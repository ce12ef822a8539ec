"""The problem that grants as much of a document as it can: every limit may give, at a price.

The dynamics, where and when the flight begins, and the bounds of the times and of design parameters are kept
exactly. Every other bound, end and constraint gives by a slack s >= 0, which widens its interval on both
sides, over its whole length, and

    the sum of s / scale   over all of them

is minimised instead of the objective (an exact L1 penalty; Nocedal and Wright, Numerical Optimization, 2006,
section 17.2; the elastic mode of Gill, Murray and Saunders, SNOPT, 2005). An L1 norm leaves most slacks at
zero: what remains names the few limits that would have to give. Slacks are unknown design parameters of names
that no document can use, so that the elastic problem is one like any other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import combined, named, parse, product, total
from solvers.formulation.quantities import FREE, Constraint, DesignParameter, Total
from solvers.problem import OptimalControlProblem
from solvers.start.guess import Start
from solvers.start.scaling import Scaling, end_scales, magnitude

Vector = NDArray[np.float64]

_SLACK = "give@"
_SAMPLES = 129
# Twice this speed moves a rigid body as far by a miss of the velocity as by one of the position: a tie.
_SPEED = 1.0


@dataclass(frozen=True)
class Wish:
    """A limit of the document, and the name and scale of the slack by which it may give.

    ``along``: it holds along the trajectory, else at its end or for all of it.
    """

    limit: Constraint
    slack: str
    scale: float
    along: bool

    @property
    def sides(self) -> Iterator[Constraint]:
        """The finite sides of the limit, each wider by the slack."""
        lower, upper = self.limit.interval
        for mark, interval in (("+", (lower, np.inf)), ("-", (-np.inf, upper))):
            if np.isfinite(interval).any():
                widened = combined(mark, self.limit.expression, named(self.slack))
                yield replace(self.limit, expression=widened, interval=interval)

    def excess(self, problem: OptimalControlProblem, trajectory: Start, tau: Vector) -> Vector:
        """How far a trajectory is outside of a limit along it at K normalised times, 0 inside."""
        times = trajectory.t0 + (trajectory.tf - trajectory.t0) * tau
        states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
        scope = problem.scope(states, controls, times, {**problem.parameters, **trajectory.design}, NUMPY)
        with np.errstate(all="ignore"):
            values = np.broadcast_to(self.limit.expression.evaluate(scope, NUMPY.functions), tau.shape)
        outside = np.nan_to_num(self.limit.excess(values), posinf=0.0)
        return np.where(self.limit.holds_at(tau), outside, 0.0)


def wishes_of(problem: OptimalControlProblem, scaling: Scaling, phase: int = 0) -> list[Wish]:
    """Everything of a problem that may give; of that of the first of several phases, or of a later one.

    Pointers are those of :class:`OptimalControlProblem`, which names the states of scenarios by ``@``.
    """
    found = list[tuple[Constraint, float, bool]]()
    of_states, of_controls = end_scales(problem, scaling, _SPEED), scaling.controls
    for names, bounds, ends, key, scales in (
        (problem.states, problem.state_bounds, problem.final_state, "final_state", of_states),
        (problem.controls, problem.control_bounds, problem.final_control, "final_control", of_controls),
    ):
        for name, bound, end, scale in zip(names, bounds, ends, scales, strict=True):
            found.append((Constraint(name, problem.bound_pointer(name), named(name), bound), scale, True))
            own = "final_control" if name in problem.rated else key
            pointer = f"/problem/{own}/{name}"
            found.append((Constraint(name, pointer, named(f"{name}_f"), end), scale, False))
    for item, scale in zip(problem.integrals, scaling.integrals, strict=True):
        found.append((Constraint(item.name, item.pointer, named(item.name), item.interval), scale, False))
    found += [(item, magnitude(item.interval), True) for item in problem.path if _asked_for(item)]
    found += [(item, magnitude(item.interval), False) for item in problem.boundary if _asked_for(item)]
    if phase:
        found += _begins(problem, [*of_states], [*of_controls])
    return [
        Wish(limit, f"{_SLACK}{phase}.{number}", float(scale), along)
        for number, (limit, scale, along) in enumerate(found)
        if np.isfinite(limit.interval).any()
    ]


def _begins(
    problem: OptimalControlProblem, of_states: Sequence[float], of_controls: Sequence[float]
) -> Iterator[tuple[Constraint, float, bool]]:
    """Where a later phase is to begin, with the scales of states and controls."""
    for names, begins, key, scales in (
        (problem.states, problem.initial_state, "initial_state", of_states),
        (problem.controls, problem.initial_control, "initial_control", of_controls),
    ):
        for name, begin, scale in zip(names, begins, scales, strict=True):
            own = "initial_control" if name in problem.rated else key
            yield Constraint(name, f"/problem/{own}/{name}", named(f"{name}_0"), begin), scale, False


def wishes_over_all(totals: Sequence[Total], boundary: Sequence[Constraint]) -> list[Wish]:
    """What may give of what counts over all phases: integrals, and constraints on both ends of the flight."""
    limits = [Constraint(item.name, item.pointer, named(item.name), item.interval) for item in totals]
    return [
        Wish(limit, f"{_SLACK}all.{number}", magnitude(limit.interval), along=False)
        for number, limit in enumerate([*limits, *boundary])
        if np.isfinite(limit.interval).any()
    ]


def elastic_problem(
    problem: OptimalControlProblem,
    wishes: Sequence[Wish],
    start: Start,
    phase: int = 0,
    over_all: Sequence[Wish] = (),
) -> OptimalControlProblem:
    """The problem in which the wishes give; its slacks begin with what the start needs of them.

    Of a later ``phase`` also where it begins gives. ``over_all``: wishes of all phases whose slacks it has.
    """
    tau = np.linspace(0.0, 1.0, _SAMPLES)
    first = [float(wish.excess(problem, start, tau).max()) if wish.along else 0.0 for wish in wishes]
    slacks = [*zip(wishes, first, strict=True), *((wish, 0.0) for wish in over_all)]
    if phase:
        problem = replace(
            problem,
            initial_state=(FREE,) * len(problem.states),
            initial_control=(FREE,) * len(problem.controls),
        )
    return replace(
        problem,
        state_bounds=(FREE,) * len(problem.states),
        final_state=(FREE,) * len(problem.states),
        control_bounds=(FREE,) * len(problem.controls),
        final_control=(FREE,) * len(problem.controls),
        integrals=tuple(replace(item, interval=FREE) for item in problem.integrals),
        path=_softened(problem.path, [wish for wish in wishes if wish.along]),
        boundary=_softened(problem.boundary, [wish for wish in wishes if not wish.along]),
        running_cost=None,
        terminal_cost=total([product(parse(1.0 / wish.scale), named(wish.slack)) for wish, _ in slacks]),
        design=(
            *problem.design,
            *(DesignParameter(wish.slack, (0.0, np.inf), guess) for wish, guess in slacks),
        ),
    )


def _softened(items: Sequence[Constraint], wishes: Sequence[Wish]) -> tuple[Constraint, ...]:
    """What no document asks for (limits of slacks, say) as it was, then the widened sides of all wishes."""
    kept = [item for item in items if not _asked_for(item)]
    return (*kept, *(side for wish in wishes for side in wish.sides))


def _asked_for(item: Constraint) -> bool:
    return item.pointer.startswith(
        ("/problem/path_constraints/", "/problem/boundary_constraints/", "/problem/final_attitude")
    )
