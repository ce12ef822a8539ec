"""The fitness of individuals: objective plus penalties, for whole populations at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.kernel import Kernels
from solvers.arrays.structure import depends_on
from solvers.genetic.genome import Genome, Individuals
from solvers.genetic.model import ArrayModel
from solvers.genetic.simulation import Simulated, Simulator

Vector = NDArray[np.float64]
_Reader = Callable[[Individuals, Simulated], Vector]


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
        self.genome, self.simulator = genome, simulator
        self._penalty, self._pause = penalty, pause
        self._inputs = [name for name in model.end_inputs if name in depends_on(model.ends)]
        self._ends = Kernels(model.ends, self._inputs)
        self._readers = [self._reader(name) for name in self._inputs]
        self.evaluations = 0

    def __call__(self, genes: Vector) -> Vector:
        """J + penalty (|r|^2 + violation), (P,)."""
        return self.evaluate(genes).fitness(self._penalty)

    def evaluate(self, genes: Vector) -> Evaluation:
        """Objective, residual and violation."""
        size = self.simulator.block
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
        return self.judge(individuals, self.simulator.simulate(individuals))

    def judge(self, individuals: Individuals, simulated: Simulated) -> Evaluation:
        """Objective, residual and violation of what was simulated."""
        kernel = self._ends.at(individuals.tf.size)
        for read, row in zip(self._readers, kernel.inputs, strict=True):
            row[:] = read(individuals, simulated)
        kernel.run()
        residuals = kernel.outputs[1:]
        return Evaluation(
            simulated.cost + kernel.outputs[0],
            np.sqrt(np.einsum("rp,rp->p", residuals, residuals)),
            simulated.violation + individuals.strayed,
        )

    def _reader(self, name: str) -> _Reader:
        """What gives an input of the ends, (P,)."""
        problem = self.genome.problem
        readers: dict[str, _Reader] = {
            "t0": lambda individuals, _: individuals.t0,
            "tf": lambda individuals, _: individuals.tf,
        }
        readers |= {item.name: _given("design", i) for i, item in enumerate(problem.design)}
        readers |= {item.name: _reached("integrals", i) for i, item in enumerate(problem.integrals)}
        for i, state in enumerate(problem.states):
            readers |= {f"{state}_0": _given("initial", i), f"{state}_f": _reached("final", i)}
        for j, control in enumerate(problem.controls):
            readers |= {f"{control}_0": self._control(j, 0), f"{control}_f": self._control(j, -1)}
        return readers[name]

    def _control(self, index: int, edge: int) -> _Reader:
        """A control at the first (0) or last (-1) point."""
        return lambda individuals, _: individuals.coefficients[:, index] @ self._edges[:, edge]

    @cached_property
    def _edges(self) -> Vector:
        """Every function at points of which the first and the last one are the ends of time."""
        basis = self.genome.basis
        return basis.values(basis.levels)


def _given(field: str, row: int) -> _Reader:
    return lambda individuals, _: getattr(individuals, field)[row]


def _reached(field: str, row: int) -> _Reader:
    return lambda _, simulated: getattr(simulated, field)[row]
