"""Solve a document with the method ``piecewise``: fly the mission, prove it, answer."""

from __future__ import annotations

import time

from solvers.piecewise.answer import answer
from solvers.piecewise.messages import First
from solvers.piecewise.mission import fly_mission
from solvers.piecewise.plant import Plant
from solvers.piecewise.plant_flight import CompiledPlant
from solvers.piecewise.remote import RemotePredictor
from solvers.piecewise.setup import Setup
from solvers.progress import Progress
from solvers.solution import Solution
from solvers.spec import JobSpec


def solve_piecewise(spec: JobSpec, progress: Progress, seconds: float) -> Solution:
    """Predict in a process of its own, track in this one, for at most ``seconds``.

    Raises CompanionError where that process cannot work, and what ``progress`` raises.
    """
    started = time.perf_counter()
    deadline = time.monotonic() + seconds
    spent = {"refine": 0.0}
    with RemotePredictor(spec.resolved().document) as predictions:
        predictions.ask(First(seconds))  # so that both processes prepare at the same time
        setup = Setup.of(spec)
        plant = CompiledPlant(Plant.of(spec.problem, setup.method.plant, setup.problem))
        spent["build"] = time.perf_counter() - started
        mission = fly_mission(setup, predictions, plant, progress, deadline)
    spent["solve"] = time.perf_counter() - started - spent["build"]
    solution = answer(setup, plant, mission, spent)
    spent["total"] = time.perf_counter() - started
    return solution
