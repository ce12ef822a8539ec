"""The piecewise cases: final times and bounds beside baselines, and two processes against one.

.venv/bin/python benchmarks/piecewise.py [missions] [gains] [yardstick] [baseline] [starts] [schedules]

``parallel`` and ``sequential`` are whole missions, flown with the predictor in a process of its own and in
this one; ``wait`` is the median time between the end of a tracking and the beginning of the next, and
``hand-over`` the part of it in which nobody computes: asking, sending, waking, reading.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import copy
import math
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from solvers.catalogue import load_case
from solvers.optimizers.outcome import Limits
from solvers.piecewise.messages import First
from solvers.piecewise.mission import Mission, fly_mission
from solvers.piecewise.plant import Plant
from solvers.piecewise.plant_flight import CompiledPlant, PlantFlight
from solvers.piecewise.predict import CHAPTER_SHARE, Predictor
from solvers.piecewise.remote import LocalPredictor, RemotePredictor
from solvers.piecewise.setup import Setup
from solvers.piecewise.stop import StopWatch
from solvers.progress import SilentProgress
from solvers.solve import solve
from solvers.spec import check_document

Document = dict[str, Any]

# The rule of the switch: where the pitch is larger and rises the current is off for so long.
ON_OFF_CURRENT, ON_OFF_PITCH, ON_OFF_SECONDS = 0.4, math.radians(20.0), 600.0

SIDES = 8


def variant(name: str, change: Callable[[Document], object]) -> Document:
    """A case with a change."""
    document = copy.deepcopy(load_case(name))
    change(document)
    return document


def chapter(document: Document) -> None:
    """The published scheme: a segment at a time, half of the last error, no margins."""
    document["method"] |= {"scheme": "chapter", "margins": {}}


def small_angles(document: Document) -> None:
    """The published scheme on the published simple model."""
    chapter(document)
    document["problem"]["model"]["name"] = "pse_small_angle"


def dipole_predictions(document: Document) -> None:
    """The published scheme on a dipole, flown in the real field."""
    chapter(document)
    document["problem"]["model"]["parameters"] = {"igrf": 0}


def extremes(result: Document) -> dict[str, float]:
    """The largest magnitude of each bounded quantity."""
    return {
        item["pointer"].rpartition("/")[2]: max(abs(item["min"]), abs(item["max"]))
        for item in result["constraints"]
    }


def row(label: str, document: Document) -> str:
    """One line of the table of missions."""
    started = time.perf_counter()
    result = solve(check_document(document)).result()
    wall = time.perf_counter() - started
    largest = extremes(result)
    elevator = "th1" in largest
    angles = ("th1", "th2") if elevator else ("alpha", "beta")
    shown = [
        f"{largest[name]:.3f} rad" if elevator else f"{math.degrees(largest[name]):.1f} deg"
        for name in angles
    ]
    errors = [segment["error_rms"][angles[0]] for segment in result["segments"]]
    error = f"{max(errors):.1e} rad" if elevator else f"{math.degrees(np.median(errors)):.3f} deg"
    final = f"{result['final_time']:.1f} s" if elevator else f"{result['final_time'] / 3600:.2f} h"
    predictions = [segment["prediction"]["seconds"] for segment in result["segments"][1:]]
    tracking = [segment["tracking_seconds"] for segment in result["segments"]]
    return (
        f"| {label} | {result['status']} | {final} | {', '.join(shown)} | {error} "
        f"| {1e3 * np.median(predictions):.0f} | {1e3 * np.median(tracking):.0f} | {wall:.1f} |"
    )


def whole_transfer(model: str) -> str:
    """The elevator's way as one problem: what no mission in segments can beat."""
    document = load_case("pse")
    document["problem"]["model"]["name"] = model
    document["method"] = {"name": "hermite_simpson", "intervals": 150}
    result = solve(check_document(document)).result()
    return (
        f"| {model} | {result['status']} | {result['final_time']:.2f} s | {extremes(result)['th1']:.4f} rad |"
    )


def on_off(name: str) -> str:
    """The deorbit by a switch instead of a prediction."""
    spec = check_document(load_case(name))
    setup = Setup.of(spec)
    problem = setup.problem
    plant = Plant.of(spec.problem, setup.method.plant, problem)
    flight, stop = PlantFlight(CompiledPlant(plant)), StopWatch.of(problem, setup.method)
    start = np.array([interval[0] for interval in problem.initial_state])
    state, t, met = np.append(plant.begin(start, 0.0), 0.0), 0.0, None
    pitch = roll = on_again = charged = 0.0
    length, step = float(setup.method.segments.length or 0.0), 60.0
    while met is None and t < problem.final_time[1]:
        times, seen, currents = [t], [flight.see(state, t)], []
        while t < times[0] + length - 1e-6:
            pitched, rising = seen[-1][:2]
            if t >= on_again and pitched > ON_OFF_PITCH and rising > 0.0:
                on_again = t + ON_OFF_SECONDS
            current = np.array([ON_OFF_CURRENT * (t >= on_again)])
            charged += step * float(t >= on_again)
            state = flight.fly(state, t, t + step, current, current)
            t += step
            times.append(t)
            currents.append(current)
            seen.append(flight.see(state, t))
        shown = np.array(seen).T
        pitch, roll = max(pitch, np.abs(shown[0]).max()), max(roll, np.abs(shown[2]).max())
        met = stop.met(np.array(times), shown, np.array([*currents, current]).T)
    hours = "never" if met is None else f"{met / 3600:.1f} h"
    angles = f"{math.degrees(pitch):.0f}, {math.degrees(roll):.0f} deg"
    return f"| on-off, {name} | {hours} | {angles} | {charged / t:.2f} |"


