"""Missions: two processes, their hand-over, how they stop, and what the result says."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from solvers.companion import CompanionError
from solvers.output.bundle import BundleError, pack, unpack
from solvers.output.export import to_csv
from solvers.output.plot import render
from solvers.piecewise.messages import First
from solvers.piecewise.mission import Mission, fly_mission
from solvers.piecewise.plant import Plant
from solvers.piecewise.plant_flight import CompiledPlant
from solvers.piecewise.predict import Predictor
from solvers.piecewise.remote import LocalPredictor, RemotePredictor
from solvers.piecewise.setup import Setup
from solvers.progress import ProgressReport, SilentProgress
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory
from solvers.verification.replay import replay
from tests.solvers.piecewise.documents import CART, PENDULUM, changed


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return solve(check_document(PENDULUM)).result("job")


def test_the_plant_is_tracked_within_its_bounds(result: dict[str, Any]) -> None:
    assert result["success"], result["message"]
    assert result["final_time"] == 6.0
    margins = {item["pointer"]: item["margin"] for item in result["constraints"]}
    assert margins["/problem/bounds/rate"] > -1e-2
    names = [check["name"] for check in result["verification"]["checks"]]
    assert names == ["state_error", "bound", "path", "ends"]
    assert result["verification"]["max_state_error"] < 1e-8


def test_segments_follow_each_other(result: dict[str, Any]) -> None:
    segments = result["segments"]
    assert [segment["index"] for segment in segments] == [0, 1, 2, 3]
    for before, after in pairwise(segments):
        assert before["tf"] == after["t0"]
        for name in ("angle", "rate", "phase"):
            assert before["tracked"]["states"][name][-1] == after["tracked"]["states"][name][0]
    for segment in segments:
        for half in ("predicted", "tracked"):
            lengths = {len(values) for values in segment[half]["states"].values()}
            assert lengths == {len(segment[half]["t"])} == {13}
        assert segment["prediction"]["status"] == "converged"
        assert segment["tracking_seconds"] > 0
        assert 0 <= segment["hand_over_seconds"] <= segment["wait_seconds"]
    assert result["schedules"].keys() == {
        "parallel",
        "sequential",
        "speedup",
        "median_wait",
        "median_hand_over",
    }
    assert sum(segment["tracking_seconds"] for segment in segments) < result["schedules"]["sequential"]
    seconds = result["statistics"]["seconds"]
    assert seconds.keys() == {"build", "solve", "refine", "verify", "total"}
    assert sum(seconds.values()) - seconds["total"] == pytest.approx(seconds["total"], rel=0.05)


def test_the_arcs_are_those_of_the_tracked_control(result: dict[str, Any]) -> None:
    found = result["switching"]["torque"]
    assert set(found["arcs"]) >= {"lower", "interior"}  # pushed back at first, let go later
    edges = [result["segments"][0]["t0"], *found["times"], result["segments"][-1]["tf"]]
    for start, stop, level in zip(edges[:-1], edges[1:], found["levels"], strict=True):
        for segment in result["segments"]:
            tracked = segment["tracked"]
            for t, torque in zip(tracked["t"], tracked["controls"]["torque"], strict=True):
                if start < t < stop:
                    assert (abs(torque - level) < 0.05) if level is not None else (abs(torque) < 0.98)


def test_the_objective_is_that_of_what_was_flown(result: dict[str, Any]) -> None:
    trajectory = result["trajectory"]
    angle, torque = (
        np.array(trajectory[group][name]) for group, name in (("states", "angle"), ("controls", "torque"))
    )
    integral = np.trapezoid(angle**2 + 0.1 * torque**2, trajectory["t"])
    assert result["objective"] == pytest.approx(integral, rel=1e-3)
    assert result["objective"] == pytest.approx(result["verification"]["objective"], rel=1e-9)


def test_a_result_is_json_can_be_resampled_exported_and_drawn(result: dict[str, Any]) -> None:
    stored = json.loads(json.dumps(result, allow_nan=False))
    curves = Trajectory.from_result(stored)
    times = np.array(stored["trajectory"]["t"])
    for group in ("states", "controls"):
        for name, values in stored["trajectory"][group].items():
            np.testing.assert_allclose(curves.sample(times)[group][name], values, rtol=0, atol=1e-12)
    assert len(to_csv(stored).splitlines()) == 1 + times.size
    assert render(stored, "svg").startswith(b"<?xml")
    assert set(stored["interpolation"].values()) == {"linear"}


def test_the_tracked_states_have_the_rates_of_the_plant(result: dict[str, Any]) -> None:
    curves = Trajectory.from_result(result)
    tau = np.linspace(0.01, 0.99, 50)
    angle, rate, _ = curves.states_at(tau)
    np.testing.assert_allclose(curves.rates_at(tau)[0], rate, atol=5e-3)
    assert np.abs(angle).max() > 0.3


STOPPED = changed(PENDULUM, "/method/stop", {"expression": "phase_f", "bounds": [1.5, None]})


@pytest.mark.parametrize("document", [PENDULUM, STOPPED], ids=["end", "stop"])
def test_a_stored_mission_is_verified_again(document: dict[str, Any]) -> None:
    stored = json.loads(json.dumps(solve(check_document(document)).result()))
    text = json.dumps(document).encode()
    found = replay(unpack(pack(text, {}, stored, [])))
    assert found.confirmed, (found.differing, found.verification)
    states = stored["plant"]["states"]["q"]
    states[len(states) // 2] += 0.1
    assert not replay(unpack(pack(text, {}, stored, []))).confirmed
    del stored["plant"]
    with pytest.raises(BundleError, match="mission"):
        replay(unpack(pack(text, {}, stored, [])))


def flown(document: dict[str, Any], *, parallel: bool) -> Mission:
    spec = check_document(document)
    setup = Setup.of(spec)
    plant = CompiledPlant(Plant.of(spec.problem, setup.method.plant, setup.problem))
    if not parallel:
        here = LocalPredictor(Predictor(setup))
        here.ask(First(60.0))
        return fly_mission(setup, here, plant, SilentProgress(), math.inf)
    with RemotePredictor(spec.resolved().document) as there:
        there.ask(First(60.0))
        return fly_mission(setup, there, plant, SilentProgress(), time.monotonic() + 60)


@pytest.mark.parametrize("document", [PENDULUM, CART], ids=["time", "state"])
def test_two_processes_give_what_one_gives(document: dict[str, Any]) -> None:
    apart, together = (flown(document, parallel=parallel) for parallel in (True, False))
    assert len(apart.segments) == len(together.segments)
    for one, other in zip(apart.segments, together.segments, strict=True):
        np.testing.assert_array_equal(one.track.states, other.track.states)


def test_the_end_of_the_yard_is_reached() -> None:
    found = solve(check_document(CART)).result()
    assert found["success"], found["message"]
    assert found["trajectory"]["states"]["x"][-1] == pytest.approx(10.0, abs=2e-2)
    # Thrust to v = 1.98, the margin's bound, hold, brake to v = 1: without friction in closed form.
    fast, far = 1.98, 10.0
    free = fast + (fast - 1) + (far - fast**2 / 2 - (fast**2 - 1) / 2) / fast
    assert found["final_time"] == pytest.approx(free, rel=0.02)


def test_a_stop_ends_the_mission_where_it_is_met() -> None:
    found = solve(check_document(STOPPED)).result()
    assert found["success"], found["message"]
    assert found["final_time"] == pytest.approx(2.4, abs=1e-6)  # 0.3 + 0.5 t = 1.5
    assert found["trajectory"]["t"][-1] == found["final_time"]
    assert found["trajectory"]["states"]["phase"][-1] == pytest.approx(1.5, abs=1e-9)
    assert len(found["segments"]) == 2


def test_a_stop_may_ask_for_averages_over_segments() -> None:
    stop = {"expression": "phase_f", "bounds": [1.5, None], "average": True}
    found = solve(check_document(changed(PENDULUM, "/method/stop", stop))).result()
    # The mean of a straight line is its value in the middle, at 2.25 s 1.425 and at 3.75 s 2.175.
    assert found["final_time"] == pytest.approx(2.4, abs=1e-6)
    assert len(found["segments"]) == 3


def test_a_stop_that_is_never_met_is_no_success() -> None:
    document = changed(PENDULUM, "/method/stop", {"expression": "phase_f", "bounds": [100, None]})
    found = solve(check_document(document)).result()
    assert (found["success"], found["status"]) == (False, "unverified")
    assert "stop" in found["message"]


class Watcher:
    """Takes notes, and asks to stop after so many reports."""

    def __init__(self, reports: float = math.inf) -> None:
        self.reports: list[ProgressReport] = []
        self._most = reports

    def report(self, report: ProgressReport) -> None:
        self.reports.append(report)

    def cancelled(self) -> bool:
        return len(self.reports) >= self._most


def test_every_segment_is_reported() -> None:
    watcher = Watcher()
    solve(check_document(PENDULUM), watcher)
    assert [report.stage for report in watcher.reports[1:]] == [f"segment {k} of 4" for k in (1, 2, 3, 4)]
    fractions = [report.fraction for report in watcher.reports]
    assert fractions == sorted(fractions)  # type: ignore[type-var]
    assert fractions[-1] == 1.0


@pytest.mark.parametrize(("reports", "segments"), [(1, 1), (3, 2)])
def test_a_mission_that_is_cancelled_keeps_what_was_flown(reports: int, segments: int) -> None:
    found = solve(check_document(PENDULUM), Watcher(reports)).result()
    assert (found["status"], found["success"]) == ("cancelled", False)
    assert len(found["segments"]) == segments
    assert found["verification"]["checks"]


def test_the_time_limit_holds() -> None:
    started = time.monotonic()
    found = solve(check_document(changed(PENDULUM, "/options", {"max_seconds": 0.05}))).result()
    assert found["status"] == "time_limit"
    assert time.monotonic() - started < 5


def test_a_plant_that_runs_away_is_told() -> None:
    document = changed(CART, "/method/plant/model/dynamics/v", "u + v^3")
    found = solve(check_document(document)).result()
    assert found["status"] == "diverged"
    assert "runs away at t =" in found["message"]
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize(
    ("place", "expression"),
    [
        ("start/q", "1/(angle - 1)"),
        ("observe/angle", "sqrt(q - 5)"),
        ("observe/rate", "q_dot + 1e-9*log(4 - t)"),
    ],
)
def test_a_plant_that_cannot_be_seen_or_started_is_told(place: str, expression: str) -> None:
    found = solve(check_document(changed(PENDULUM, f"/method/plant/{place}", expression))).result()
    assert found["status"] == "evaluation_error"
    assert f"/method/plant/{place.partition('/')[0]}" in found["message"]
    json.dumps(found, allow_nan=False)


def test_the_predictor_ends_with_the_mission() -> None:
    with RemotePredictor(check_document(PENDULUM).resolved().document) as predictor:
        assert alive(predictor.pid)
    assert not alive(predictor.pid)


def test_a_predictor_that_was_killed_is_told() -> None:
    with RemotePredictor(check_document(PENDULUM).resolved().document) as predictor:
        os.kill(predictor.pid, signal.SIGKILL)
        with pytest.raises(CompanionError, match="has ended"):
            predictor.take(lambda: None)


def test_an_error_of_the_predictor_is_raised_here() -> None:
    with RemotePredictor({"problem": "none"}) as predictor, pytest.raises(CompanionError, match="Document"):
        predictor.take(lambda: None)


def test_the_predictor_dies_with_its_parent() -> None:
    program = (
        "import sys, time, json; from solvers.piecewise.remote import RemotePredictor\n"
        "predictor = RemotePredictor(json.loads(sys.argv[1]))\n"
        "print(predictor.pid, flush=True); time.sleep(60)"
    )
    document = json.dumps(check_document(PENDULUM).resolved().document)
    parent = subprocess.Popen([sys.executable, "-c", program, document], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert alive(child)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    give_up = time.monotonic() + 10
    while alive(child):
        assert time.monotonic() < give_up, "the predictor outlives its parent"
        time.sleep(0.05)


def test_waiting_for_a_prediction_is_interrupted_within_a_second() -> None:
    with RemotePredictor(check_document(PENDULUM).resolved().document) as predictor:
        stop = threading.Event()
        threading.Timer(0.1, stop.set).start()

        def watch() -> None:
            if stop.is_set():
                raise InterruptedError

        started = time.monotonic()
        with pytest.raises(InterruptedError):
            predictor.take(watch)  # nothing was asked: there will never be an answer
        assert time.monotonic() - started < 1.0
