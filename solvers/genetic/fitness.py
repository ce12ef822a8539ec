"""The fitness of individuals: objective plus penalties, for whole populations at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.kernel import Kernels
from solvers.arrays.structure import depends_on
from solvers.genetic.genome import Genome, Individuals
from solvers.genetic.model import ArrayModel
from solvers.genetic.simulation import Simulated, Simulator

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Evaluation:
    """For each of P individuals: ``objective``, end ``residual`` (2-norm), ``violation`` of anything else."""

    objective: Vector
    residual: Vector
    violation: Vector

    def fitness(self, penalty: float) -> Vector:
        """J + penalty (|r|^2 + violation); what is not finite is infinitely bad."""
        total = self.objective + penalty * (self.residual**2 + self.violation)
        return np.where(np.isfinite(total), total, np.inf)


class Fitness:
    """Evaluates genes (P, size). ``pause`` is called between blocks of individuals and may raise to stop."""

    def __init__(
        self,
        model: ArrayModel,
        genome: Genome,
        simulator: Simulator,
        penalty: float,
        pause: Callable[[], None] = lambda: None,
    ) -> None:
        self.genome, self._simulator = genome, simulator
        self._penalty, self._pause = penalty, pause
        self._inputs = [name for name in model.end_inputs if name in depends_on(model.ends)]
        self._ends = Kernels(model.ends, self._inputs)
        self._problem = model.problem
        table = genome.basis.values(genome.basis.levels)
        self._edges = table[:, [0, -1]]
        self.evaluations = 0

    def __call__(self, genes: Vector) -> Vector:
        """J + penalty (|r|^2 + violation), (P,)."""
        return self.evaluate(genes).fitness(self._penalty)

    def evaluate(self, genes: Vector) -> Evaluation:
        """Objective, residual and violation."""
        size = self._simulator.block
        blocks = []
        with np.errstate(all="ignore"):
            for start in range(0, genes.shape[0], size):
                self._pause()
                blocks.append(self._block(genes[start : start + size]))
        self.evaluations += genes.shape[0]
        if len(blocks) == 1:
            return blocks[0]
        return Evaluation(
            np.concatenate([block.objective for block in blocks]),
            np.concatenate([block.residual for block in blocks]),
            np.concatenate([block.violation for block in blocks]),
        )

    def _block(self, genes: Vector) -> Evaluation:
        individuals = self.genome.read(genes)
        simulated = self._simulator.simulate(individuals)
        kernel = self._ends.at(genes.shape[0])
        if self._inputs:
            values = self._at_the_ends(individuals, simulated)
            for name, row in zip(self._inputs, kernel.inputs, strict=True):
                row[:] = values[name]
        kernel.run()
        residuals = kernel.outputs[1:]
        return Evaluation(
            simulated.cost + kernel.outputs[0],
            np.sqrt(np.einsum("rp,rp->p", residuals, residuals)),
            simulated.violation + individuals.strayed,
        )

    def _at_the_ends(self, individuals: Individuals, simulated: Simulated) -> dict[str, Vector]:
        problem = self._problem
        values = {"t0": individuals.t0, "tf": individuals.tf}
        values |= {item.name: row for item, row in zip(problem.design, individuals.design, strict=True)}
        values |= {item.name: row for item, row in zip(problem.integrals, simulated.integrals, strict=True)}
        values |= {f"{name}_0": row for name, row in zip(problem.states, individuals.initial, strict=True)}
        values |= {f"{name}_f": row for name, row in zip(problem.states, simulated.final, strict=True)}
        for j, name in enumerate(problem.controls):
            for suffix, edge in zip(("_0", "_f"), self._edges.T, strict=True):
                if f"{name}{suffix}" in self._inputs:
                    values[f"{name}{suffix}"] = individuals.coefficients[:, j] @ edge
        return values
