"""From a mission to the answer of the document: one trajectory, its proof, and the segments."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.bases.hermite import cubic_pieces
from solvers.coefficients import flight
from solvers.curves import HermiteCurve
from solvers.output.report import constraint_margins
from solvers.piecewise.mission import Mission, Segment
from solvers.piecewise.pieces import Pieces
from solvers.piecewise.plant_flight import CompiledPlant
from solvers.piecewise.setup import Setup
from solvers.piecewise.verify import terminal_cost, verify_mission
from solvers.problem import OptimalControlProblem
from solvers.solution import Solution, Statistics
from solvers.spec.places import place_in_document
from solvers.status import SolveStatus
from solvers.switching import find_switching
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Tolerances, Verification

Vector = NDArray[np.float64]

_VERIFY_SECONDS, _VERIFY_SECONDS_STOPPED = 60.0, 1.0


def answer(setup: Setup, compiled: CompiledPlant, mission: Mission, seconds: dict[str, float]) -> Solution:
    """The answer that a mission with at least one segment gives; its proof counts to ``seconds``."""
    started = time.perf_counter()
    problem, plant = setup.problem, compiled.plant
    pieces = _joined(mission.segments)
    end = float(pieces.times[-1]) if mission.stopped_at is None else mission.stopped_at
    trajectory = _trajectory(compiled, pieces, end)
    objective = float(np.interp(end, pieces.times, pieces.costs)) + terminal_cost(problem, trajectory)
    flown = pieces.until(end)
    patience = _VERIFY_SECONDS if mission.status is SolveStatus.CONVERGED else _VERIFY_SECONDS_STOPPED
    verification = verify_mission(
        plant,
        setup.method,
        flown,
        trajectory,
        Tolerances(**setup.spec.verification_tolerances()),
        stop=None if setup.method.stop is None else mission.stopped_at is not None,
        deadline=time.monotonic() + patience,
    )
    status, message = _verdict(mission, verification)
    seconds["verify"] = time.perf_counter() - started
    references = [segment.reference for segment in mission.segments]
    return Solution(
        spec=setup.spec,
        problem=setup.problem,
        trajectory=trajectory,
        costates=np.full((len(setup.problem.states), trajectory.nodes.size), np.nan),
        objective=objective,
        status=status,
        message=message,
        method=setup.spec.resolved().document["method"],
        verification=verification,
        integrals={},
        model_report=None,
        switching=find_switching(problem, trajectory),
        constraints=constraint_margins(
            setup.problem, trajectory, {}, partial(place_in_document, setup.spec.problem)
        ),
        convergence=[],
        starts=[],
        warnings=[],
        statistics=Statistics(
            max(reference.variables for reference in references),
            max(reference.constraints for reference in references),
            sum(reference.iterations for reference in references),
            references[-1].solver_status,
            seconds,
        ),
        extras={
            "segments": [_report(setup.problem, segment) for segment in mission.segments],
            "schedules": _schedules(mission),
            "plant": {
                "states": _named(plant.equations.states, flown.states.T),
                "held": _named(plant.equations.held_names, flown.held.T),
            },
        },
    )


def _schedules(mission: Mission) -> dict[str, float | None]:
    """Seconds of the mission as it went, and of its parts one after the other."""
    sequential, later = mission.sequential_seconds, mission.segments[1:]
    return {
        "parallel": mission.seconds,
        "sequential": sequential,
        "speedup": sequential / mission.seconds if mission.seconds else None,
        "median_wait": float(np.median([segment.wait for segment in later])) if later else None,
        "median_hand_over": float(np.median([segment.hand_over for segment in later])) if later else None,
    }


def _verdict(mission: Mission, verification: Verification) -> tuple[SolveStatus, str]:
    status = mission.status
    if status is SolveStatus.CONVERGED and not verification.passed:
        status = SolveStatus.UNVERIFIED
    details = [_TRACKED if status is SolveStatus.CONVERGED else status.sentence]
    if status is SolveStatus.UNVERIFIED:
        details = [_OUTSIDE]
        failed = [check for check in verification.checks if not check.passed]
        details += [check.sentence for check in failed]
    details += [text for text in (mission.note, verification.note) if text]
    return status, " ".join(details)


_TRACKED = "Every prediction converged and the plant stayed within its bounds."
_OUTSIDE = (
    "Every prediction converged, but the plant is outside the verification tolerance. Look further ahead "
    "(method.lookahead), keep predictions inside the bounds (method.margins), or take more nodes."
)


def _joined(segments: Sequence[Segment]) -> Pieces:
    """All segments as one flight; where one ends the next begins."""
    tracks = [segment.track for segment in segments]
    first = tracks[0]
    states = np.vstack([first.states[:1], *[track.states[1:] for track in tracks]])
    return Pieces(
        np.concatenate([first.times[:1], *[track.times[1:] for track in tracks]]),
        states[:, :-1],
        np.hstack([first.seen[:, :1], *[track.seen[:, 1:] for track in tracks]]),
        states[:, -1],
        np.vstack([track.before for track in tracks]),
        np.vstack([track.after for track in tracks]),
        np.vstack([segment.held for segment in segments]),
    )


def _trajectory(compiled: CompiledPlant, pieces: Pieces, end: float) -> Trajectory:
    """The flight until ``end``, as curves."""
    times, seen, slopes, before, after = _cut(
        pieces, np.nan_to_num(compiled.seen_rates(pieces), posinf=0.0, neginf=0.0), end
    )
    problem = compiled.plant.problem
    duration = float(times[-1] - times[0])
    knots = (times - times[0]) / duration
    knots[-1] = 1.0
    return Trajectory(
        t0=float(times[0]),
        tf=float(times[-1]),
        states={
            name: HermiteCurve(knots, row, duration * slope)
            for name, row, slope in zip(problem.states, seen, slopes, strict=True)
        },
        controls={
            name: flight.linear_pieces(knots, np.column_stack([before[:, index], after[:, index]]))
            for index, name in enumerate(problem.controls)
        },
        interpolation="linear",
        basis={"name": flight.NAME, "knots": knots.tolist()},
        breakpoints=knots,
        nodes=knots,
    )


def _cut(pieces: Pieces, slopes: Vector, end: float) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """Times, states, slopes and both ends of the control, the last piece cut at ``end``."""
    times, seen = pieces.times, pieces.seen
    last = int(np.clip(np.searchsorted(times, end), 1, times.size - 1))
    edge = slice(last - 1, last + 1)
    cubic = cubic_pieces(times[edge], seen[:, edge].T, slopes[:, edge].T)
    part = (end - times[last - 1]) / (times[last] - times[last - 1])
    control = pieces.before[last - 1] + part * (pieces.after[last - 1] - pieces.before[last - 1])
    return (
        np.append(times[:last], end),
        np.column_stack([seen[:, :last], cubic(end)]),
        np.column_stack([slopes[:, :last], cubic(end, 1)]),
        pieces.before[:last],
        np.vstack([pieces.after[: last - 1], control]),
    )


def _report(problem: OptimalControlProblem, segment: Segment) -> dict[str, Any]:
    reference, track = segment.reference, segment.track
    off = track.seen - reference.states
    return {
        "index": reference.index,
        "t0": float(track.times[0]),
        "tf": float(track.times[-1]),
        "predicted": {
            "t": reference.times.tolist(),
            "states": _named(problem.states, reference.states),
            "controls": _named(problem.controls, reference.controls),
        },
        "tracked": {
            "t": track.times.tolist(),
            "states": _named(problem.states, track.seen),
            "controls": _named(problem.controls, track.controls),
        },
        "gap": _named(problem.states, off[:, 0]),
        "error_rms": _named(problem.states, np.sqrt(np.mean(off**2, axis=1))),
        "prediction": {
            "status": reference.status.value,
            "objective": reference.objective,
            "iterations": reference.iterations,
            "seconds": reference.seconds,
        },
        "tracking_seconds": segment.tracking_seconds,
        "wait_seconds": segment.wait,
        "hand_over_seconds": segment.hand_over,
    }


def _named(names: Sequence[str], rows: Vector) -> dict[str, Any]:
    return dict(zip(names, rows.tolist(), strict=True))
