"""What the genes of an individual stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.bases.daubechies import DaubechiesBasis
from solvers.formulation.quantities import Interval
from solvers.problem import OptimalControlProblem
from solvers.start.guess import Start
from solvers.start.scaling import Scaling

Vector = NDArray[np.float64]

# The level on which a guess is projected onto the functions.
_PROJECTION_LEVEL = 6


@dataclass(frozen=True)
class Individuals:
    """What P individuals stand for.

    ``coefficients`` (P, m, N) of the controls, ``initial`` states (n, P), ``design`` parameters (d, P), times
    ``t0`` and ``tf`` (P,); ``strayed`` (P,): the sum of the squares of how far the genes of anything but
    controls are beyond their bounds, in their own scale; the values themselves are kept within.
    """

    coefficients: Vector
    initial: Vector
    design: Vector
    t0: Vector
    tf: Vector
    strayed: Vector


class EndEquations(Protocol):
    """What knows final states that are linear in the coefficients."""

    def end_equations(self, wanted: Mapping[str, float]) -> tuple[Vector, Vector]:
        """Matrix (K, m N) and right side (K,): where such states end as wanted, by the coefficients."""
        ...


@dataclass(frozen=True, eq=False)
class Genome:
    """Genes in order: the coefficients of each control in turn, then what else is free.

    That is initial states, design parameters, initial and final time. A coefficient is its gene times the
    scale of the control; anything else differs from that of the start by its gene times its scale.
    """

    problem: OptimalControlProblem
    scaling: Scaling
    basis: DaubechiesBasis
    start: Start
    _kept: dict[int, tuple[Vector, Vector]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def controls(self) -> int:
        """How many of the genes are coefficients."""
        return len(self.problem.controls) * self.basis.size

    @property
    def size(self) -> int:
        """The number of genes."""
        return self.controls + len(self._free)

    @property
    def fixed(self) -> bool:
        """Whether all genes are coefficients: initial state, parameters and times are given."""
        return not self._free

    def first(self) -> Vector:
        """The genes of the start, (size,): its controls as near as the functions come."""
        level = max(_PROJECTION_LEVEL, self.basis.levels)
        points = np.linspace(0.0, 1.0, 2 * (self.basis.units << level) + 1)
        table = self.basis.parabolas(level)
        wanted = self.start.controls_at(points) / self.scaling.controls[:, None]
        coefficients = np.linalg.lstsq(table.T, wanted.T)[0].T
        return np.concatenate([coefficients.ravel(), np.zeros(len(self._free))])

    @property
    def resting(self) -> Individuals:
        """The individual (1 of it) whose controls are zero, everything else as in the start."""
        return self.read(np.zeros((1, self.size)))

    def read(self, genes: Vector) -> Individuals:
        """What genes (P, size) stand for."""
        count, scales = genes.shape[0], self.scaling.controls
        shape = (count, len(self.problem.controls), self.basis.size)
        coefficients = genes[:, : self.controls].reshape(shape) * scales[:, None]
        values, strayed = self._given(count) if self.fixed else self._moved(genes[:, self.controls :].T)
        n = len(self.problem.states)
        return Individuals(coefficients, values[:n], values[n:-2], values[-2], values[-1], strayed)

    def _given(self, count: int) -> tuple[Vector, Vector]:
        """What is given, for so many individuals, and no straying; the arrays are kept."""
        if count not in self._kept:
            self._kept[count] = np.repeat(self._values[:, None], count, axis=1), np.zeros(count)
        return self._kept[count]

    def _moved(self, genes: Vector) -> tuple[Vector, Vector]:
        """Values within their bounds, and how far their ``genes`` (free, P) stray, of so many individuals."""
        values = np.repeat(self._values[:, None], genes.shape[1], axis=1)
        strayed = np.zeros(genes.shape[1])
        for gene, (index, interval, scale) in zip(genes, self._free, strict=True):
            wanted = values[index] + scale * gene
            values[index] = np.clip(wanted, *interval)
            strayed += ((wanted - values[index]) / scale) ** 2
        return values, strayed

    def end_equations(self, simulator: EndEquations) -> tuple[Vector, Vector]:
        """Matrix (K, size) and right side (K,) of the end conditions that are linear in the genes.

        Raises ValueError where other genes than coefficients are free.
        """
        if not self.fixed:
            raise ValueError("end conditions are not linear in the genes of times and initial states")
        named = zip(self.problem.states, self.problem.final_state, strict=True)
        wanted = {name: interval[0] for name, interval in named if interval[0] == interval[1]}
        matrix, right = simulator.end_equations(wanted)
        scales = np.repeat(self.scaling.controls, self.basis.size)
        return np.asarray(matrix * scales, np.float64), right

    def extended(self, genes: Vector, finer: Genome) -> Vector:
        """The same individuals with the genes of a finer genome, whose wavelets have no part in them."""
        count, m = genes.shape[0], len(self.problem.controls)
        coefficients = np.zeros((count, m, finer.basis.size))
        coefficients[:, :, : self.basis.size] = genes[:, : self.controls].reshape(count, m, -1)
        rest = genes[:, self.controls :]
        return np.hstack([coefficients.reshape(count, -1), rest])

    @cached_property
    def _values(self) -> Vector:
        """Initial states, design parameters and both times of the start, each within its bounds."""
        states = self.start.states_at(np.zeros(1))[:, 0]
        design = [self.start.design.get(item.name, item.guess) for item in self.problem.design]
        intervals = np.array(self._intervals, np.float64)
        values = np.array([*states, *design, self.start.t0, self.start.tf])
        return np.asarray(np.clip(values, intervals[:, 0], intervals[:, 1]), np.float64)

    @property
    def _intervals(self) -> list[Interval]:
        problem = self.problem
        design = [item.interval for item in problem.design]
        return [*problem.initial_state, *design, problem.initial_time, problem.final_time]

    @cached_property
    def _free(self) -> list[tuple[int, Interval, float]]:
        """Index among the values, bounds and scale of each that is free."""
        span = 0.25 * (self._values[-1] - self._values[-2])
        scales = [*self.scaling.states, *self.scaling.design, span, span]
        return [
            (index, interval, float(scale))
            for index, (interval, scale) in enumerate(zip(self._intervals, scales, strict=True))
            if interval[0] < interval[1]
        ]