def flown(document: Document, *, parallel: bool, share: float = CHAPTER_SHARE) -> Mission:
    """A mission by two processes or by one."""
    spec = check_document(document)
    setup = Setup.of(spec)
    plant = CompiledPlant(Plant.of(spec.problem, setup.method.plant, setup.problem))
    if parallel:
        with RemotePredictor(spec.resolved().document) as there:
            there.ask(First(600.0))
            return fly_mission(setup, there, plant, SilentProgress(), math.inf)
    here = LocalPredictor(Predictor(setup, share))
    here.ask(First(600.0))
    return fly_mission(setup, here, plant, SilentProgress(), math.inf)


def from_start(side: int, share: float) -> tuple[float, float, float]:
    """The published scheme from a side of the Earth: hours, pitch and roll in deg."""
    document = variant("edt_igrf", dipole_predictions)
    document["problem"]["initial_state"]["lon"] = side * 2 * math.pi / SIDES
    mission = flown(document, parallel=False, share=share)
    seen = np.degrees(np.abs(np.hstack([segment.track.seen for segment in mission.segments])).max(axis=1))
    assert mission.stopped_at is not None
    return mission.stopped_at / 3600.0, float(seen[0]), float(seen[2])


def gains(name: str) -> str:
    """All gains of a segment, with the derivatives they are made of: the fastest of some."""
    setup = Setup.of(check_document(load_case(name)))
    reference = Predictor(setup).first(Limits(math.inf, lambda: False))
    times = []
    for _ in range(30):
        started = time.perf_counter()
        setup.tracker.gains(reference)
        times.append(time.perf_counter() - started)
    return f"| {name} | {len(setup.model.driven)} | {setup.plan.nodes} | {1e3 * min(times):.2f} |"


def overlap(label: str, document: Document, runs: int = 3) -> str:
    """One line of the table of schedules: the fastest of some runs."""
    apart, alone = (
        min((flown(document, parallel=way) for _ in range(runs)), key=lambda mission: mission.seconds)
        for way in (True, False)
    )
    predicted = sum(segment.reference.seconds for segment in alone.segments[1:])
    tracked = sum(segment.tracking_seconds for segment in alone.segments)
    wait, hand_over = (
        1e3 * float(np.median([getattr(segment, name) for segment in apart.segments[1:]]))
        for name in ("wait", "hand_over")
    )
    ideal = (predicted + tracked) / max(predicted, tracked)
    return (
        f"| {label} | {predicted:.2f} + {tracked:.2f} | {alone.seconds:.2f} | {apart.seconds:.2f} "
        f"| {alone.seconds / apart.seconds:.2f} | {ideal:.2f} | {wait:.1f} | {hand_over:.1f} |"
    )


def head(*names: str) -> None:
    """The head of a table."""
    print(f"\n| {' | '.join(names)} |\n|{'---|' * len(names)}")


def missions() -> None:
    """The cases, and the published scheme."""
    head("mission", "status", "final time", "largest angles", "error", "predict, ms", "track, ms", "wall, s")
    for label, document in (
        ("pse", load_case("pse")),
        ("pse, as published", variant("pse", small_angles)),
        ("edt_dipole", load_case("edt_dipole")),
        ("edt_dipole, as published", variant("edt_dipole", chapter)),
        ("edt_igrf", load_case("edt_igrf")),
        ("edt_igrf, as published", variant("edt_igrf", dipole_predictions)),
    ):
        print(row(label, document), flush=True)


def gain_times() -> None:
    """What the gains of a segment take."""
    head("gains", "states", "nodes", "ms")
    for name in ("pse", "edt_igrf"):
        print(gains(name), flush=True)


def yardstick() -> None:
    """What no mission of the elevator can beat."""
    head("the elevator's whole way as one problem", "status", "final time", "th1")
    for model in ("pse", "pse_exact"):
        print(whole_transfer(model), flush=True)


def baseline() -> None:
    """The deorbit by a switch."""
    head("baseline", "to 700 km", "pitch, roll", "duty")
    for name in ("edt_dipole", "edt_igrf"):
        print(on_off(name), flush=True)


def starts() -> None:
    """The published scheme from all sides of the Earth, by shares of the last error."""
    head("as published in IGRF, start, deg", "share of the last error", "hours", "pitch, deg", "roll, deg")
    for share in (0.0, CHAPTER_SHARE):
        for side in range(SIDES):
            hours, pitch, roll = from_start(side, share)
            print(
                f"| {360 * side / SIDES:.0f} | {share} | {hours:.2f} | {pitch:.1f} | {roll:.1f} |", flush=True
            )


def schedules() -> None:
    """Two processes against one."""
    head(
        "schedule",
        "predict + track, s",
        "sequential, s",
        "parallel, s",
        "ratio",
        "ideal",
        "wait, ms",
        "hand-over, ms",
    )
    for name in ("edt_igrf", "edt_dipole", "pse"):
        print(overlap(name, load_case(name)), flush=True)


TABLES = {
    "missions": missions,
    "gains": gain_times,
    "yardstick": yardstick,
    "baseline": baseline,
    "starts": starts,
    "schedules": schedules,
}

if __name__ == "__main__":
    for table in sys.argv[1:] or TABLES:
        TABLES[table]()
