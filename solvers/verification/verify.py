"""Independent verification: fly the returned control on the original model, compare with what was promised.

Knows nothing of the method that it checks. Errors are relative to each quantity's scale, the largest
magnitude on the trajectory (at least 1e-6).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verification.boundary import End, boundary_violation
from solvers.verification.flight import INSIDE, ControlledModel, FlightError
from solvers.verification.verdict import Check, StateReport, Tolerances, Verification
from solvers.verification.violations import dense, largest_violation, outside, scale_of, scaled_violation

Vector = NDArray[np.float64]

# Beyond this growth, rounding alone would move the end by more than a millionth of its scale.
MEANINGFUL_GROWTH = 1e8

IMPLIED_ENDS = "implied_ends"
"""The check of end conditions that are held less tightly than others."""


@dataclass(frozen=True)
class _Evidence:
    """What flying showed; None where it was not computed.

    ``ends``: the final state as flown, or as promised where the flight says nothing; ``off_promise`` and
    ``off_target``: how far the flown end is from the promised one and from the end conditions; ``integrals``:
    that of the running cost, then those of the document.
    """

    arc_errors: Vector | None = None
    ends: Vector | None = None
    off_promise: Vector | None = None
    off_target: Vector | None = None
    integrals: Vector | None = None
    growth: float | None = None
    note: str = ""

    @property
    def misses(self) -> Vector | None:
        """How far the flown end is from where it should be, (n,)."""
        if self.off_promise is None or self.off_target is None:
            return None
        return np.maximum(self.off_promise, self.off_target)

    @property
    def flight_counts(self) -> bool:
        """Whether the end of the whole flight is to be judged, be it computed or not."""
        return self.growth is None or self.growth <= MEANINGFUL_GROWTH


def verify(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    tolerances: Tolerances,
    deadline: float,
    begin: Vector | None = None,
    implied: Mapping[str, float] | None = None,
) -> Verification:
    """Integrate the returned control, clipped to its bounds, and compare.

    ``deadline`` (of ``time.monotonic()``) bounds the effort: what is not computed by then is None, and fails.
    ``begin`` (n,): the state from which the whole flight begins, by default the promised one; ``implied``:
    final states that are held less tightly than others, and how far from their ends they may be, relative to
    scales. They must come as close as others to where they were promised to be.
    """
    tau = dense(trajectory.breakpoints)
    states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
    scale = scale_of(states)
    sizes = scale, scale_of(controls)
    model = ControlledModel(problem, trajectory, scale, deadline)
    evidence = _fly(problem, trajectory, model, begin)
    terminal_error, state_error = (
        _scaled_maximum(errors, scale) for errors in (evidence.misses, evidence.arc_errors)
    )
    bounds = max(
        scaled_violation(states, np.array(problem.state_bounds), scale),
        scaled_violation(controls, model.bounds, sizes[1]),
    )
    scope = problem.scope(
        states, model.clipped(tau), trajectory.time(tau), problem.parameters_of(trajectory), NUMPY
    )
    path = largest_violation(problem.path, scope, tau)
    start = trajectory.states_at(np.zeros(1))
    both = _ends(trajectory, model, evidence)
    integrals = np.zeros(len(problem.integrals)) if evidence.integrals is None else evidence.integrals[1:]

    def ends_scope(initial: Any, final: Any, integrals: Any) -> dict[str, Any]:
        return problem.ends_scope(initial, final, problem.parameters_of(trajectory), NUMPY, integrals)

    ends = max(
        scaled_violation(start, np.array(problem.initial_state), scale),
        scaled_violation(controls[:, [0]], np.array(problem.initial_control), sizes[1]),
        scaled_violation(controls[:, [-1]], np.array(problem.final_control), sizes[1]),
        boundary_violation(problem.boundary, both, (sizes, sizes), integrals, ends_scope),
        _integral_violation(problem, evidence),
    )
    checks = [
        Check("state_error", state_error, tolerances.state_error),
        Check("bound", bounds, tolerances.bound),
        Check("path", path, tolerances.path),
        Check("ends", ends, tolerances.terminal_error),
    ]
    if evidence.flight_counts:
        checks[:0] = _end_checks(problem, evidence, scale, tolerances.terminal_error, implied or {})
    return Verification(
        terminal_error=terminal_error,
        max_state_error=state_error,
        max_bound_violation=bounds,
        max_path_violation=path,
        objective=_objective(problem, evidence, ends_scope(*both, integrals), scope),
        integrals={}
        if evidence.integrals is None
        else {
            item.name: float(value)
            for item, value in zip(problem.integrals, evidence.integrals[1:], strict=True)
        },
        growth=evidence.growth,
        states={
            name: _state_report(
                index, evidence, trajectory, model.breakpoints, tolerances.state_error * scale[index]
            )
            for index, name in enumerate(problem.states)
        },
        tolerances=tolerances,
        checks=tuple(checks),
        note=evidence.note,
        end=evidence.ends,
    )


def _fly(
    problem: OptimalControlProblem, trajectory: Trajectory, model: ControlledModel, begin: Vector | None
) -> _Evidence:
    """Fly every arc from its promised start, then, where that says something, the whole way."""
    evidence = _Evidence()
    promised = trajectory.states_at(model.breakpoints)
    try:
        slopes, arcs = model.linearised(promised[:, :-1])
        evidence = replace(
            evidence,
            arc_errors=np.abs(arcs.inside - _inside(trajectory, model.breakpoints)),
            ends=promised[:, -1],
            integrals=arcs.integrals.sum(axis=1),
            growth=model.growth(slopes),
        )
        if not evidence.flight_counts:
            note = (
                f"Small errors grow {evidence.growth:.1e} times over the whole flight, so that its end says "
                "nothing; success rests on the error from breakpoint to breakpoint."
            )
            return replace(evidence, note=note)
        if begin is not None:
            # To first order the other begin moves the end of the first arc so.
            ends = arcs.ends.copy()
            ends[:, 0] += slopes[0, : len(begin)] @ (begin - promised[:, 0])
            promised, arcs = np.column_stack([begin, promised[:, 1:]]), replace(arcs, ends=ends)
        flight = model.fly(promised, slopes, arcs, evidence.growth if begin is None else None)
    except FlightError as error:
        return replace(evidence, note=f"The whole flight was not computed: {error}.")
    flown = flight.states[:, -1]
    return replace(
        evidence,
        ends=flown,
        off_promise=np.abs(flown - promised[:, -1]),
        off_target=outside(flown[:, None], np.array(problem.final_state)).max(axis=1),
        integrals=flight.integrals,
    )


def _end_checks(
    problem: OptimalControlProblem,
    evidence: _Evidence,
    scale: Vector,
    limit: float,
    implied: Mapping[str, float],
) -> list[Check]:
    """What is asked of the end of the whole flight; of end conditions that are ``implied`` by themselves."""
    if not implied:
        return [Check("terminal_error", _scaled_maximum(evidence.misses, scale), limit)]
    loose = np.array([name in implied for name in problem.states])
    exact = far = None
    if evidence.off_promise is not None and evidence.off_target is not None:
        exact = np.maximum(evidence.off_promise, np.where(loose, 0.0, evidence.off_target))
        far = np.where(loose, evidence.off_target, 0.0)
    return [
        Check("terminal_error", _scaled_maximum(exact, scale), limit),
        Check(IMPLIED_ENDS, _scaled_maximum(far, scale), min(implied.values())),
    ]


def _integral_violation(problem: OptimalControlProblem, evidence: _Evidence) -> float:
    """The largest violation of the bounds of integrals by what was flown, each relative to itself."""
    if evidence.integrals is None or not problem.integrals:
        return 0.0
    values = evidence.integrals[1:, None]
    return scaled_violation(values, np.array([item.interval for item in problem.integrals]), scale_of(values))


def _ends(trajectory: Trajectory, model: ControlledModel, evidence: _Evidence) -> tuple[End, End]:
    """States, controls and time at both ends, as flown."""
    edges = np.array([0.0, 1.0])
    controls, states = model.clipped(edges), trajectory.states_at(edges)
    final = states[:, 1] if evidence.ends is None else evidence.ends
    return (states[:, 0], controls[:, 0], trajectory.t0), (final, controls[:, 1], trajectory.tf)


def _objective(
    problem: OptimalControlProblem,
    evidence: _Evidence,
    ends_scope: Mapping[str, Any],
    scope: Mapping[str, Any],
) -> float | None:
    """The objective of what was flown; a peak is that between the breakpoints of the promised states."""
    if evidence.integrals is None:
        return None
    objective = float(evidence.integrals[0])
    with np.errstate(all="ignore"):
        if problem.terminal_cost is not None:
            objective += float(problem.terminal_cost.evaluate(ends_scope, NUMPY.functions))
        if problem.peak_cost is not None:
            objective += float(np.max(problem.peak_cost.evaluate(scope, NUMPY.functions)))
    return objective


def _inside(trajectory: Trajectory, breakpoints: Vector) -> Vector:
    """The returned states where :class:`Arcs` has its inner points, (n, K, 4)."""
    tau = breakpoints[:-1, None] + np.diff(breakpoints)[:, None] * INSIDE
    return trajectory.states_at(tau.ravel()).reshape(-1, *tau.shape)


def _scaled_maximum(errors: Vector | None, scale: Vector) -> float | None:
    if errors is None:
        return None
    return float(np.max(errors.reshape(scale.size, -1) / scale[:, None]))


def _state_report(
    index: int, evidence: _Evidence, trajectory: Trajectory, breakpoints: Vector, tolerance: float
) -> StateReport:
    largest = at = None
    if evidence.arc_errors is not None:
        errors = evidence.arc_errors[index]
        arc, point = np.unravel_index(int(np.argmax(errors)), errors.shape)
        largest = float(errors[arc, point])
        tau = breakpoints[arc] + INSIDE[point] * (breakpoints[arc + 1] - breakpoints[arc])
        at = trajectory.t0 + trajectory.duration * float(tau)
    terminal = None if evidence.misses is None else float(evidence.misses[index])
    return StateReport(terminal, largest, at, float(tolerance))
