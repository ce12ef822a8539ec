"""The genetic algorithm on the solar array: what 20 seeds reach, and how fast populations are evaluated.

    .venv/bin/python benchmarks/genetic.py [seeds] [rates] [paper] [processes]

Prints the tables of docs/methods/genetic.md. Times are CPU seconds, the least of several repeats.
"""

from __future__ import annotations

import sys
import time
import timeit
from typing import Any

import numpy as np
from solar_array_optima import EXACT, PENALISED

from solvers.arrays import kernel
from solvers.arrays.compiled import CompiledKernel
from solvers.bases.daubechies import DaubechiesBasis
from solvers.catalogue import load_case
from solvers.formulation.stated import stated_problem
from solvers.genetic.fitness import Fitness
from solvers.genetic.genome import Genome
from solvers.genetic.model import ArrayModel
from solvers.genetic.quadrature import QuadratureSimulator, find_chains
from solvers.genetic.runge_kutta import RungeKuttaSimulator
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling

SEEDS = range(20)
KERNELS = {"NumPy": kernel.NumpyKernel, "numba": CompiledKernel}


def use(name: str) -> None:
    """Let everything that is built from now on run on this kernel."""
    kernel.fastest_kernel = lambda: KERNELS[name]  # type: ignore[assignment]


def solved(case: str, **method: Any) -> dict[str, Any]:
    """The result of a case by the genetic algorithm."""
    document = load_case(f"solar_array_{case}") | {"method": {"name": "ga", **method}}
    result: dict[str, Any] = solve(check_document(document)).result()
    return result


def fitness_of(case: str, basis: DaubechiesBasis, level: int) -> Fitness:
    """The fitness of a case, on the points of a level."""
    problem = stated_problem(check_document(load_case(case)).problem)
    model = ArrayModel(problem)
    genome = Genome(problem, automatic_scaling(problem), basis, problem.guess)
    chains = find_chains(model) if genome.fixed else None
    simulator = (
        RungeKuttaSimulator(model, genome, level)
        if chains is None
        else QuadratureSimulator(model, genome, chains, level)
    )
    return Fitness(model, genome, simulator, 100.0)


def seeds() -> None:
    """What is reached from 20 seeds, relative to the optimum in the basis."""
    print("\n| variant | case | genes | what | minimum | median | maximum | optimum | evaluations (median) |")
    print("|---|---|---|---|---|---|---|---|---|")
    for case in ("1", "2neg", "2"):
        runs = [
            solved(case, variant="classic", polish=False, wavelet_levels=1, seed=seed)["fitness_history"]
            for seed in SEEDS
        ]
        for genes, values in ((15, [run[2000] for run in runs]), (30, [run[-1] for run in runs])):
            _row("classic", case, genes, "J + 100 r^2", values, PENALISED[case, genes // 15 - 1], 0)
    for (case, levels), optimum in EXACT.items():
        for polish, what in ((False, "J + 100 r^2"), ("penalty", "J + 100 r^2"), ("exact", "J")):
            runs = [solved(case, polish=polish, wavelet_levels=levels, seed=seed) for seed in SEEDS]
            if polish == "exact":
                values = [run["energy"] for run in runs]
            else:
                values = [run["energy"] + 100 * run["residual"] ** 2 for run in runs]
                optimum = PENALISED[case, levels]
            spent = 48 * float(np.median([len(run["fitness_history"]) for run in runs]))
            _row(f"modern, polish {polish}", case, 15 * (levels + 1), what, values, optimum, spent)
            optimum = EXACT[case, levels]


def _row(
    variant: str, case: str, genes: int, what: str, values: list[float], optimum: float, spent: float
) -> None:
    middle = np.median(values)
    columns = [f"{value:.6f}" for value in (min(values), middle, max(values), optimum)]
    spent_text = f"{spent:,.0f}" if spent else "105,600"
    print(f"| {variant} | {case} | {genes} | {what} | {' | '.join(columns)} | {spent_text} |", flush=True)


def rates() -> None:
    """Evaluations a second on one core."""
    print("\n| model | way | kernel | population | evaluations/s |")
    print("|---|---|---|---|---|")
    ways = (
        ("solar_array_2", DaubechiesBasis(2, 5), 4, "quadrature, 80 intervals, 15 genes"),
        ("solar_array_2", DaubechiesBasis(2, 5, 1), 4, "quadrature, 80 intervals, 30 genes"),
        ("flexible_spacecraft", DaubechiesBasis(2, 25), 3, "200 Runge-Kutta steps"),
    )
    for case, basis, level, way in ways:
        for name in KERNELS:
            use(name)
            fitness = fitness_of(case, basis, level)
            for population in (48, 1000):
                genes = np.random.default_rng(0).normal(size=(population, fitness.genome.size))
                fitness(genes)
                seconds = _least(lambda genes=genes, fitness=fitness: fitness(genes), 10 if level == 4 else 1)
                rate = population / seconds
                print(f"| {case} | {way} | {name} | {population} | {rate:,.0f} |", flush=True)
    for intervals, level in ((80, 4), (160, 5)):
        coarse, fine = (fitness_of("solar_array_2", DaubechiesBasis(2, 5), at) for at in (level, 9))
        individuals = coarse.genome.read(np.random.default_rng(0).normal(size=(300, 15)))
        ends = [part.simulator.simulate(individuals).final[0] for part in (coarse, fine)]
        print(f"\nLargest error of phi1, {intervals} intervals: {np.abs(ends[0] - ends[1]).max():.1e}")


def _least(function: Any, number: int) -> float:
    return min(timeit.repeat(function, number=number, repeat=30, timer=time.process_time)) / number


def paper() -> None:
    """A run of the paper's size, 2000 + 200 generations of 48: the search alone."""
    print("\n| kernel | CPU seconds |")
    print("|---|---|")
    for name in KERNELS:
        use(name)
        times = []
        for seed in range(5):
            started = time.process_time()
            solved("2neg", variant="classic", polish=False, wavelet_levels=1, seed=seed)
            times.append(time.process_time() - started)
        print(f"| {name} | {min(times):.2f} |", flush=True)


def processes() -> None:
    """Searches of one job, by one process and by two: seconds from document to result, the same answers."""
    ways = (
        ("solar_array_2", 1, {"wavelet_levels": 1}),
        ("solar_array_2", 8, {"variant": "classic"}),
        ("flexible_spacecraft", 2, {"variant": "classic", "scaling_functions": 25, "generations": 400}),
    )
    print("\n| case | variant | starts | runs | one process, s | two processes, s | ratio |")
    print("|---|---|---|---|---|---|---|")
    for case, starts, method in ways:
        times, answers = [], []
        for count in (1, 2):
            document = load_case(case) | {
                "method": {"name": "ga", "polish": False, "processes": count, **method},
                "options": {"starts": starts},
            }
            started = time.perf_counter()
            answers.append(solve(check_document(document)).result())
            times.append(time.perf_counter() - started)
        assert answers[0]["coefficients"] == answers[1]["coefficients"]
        runs, variant = len(answers[0]["starts"]), method.get("variant", "modern")
        ratio = times[0] / times[1]
        print(
            f"| {case} | {variant} | {starts} | {runs} | {times[0]:.2f} | {times[1]:.2f} | {ratio:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    parts = {"seeds": seeds, "rates": rates, "paper": paper, "processes": processes}
    for part in sys.argv[1:] or parts:
        parts[part]()
