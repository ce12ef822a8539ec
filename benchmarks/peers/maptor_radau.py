"""MAPTOR: Radau collocation, on segments of five points or adaptively refined from a coarse mesh.

Variant "adaptive": from ten segments of four points, an error tolerance of 1e-8 for the mesh and at most 30
refinements (MAPTOR's default); N is then not used.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from importlib.metadata import version
from itertools import pairwise

import casadi as ca
import maptor
import numpy as np
from contract import Answer, run, through_the_ends
from problems import MAX_ITERATIONS, TOLERANCE, Case

DEGREE = 5
ADAPTIVE_START = (10, 4)


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """One phase; a running cost is its one integral."""
    problem = maptor.Problem(case.name)
    phase = problem.set_phase(1)
    lower, upper = case.final_time
    clock = phase.time(initial=0.0, final=(lower, upper) if case.free_time else lower)

    def bounds(name: str) -> tuple[float | None, float | None] | None:
        low, high = (value if np.isfinite(value) else None for value in case.bounds[name])
        return None if low is None and high is None else (low, high)

    states = [
        phase.state(name, initial=case.initial.get(name), final=case.final.get(name), boundary=bounds(name))
        for name in case.states
    ]
    controls = [phase.control(name, boundary=bounds(name)) for name in case.controls]
    phase.dynamics(dict(zip(states, case.rates(states, controls, ca), strict=True)))
    running = case.running(states, controls, ca)
    terminal = case.terminal([state.final for state in states], clock.final, ca)
    problem.minimize(phase.add_integral(running) if terminal is None else terminal)
    segments, degree = ADAPTIVE_START if variant == "adaptive" else (round(points / DEGREE), DEGREE)
    knots = np.linspace(-1, 1, segments + 1)

    def guesses(names: tuple[str, ...], count: int) -> list[np.ndarray]:
        return [
            np.array([[case.guess(name, (tau + 1) / 2) for tau in instants] for name in names])
            for instants in (np.linspace(a, b, count) for a, b in pairwise(knots))
        ]

    options = {
        "ipopt.tol": TOLERANCE,
        "ipopt.max_iter": MAX_ITERATIONS,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
    }

    def again() -> Answer:
        # A refinement leaves its last mesh and answer behind.
        phase.mesh([degree] * segments, knots)
        phase.guess(
            states=guesses(case.states, degree + 1),
            controls=guesses(case.controls, degree),
            initial_time=0.0,
            terminal_time=case.guess_time,
            integrals=None if running is None else 1.0,
        )
        if variant == "adaptive":
            solution = maptor.solve_adaptive(
                problem, error_tolerance=TOLERANCE, nlp_options=options, show_summary=False
            )
        else:
            solution = maptor.solve_fixed_mesh(problem, nlp_options=options, show_summary=False)
        final_time = solution.phases[1]["times"]["final"]
        clocks = {
            name: through_the_ends(
                *rising(solution[(1, "time_controls")], solution[(1, name)]), 0.0, final_time
            )
            for name in case.controls
        }
        intervals = solution.phases[1]["mesh"]["num_intervals"]
        return Answer(
            objective=float(solution.status["objective"]),
            times=next(iter(clocks.values()))[0],
            controls={name: values for name, (_, values) in clocks.items()},
            state_times=[float(t) for t in solution[(1, "time_states")]],
            states={name: [float(v) for v in solution[(1, name)]] for name in case.states},
            success=bool(solution.status["success"]),
            message=str(solution.status["message"]),
            mesh=f"LGR {intervals} segments, {sum(solution.phases[1]['mesh']['polynomial_degrees'])} points",
        )

    return again


def rising(times: np.ndarray, values: np.ndarray) -> tuple[list[float], list[float]]:
    """Without instants that MAPTOR returns twice, at the knots of the mesh."""
    keep = np.concatenate([[True], np.diff(times) > 0])
    return np.asarray(times)[keep].tolist(), np.asarray(values)[keep].tolist()


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    run("MAPTOR", version("maptor"), build)
