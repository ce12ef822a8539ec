"""ondelette and its peers on the same cases: one table a case, in Markdown.

    python benchmarks/peers/run.py [CASE ...] [--peers NAME,...] [--points N]

Each row is a subprocess of its own with one thread, in the peer's own virtual environment. The control that a
peer returned is read linearly between its nodes, clipped to its bounds, and flown by the same verification
that checks ondelette's answers. A peer that is not installed, fails or takes too long is a row that says so.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import problems

from solvers.backends import NUMPY
from solvers.catalogue import load_case
from solvers.curves import LinearCurve
from solvers.formulation.stated import stated_problem
from solvers.problem import OptimalControlProblem
from solvers.spec import check_document
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Tolerances
from solvers.verification.verify import verify

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
POINTS = 131
TIME_LIMIT = 180
REPETITIONS = 3
QUICK = 10.0
FLIGHT_LIMIT = 60
ALL = ("flexible_spacecraft", "hypersensitive", "goddard", "brachistochrone")


@dataclass(frozen=True)
class Peer:
    """One row: a script, the name of its environment (empty: ondelette's own), a variant of the script."""

    title: str
    script: str
    environment: str = ""
    variant: str = ""

    @property
    def python(self) -> Path:
        """The interpreter of this peer."""
        if not self.environment:
            return Path(sys.executable)
        return ROOT / ".venv-peers" / self.environment / "bin" / "python"


BASE = Peer("ondelette swcm", "ondelette.py", variant="swcm")
PEERS = (
    BASE,
    Peer("ondelette gpm", "ondelette.py", variant="gpm"),
    Peer("ondelette hermite_simpson", "ondelette.py", variant="hermite_simpson"),
    Peer("ondelette swcm, switching", "ondelette.py", variant="swcm-switching"),
    Peer("ondelette swcm, adaptive", "ondelette.py", variant="swcm-adaptive"),
    Peer("ondelette gpm, adaptive", "ondelette.py", variant="gpm-adaptive"),
    Peer("CasADi by hand", "casadi_hermite_simpson.py"),
    Peer("YAPSS", "yapss_radau.py", "yapss"),
    Peer("MAPTOR, fixed mesh", "maptor_radau.py", "maptor"),
    Peer("MAPTOR, adaptive", "maptor_radau.py", "maptor", "adaptive"),
    Peer("opty", "opty_midpoint.py", "opty"),
    Peer("rockit, shooting", "rockit_grid.py", "rockit-meco"),
    Peer("rockit, collocation", "rockit_grid.py", "rockit-meco", "collocation"),
    Peer("pyomo.dae", "pyomo_radau.py", "pyomo"),
    Peer("dymos", "dymos_radau.py", "dymos"),
    Peer("GEKKO, fix_final", "gekko_nodes.py", "gekko"),
    Peer("GEKKO, inequalities", "gekko_nodes.py", "gekko", "inequalities"),
)


def answer(peer: Peer, case: str, points: int) -> dict[str, Any] | str:
    """The peer's line of JSON, or why there is none."""
    if not peer.python.exists():
        return f"not installed: no {peer.python.relative_to(ROOT)}"
    command = [str(peer.python), str(HERE / peer.script), case, str(points)]
    if peer.variant:
        command.append(peer.variant)
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=TIME_LIMIT, env=environment, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no answer in {TIME_LIMIT} s"
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        return f"failed: {lines[-1][:100] if lines else f'exit code {done.returncode}'}"
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def timed_answer(peer: Peer, case: str, points: int) -> dict[str, Any] | str:
    """The answer with the medians of the times of three processes, of one where it takes long."""
    first = answer(peer, case, points)
    if isinstance(first, str) or first["seconds_cold"] > QUICK:
        return first
    results = [first, *(answer(peer, case, points) for _ in range(REPETITIONS - 1))]
    kept = [result for result in results if not isinstance(result, str)]
    return first | {
        key: statistics.median(result[key] for result in kept) for key in ("seconds_cold", "seconds_warm")
    }


def flight_miss(problem: OptimalControlProblem, result: dict[str, Any]) -> float | None:
    """The largest scaled error of the states at the end when the returned control is flown."""
    if result["miss"] is not None:
        return float(result["miss"])
    final_time = result["times"][-1]
    control_tau, state_tau = (np.array(result[key]) / final_time for key in ("times", "state_times"))
    starts = [interval[0] for interval in problem.initial_state]
    states = {}
    for name, start in zip(problem.states, starts, strict=True):
        values = np.array(result["states"][name])
        values[0] = start if np.isfinite(start) else values[0]
        states[name] = LinearCurve(state_tau, values)
    trajectory = Trajectory(
        t0=0.0,
        tf=final_time,
        states=states,
        controls={
            name: LinearCurve(control_tau, np.array(result["controls"][name])) for name in problem.controls
        },
        interpolation="linear",
        basis={},
        breakpoints=np.unique(np.concatenate([[0.0], control_tau, [1.0]])),
        nodes=state_tau,
    )
    return verify(problem, trajectory, Tolerances(), time.monotonic() + FLIGHT_LIMIT).terminal_error


def check_same(case: str, problem: OptimalControlProblem) -> None:
    """Refuse to compare where the peers would be given another problem than ondelette."""
    theirs = problems.load(case)
    generator = np.random.default_rng(1)
    states, controls = (generator.uniform(0.5, 1.0, len(names)) for names in (theirs.states, theirs.controls))
    scope = problem.scope(states, controls, 0.0, problem.parameters, NUMPY)
    fractions = np.linspace(0, 1, 7)
    names = (*theirs.states, *theirs.controls)
    pairs = (
        (theirs.rates(list(states), list(controls), np), problem.dynamics.rate(scope, NUMPY)),
        ([theirs.bounds[name] for name in names], [*problem.state_bounds, *problem.control_bounds]),
        (theirs.final_time, problem.final_time),
        (theirs.guess_time, problem.guess.tf),
        (
            [[theirs.guess(name, tau) for tau in fractions] for name in names],
            [*problem.guess.states_at(fractions), *problem.guess.controls_at(fractions)],
        ),
    )
    for mine, own in pairs:
        np.testing.assert_allclose(np.array(mine, float), np.array(own, float), rtol=1e-12, atol=1e-12)


def row(peer: Peer, result: dict[str, Any] | str, problem: OptimalControlProblem, context: dict) -> str:
    """One line of the table."""
    if isinstance(result, str):
        return f"| {peer.title} | | {result} | | | | | |"
    miss = flight_miss(problem, result)
    base = context.get("base") or result
    ratios = [result[key] / base[key] for key in ("seconds_cold", "seconds_warm")]
    return (
        f"| {peer.title} {result['version']} | {result['mesh']} | {'yes' if result['success'] else 'no'} "
        f"| {result['seconds_cold']:.3f} ({ratios[0]:.1f}) | {result['seconds_warm']:.3f} ({ratios[1]:.1f}) "
        f"| {result['objective']:.9g} | {result['objective'] - context['reference']:+.1e} "
        f"| {'' if miss is None else f'{miss:.1e}'} |"
    )


def table(case: str, peers: list[Peer], points: int) -> None:
    """Print the table of one case, row by row."""
    document = load_case(case)
    problem = stated_problem(check_document(document).problem)
    check_same(case, problem)
    reference = document["reference"]["objective"]
    print(f"\n### {case}, N = {points}\n\nReference: {reference}\n")
    print("| | mesh | success? | cold, s (ratio) | warm, s (ratio) | objective | error | flight miss |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    context: dict[str, Any] = {"reference": reference}
    for peer in peers:
        result = timed_answer(peer, case, points)
        if peer is BASE and not isinstance(result, str):
            context["base"] = result
        print(row(peer, result, problem, context), flush=True)


def main() -> None:
    """Read the command line and print a table for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", default=ALL)
    parser.add_argument(
        "--peers", default="", help="rows by a part of their names, comma between; default all"
    )
    parser.add_argument("--points", type=int, default=POINTS)
    options = parser.parse_args()
    chosen = [part.strip().lower() for part in options.peers.split(",") if part.strip()]
    peers = [
        peer
        for peer in PEERS
        if not chosen or peer is BASE or any(part in peer.title.lower() for part in chosen)
    ]
    for case in options.cases:
        table(case, peers, options.points)


if __name__ == "__main__":
    main()
