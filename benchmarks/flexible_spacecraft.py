"""The flexible-spacecraft slew against a hand-written CasADi Hermite-Simpson, refined, and on finer meshes.

Both run in this one warm process, in turn, on the same bounds, guess and tolerance; a ratio below 1 means
that ondelette is faster. Verification is not part of the times.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from solvers.cache import STRUCTURES
from solvers.catalogue import load_case
from solvers.solve import solve
from solvers.spec import check_document

MINIMUM_TIME = 25.866100388133
PAIRS = 11
SCALING_RUNS = 3


@dataclass(frozen=True)
class Slew:
    """The slew, or a neighbour of it: one number is another."""

    stiffness: float = 100.0
    initial: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    final: tuple[float, ...] = (np.pi / 6, 0.0, 0.0, 0.0)
    guess: float = 30.0

    def document(self, level: int) -> dict[str, Any]:
        """The job document, by spline wavelets on this level."""
        document = load_case("flexible_spacecraft")
        problem = document["problem"]
        names = list(problem["initial_state"])
        problem["model"]["parameters"]["k"] = self.stiffness
        problem["initial_state"] = dict(zip(names, self.initial, strict=True))
        problem["final_state"] = dict(zip(names, self.final, strict=True))
        problem["guess"] = {"final_time": self.guess}
        document["method"] = {"name": "swcm", "L": 8, "J": level}
        return document


NEIGHBOURS = {
    "as in the case": Slew(),
    "theta_dot_f = 1e-4 rad/s": Slew(final=(np.pi / 6, 0.0, 1e-4, 0.0)),
    "theta_dot_f = -1e-4 rad/s": Slew(final=(np.pi / 6, 0.0, -1e-4, 0.0)),
    "theta_dot_f = 1e-3 rad/s": Slew(final=(np.pi / 6, 0.0, 1e-3, 0.0)),
    "theta_dot_f = -3e-3 rad/s": Slew(final=(np.pi / 6, 0.0, -3e-3, 0.0)),
    "alpha_f = 1e-4 rad": Slew(final=(np.pi / 6, 1e-4, 0.0, 0.0)),
    "alpha_dot_f = 1e-6 rad/s": Slew(final=(np.pi / 6, 0.0, 0.0, 1e-6)),
    "theta_dot_0 = 1e-3 rad/s": Slew(initial=(0.0, 0.0, 1e-3, 0.0)),
    "k = 70 N m/rad": Slew(stiffness=70.0),
    "theta_f = 1.1 rad": Slew(final=(1.1, 0.0, 0.0, 0.0)),
    "guess t_f = 20 s": Slew(guess=20.0),
    "guess t_f = 50 s": Slew(guess=50.0),
}


def hand_written(points: int, slew: Slew = Slew()) -> Callable[[], tuple[float, int, bool]]:
    """Build Hermite-Simpson as one writes it by hand, an MX graph, expanded.

    Returns what solves for t_f, the number of iterations, and whether IPOPT calls it a success.
    """
    jb, r, m, length, k = 440.0, 2.5, 10.0, 5.0, slew.stiffness
    intervals = (points - 1) // 2
    x, u = ca.MX.sym("x", 4), ca.MX.sym("u")
    _, alpha, theta_dot, alpha_dot = ca.vertsplit(x)
    m11 = jb + 2 * m * (r * r + length * length + 2 * r * length * ca.cos(alpha))
    m12 = 2 * m * (length * length + r * length * ca.cos(alpha))
    m22 = 2 * m * length * length
    sine = 2 * m * r * length * ca.sin(alpha)
    load1 = u + sine * alpha_dot * theta_dot + sine * (theta_dot + alpha_dot) * alpha_dot
    load2 = -sine * theta_dot * theta_dot - 2 * k * alpha
    determinant = m11 * m22 - m12 * m12
    acceleration = ca.vertcat(
        (m22 * load1 - m12 * load2) / determinant, (m11 * load2 - m12 * load1) / determinant
    )
    f = ca.Function("f", [x, u], [ca.vertcat(theta_dot, alpha_dot, acceleration)])
    states, controls, duration = ca.MX.sym("X", 4, points), ca.MX.sym("U", points), ca.MX.sym("T")
    rates = f.map(points)(states, controls.T)
    h = duration / intervals
    left, middle, right = slice(0, points - 2, 2), slice(1, points - 1, 2), slice(2, points, 2)
    hermite = (
        states[:, middle]
        - (states[:, left] + states[:, right]) / 2
        - h / 8 * (rates[:, left] - rates[:, right])
    )
    simpson = (
        states[:, right] - states[:, left] - h / 6 * (rates[:, left] + 4 * rates[:, middle] + rates[:, right])
    )
    program = {
        "x": ca.vertcat(ca.vec(states), controls, duration),
        "f": duration,
        "g": ca.vertcat(ca.vec(hermite), ca.vec(simpson)),
    }
    options = {
        "expand": True,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-8,
    }
    solver = ca.nlpsol("hand_written", "ipopt", program, options)
    lower, upper = np.full(5 * points + 1, -np.inf), np.full(5 * points + 1, np.inf)
    lower[4 * points : -1], upper[4 * points : -1] = -5, 5
    lower[-1], upper[-1] = 1, 100
    start, target = np.array(slew.initial), np.array(slew.final)
    lower[:4] = upper[:4] = start
    lower[4 * points - 4 : 4 * points] = upper[4 * points - 4 : 4 * points] = target
    guess = np.zeros(5 * points + 1)
    guess[: 4 * points] = (start + np.outer(np.linspace(0, 1, points), target - start)).ravel()
    guess[-1] = slew.guess

    def solve_it() -> tuple[float, int, bool]:
        found = float(solver(x0=guess, lbx=lower, ubx=upper, lbg=0, ubg=0)["f"])
        stats = solver.stats()
        return found, int(stats["iter_count"]), bool(stats["success"])

    return solve_it


def ondelette(level: int, *, cold: bool, refine: str | None = None) -> tuple[float, float]:
    """Build and solve by spline wavelets on this level. Returns t_f and the seconds of both.

    ``cold``: without what an earlier solve has compiled.
    """
    if cold:
        STRUCTURES.clear()
    document = load_case("flexible_spacecraft")
    document["method"] = {"name": "swcm", "L": 8, "J": level, "refine": refine}
    solution = solve(check_document(document))
    seconds = solution.statistics.seconds
    return solution.objective, seconds["build"] + seconds["solve"] + seconds["refine"]


def timed(call: Callable[[], tuple[float, int, bool]]) -> tuple[float, float]:
    """The t_f of a call and the seconds that it took."""
    started = time.perf_counter()
    final_time, _, _ = call()
    return final_time, time.perf_counter() - started


def against_hand_written() -> None:
    """Print the comparison at the same numbers of points, cold (build and solve) and warm (solve again)."""
    print(f"Interpreter warm, medians of {PAIRS} interleaved pairs; reference t_f {MINIMUM_TIME}\n")
    print("| N | | Hermite-Simpson by hand, s | error | SWCM, s | error | ratio (min..max) |")
    print("|---|---|---|---|---|---|---|")
    for level in (4, 5):
        points = 8 * 2**level + 3
        built = hand_written(points)
        ondelette(level, cold=True)
        for name, cold in (("cold", True), ("warm", False)):
            ondelette(level, cold=cold)
            pairs = [
                (
                    timed(lambda points=points: hand_written(points)()) if cold else timed(built),
                    ondelette(level, cold=cold),
                )
                for _ in range(PAIRS)
            ]
            theirs, ours = (statistics.median(pair[side][1] for pair in pairs) for side in (0, 1))
            ratios = sorted(own[1] / hand[1] for hand, own in pairs)
            print(
                f"| {points} | {name} | {theirs:.4f} | {abs(pairs[0][0][0] - MINIMUM_TIME):.1e} "
                f"| {ours:.4f} | {abs(pairs[0][1][0] - MINIMUM_TIME):.1e} "
                f"| {statistics.median(ratios):.2f} ({ratios[0]:.2f}..{ratios[-1]:.2f}) |"
            )


def neighbours() -> None:
    """Print how many iterations neighbouring slews take from the guess of the document, N = 131."""
    print("\nThe slew and its neighbours, N = 131, from the straight line between their ends\n")
    print("| slew | by hand: iterations | t_f | SWCM: iterations | t_f |")
    print("|---|---|---|---|---|")
    totals = [0, 0]
    for name, slew in NEIGHBOURS.items():
        theirs, count, succeeded = hand_written(131, slew)()
        ours = solve(check_document(slew.document(4)))
        totals = [totals[0] + count, totals[1] + ours.statistics.iterations]
        print(
            f"| {name} | {count}{'' if succeeded else ' (failed)'} | {theirs:.4f} "
            f"| {ours.statistics.iterations}{'' if ours.success else ' (failed)'} | {ours.objective:.4f} |"
        )
    print(f"| all | {totals[0]} | | {totals[1]} | |")


def refined() -> None:
    """Print what the switching refinement costs beside the plain solve."""
    print("\nSWCM N = 131, structures compiled, with and without switching refinement\n")
    runs = [
        (ondelette(4, cold=False), ondelette(4, cold=False, refine="switching")) for _ in range(PAIRS + 1)
    ][1:]
    ratio = statistics.median(fine[1] / plain[1] for plain, fine in runs)
    plain, fine = (statistics.median(run[side][1] for run in runs) for side in (0, 1))
    print(f"plain {plain:.4f} s, error {abs(runs[0][0][0] - MINIMUM_TIME):.1e}; ", end="")
    print(f"refined {fine:.4f} s, error {abs(runs[0][1][0] - MINIMUM_TIME):.1e}; ratio {ratio:.2f}")


def scaling() -> None:
    """Print how the time grows with the number of points."""
    print("\nSWCM, build + solve, growth with N\n")
    print("| N | s | error | exponent from N = 259 |")
    print("|---|---|---|---|")
    first = None
    for level in (5, 6, 7, 8, 9, 10, 11):
        points = 8 * 2**level + 3
        runs = [ondelette(level, cold=True) for _ in range(SCALING_RUNS)]
        seconds = statistics.median(run[1] for run in runs)
        first = first or (points, seconds)
        exponent = (
            "" if points == first[0] else f"{np.log(seconds / first[1]) / np.log(points / first[0]):.2f}"
        )
        print(f"| {points} | {seconds:.3f} | {abs(runs[0][0] - MINIMUM_TIME):.1e} | {exponent} |")


if __name__ == "__main__":
    against_hand_written()
    neighbours()
    refined()
    scaling()
