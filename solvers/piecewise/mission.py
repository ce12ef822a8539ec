"""The mission: one segment is tracked on the plant while the next one is predicted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solvers.piecewise.flow import RunawayError
from solvers.piecewise.messages import Follow
from solvers.piecewise.plant_flight import CompiledPlant, PlantFlight
from solvers.piecewise.reference import Reference
from solvers.piecewise.remote import Predictions
from solvers.piecewise.setup import Setup
from solvers.piecewise.stop import StopWatch
from solvers.piecewise.track import Track, UnseenError
from solvers.progress import Progress, ProgressReport
from solvers.status import SolveStatus

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Segment:
    """A segment as predicted and as tracked, and the seconds that both took.

    ``wait``: from the end of the tracking before it to the beginning of its own; ``hand_over``: what of it is
    not the longer prediction's, but asking, sending, waking and reading. ``held`` (N, .): what the plant held
    over each piece.
    """

    reference: Reference
    track: Track
    held: Vector
    tracking_seconds: float
    wait: float
    hand_over: float


@dataclass
class Mission:
    """What was flown, how it ended, and how long it took.

    ``stopped_at`` is when the document's ``stop`` was met; ``seconds`` the time from the first prediction's
    end to the last tracking's.
    """

    segments: list[Segment] = field(default_factory=list)
    status: SolveStatus = SolveStatus.CONVERGED
    note: str = ""
    stopped_at: float | None = None
    seconds: float = 0.0

    @property
    def sequential_seconds(self) -> float:
        """The time that predictions, but the first, and trackings take one after the other."""
        predictions = sum(segment.reference.seconds for segment in self.segments[1:])
        return predictions + sum(segment.tracking_seconds for segment in self.segments)


class _Stopped(Exception):
    """Somebody or the clock asked to stop."""


def fly_mission(
    setup: Setup, predictions: Predictions, plant: CompiledPlant, progress: Progress, deadline: float
) -> Mission:
    """Predict and track until the end, the stop, or until nobody waits or the time is over.

    The first prediction has been asked for. ``deadline`` is of ``time.monotonic()``. Raises CompanionError.
    """
    mission = Mission()

    def watch() -> None:
        if progress.cancelled():
            mission.status = SolveStatus.CANCELLED
        elif time.monotonic() >= deadline:
            mission.status = SolveStatus.TIME_LIMIT
        else:
            return
        raise _Stopped

    try:
        _fly(mission, setup, predictions, plant, progress, watch, deadline)
    except _Stopped:
        pass
    except RunawayError as error:
        mission.status, mission.note = SolveStatus.DIVERGED, f"On the plant {error}."
    except UnseenError as error:
        mission.status, mission.note = SolveStatus.EVALUATION_ERROR, f"/method/plant/observe: {error}."
    if not mission.segments:
        mission.segments.append(_standing(setup, plant, mission.status))
    return mission


def _standing(setup: Setup, plant: CompiledPlant, status: SolveStatus) -> Segment:
    """What there is before anything was flown: the start, and the controls of the guess."""
    problem, plan = setup.problem, setup.plan
    guess = problem.guess
    length = plan.edges[1] - plan.edges[0] if plan.state is None else (guess.tf - guess.t0) / plan.count
    times = problem.initial_time[0] + length * np.linspace(0.0, 1.0, 2 * plan.nodes + 1)
    controls = guess.controls_at(np.clip((times - guess.t0) / (guess.tf - guess.t0), 0.0, 1.0))
    start = np.array([interval[0] for interval in problem.initial_state])
    seen = np.repeat(start[:, None], times.size, axis=1)
    begun = np.nan_to_num(plant.plant.begin(start, problem.initial_time[0]), posinf=0.0, neginf=0.0)
    states = np.repeat([np.append(begun, 0.0)], times.size, axis=0)
    nothing = np.zeros((0, times.size))
    reference = Reference(0, times, seen, controls, nothing, np.nan, status, "Not_Begun", 0, 0, 0)
    track = Track(times, states, seen, controls[:, :-1].T, controls[:, 1:].T)
    held = np.zeros((times.size - 1, len(plant.plant.equations.held_names)))
    return Segment(reference, track, held, 0.0, 0.0, 0.0)


def _fly(
    mission: Mission,
    setup: Setup,
    predictions: Predictions,
    plant: CompiledPlant,
    progress: Progress,
    watch: Callable[[], None],
    deadline: float,
) -> None:
    count = setup.plan.count
    progress.report(ProgressReport("predict", 0, fraction=0.0))
    flight = PlantFlight(plant)
    stop = StopWatch.of(setup.problem, setup.method)
    start = np.array([interval[0] for interval in setup.problem.initial_state])
    state = np.append(
        plant.plant.begin(start, setup.problem.initial_time[0]), 0.0
    )  # and the running cost so far
    _hold_finite(mission, state, "start")
    _hold_finite(mission, flight.see(state, setup.problem.initial_time[0]), "observe")
    reference = predictions.take(watch)
    begun = time.perf_counter()
    tracked, tracking = begun, 0.0
    for index in range(count):
        _judge(mission, reference)
        started = time.perf_counter()
        wait = started - tracked
        # A prediction that takes longer than the tracking beside it is waited for by the difference.
        hand_over = wait - max(0.0, reference.seconds - tracking) if index else 0.0
        if index + 1 < count:
            predictions.ask(Follow(deadline - time.monotonic(), flight.see(state, float(reference.times[0]))))
        flight.held.clear()
        track = setup.tracker.follow(reference, setup.tracker.gains(reference), flight, state, watch)
        tracked = time.perf_counter()
        tracking = tracked - started
        _hold_finite(mission, track.seen, "observe")
        mission.segments.append(Segment(reference, track, np.array(flight.held), tracking, wait, hand_over))
        mission.seconds = tracked - begun
        state = track.states[-1]
        mission.stopped_at = stop.met(track.times, track.seen, track.controls)
        over = mission.stopped_at is not None or index + 1 == count
        progress.report(_report(mission, setup, index, 1.0 if over else (index + 1) / count))
        if over:
            return
        reference = predictions.take(watch)


def _hold_finite(mission: Mission, values: Vector, key: str) -> None:
    """End a mission whose plant is not to be seen, or not to be started."""
    if not np.isfinite(values).all():
        mission.status = SolveStatus.EVALUATION_ERROR
        mission.note = f"/method/plant/{key}: an expression has no finite value."
        raise _Stopped


def _judge(mission: Mission, reference: Reference) -> None:
    """Remember the first prediction that did not converge; the mission goes on with what it gave."""
    if reference.status is not SolveStatus.CONVERGED and mission.status is SolveStatus.CONVERGED:
        mission.status = reference.status
        mission.note = f"The prediction of segment {reference.index} ended with {reference.solver_status}."
    if not np.isfinite(reference.states).all() or not np.isfinite(reference.controls).all():
        mission.status = SolveStatus.DIVERGED
        raise _Stopped


def _report(mission: Mission, setup: Setup, index: int, fraction: float) -> ProgressReport:
    last = mission.segments[-1]
    return ProgressReport(
        f"segment {index + 1} of {setup.plan.count}",
        sum(segment.reference.iterations for segment in mission.segments),
        float(last.track.states[-1, -1]),
        fraction=fraction,
    )
