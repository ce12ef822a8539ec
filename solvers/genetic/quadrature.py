"""States without integration, where the model allows it: linear in the coefficients, or integrals of these.

Two kinds of states are told from the graph of the rates alone:

- *chained*: the rate is linear in controls, with constant coefficients, and in chained states that do not
  depend on this one. Such a state is linear in the coefficients, with the iterated integrals of the basis
  functions as its response: exact tables.
- *integral*: the rate names chained states, controls and time only. Only its value at the end is wanted.

Integrals are by Simpson's rule on pairs of dyadic intervals, with the slopes of the parabolas through three
values of the integrated controls in place of the controls: where the rate is linear in these, that is the
integral along a path made of parabolas, whatever the corners of the functions. A running cost that is
quadratic in the controls and names nothing else comes from the coefficients alone, for the functions are
orthogonal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.graph import Symbol
from solvers.arrays.kernel import Kernels
from solvers.arrays.structure import affine, depends_on
from solvers.genetic.energy import energy_of
from solvers.genetic.genome import Genome, Individuals
from solvers.genetic.model import ArrayModel
from solvers.genetic.responses import end_responses, stacked, tabulate
from solvers.genetic.simulation import Simulated

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Chains:
    """``rates``: each chained state with its affine rate, in an order that can be followed; ``integrals``."""

    rates: Mapping[str, Mapping[str, float]]
    integrals: tuple[str, ...]


def find_chains(model: ArrayModel) -> Chains | None:
    """Sort the states into chained and integral ones; None where some are neither, or wanted on the way."""
    problem = model.problem
    rates = dict(zip(problem.states, model.rates, strict=True))
    known: dict[str, Mapping[str, float]] = {}
    allowed = set(problem.controls)
    while True:
        found = {
            name: slopes
            for name, rate in rates.items()
            if name not in known and depends_on([rate]) <= allowed and (slopes := affine(rate)) is not None
        }
        if not found:
            break
        known |= found
        allowed |= found.keys()
    integrals = tuple(name for name in problem.states if name not in known)
    along = [*(rates[name] for name in integrals), *model.integrands, model.running_cost, model.violation]
    if not depends_on(along) <= allowed | {"t", "tau"}:
        return None
    return Chains(known, integrals)


class QuadratureSimulator:
    """Final states by quadrature on the dyadic points of ``level``, where :func:`find_chains` finds a way.

    The genes must be coefficients only: initial state and times are given.
    """

    block = 48

    def __init__(self, model: ArrayModel, genome: Genome, chains: Chains, level: int) -> None:
        self._states, self._chains = model.problem.states, chains
        self._responses = tabulate(model.problem, genome, chains.rates, level)
        self._weights = _simpson(genome.basis.points(level).size)
        self._energy = energy_of(model, genome.basis)
        rates = dict(zip(model.problem.states, model.rates, strict=True))
        self._outputs: list[Symbol] = [*(rates[name] for name in chains.integrals), *model.integrands]
        self._quantities = len(model.integrands)
        self._outputs += [model.running_cost] if self._energy is None else []
        self._bounded = bool(depends_on([model.violation]))
        self._outputs += [model.violation] if self._bounded else []
        named = depends_on(self._outputs)
        inputs = [name for name in self._responses if name in named]
        self._tables = stacked([self._responses[name] for name in inputs])
        self._kernels = Kernels(self._outputs, inputs)
        places = {name: index for index, name in enumerate(self._states)}
        self._integral = [places[name] for name in chains.integrals]
        self._ends = self._final_responses(genome, [places[name] for name in chains.rates])

    def simulate(self, individuals: Individuals) -> Simulated:
        """See :class:`Simulator`."""
        coefficients = individuals.coefficients
        count = coefficients.shape[0]
        flat = coefficients.reshape(count, -1)
        duration = float(individuals.tf[0] - individuals.t0[0])
        integrals = self._integrate(flat, duration)
        final = self._ends[0] @ flat.T
        final += self._ends[1]
        first, stop = len(self._integral), len(self._integral) + self._quantities
        for row, change in zip(self._integral, integrals, strict=False):
            final[row] += change
        cost = integrals[stop] if self._energy is None else duration * self._energy(flat)
        violation = integrals[-1] / duration if self._bounded else np.zeros(count)
        return Simulated(final, cost, integrals[first:stop], violation)

    def end_equations(self, wanted: Mapping[str, float]) -> tuple[Vector, Vector]:
        """Matrix (K, m N) and right side (K,): where chained states end as wanted, by the coefficients."""
        names = [name for name in wanted if name in self._chains.rates]
        matrix, constants = end_responses(self._responses, names)
        return matrix, np.array([wanted[name] for name in names]) - constants

    def _final_responses(self, genome: Genome, chained: list[int]) -> tuple[Vector, Vector]:
        """Matrix (n, m N) and constants (n, 1): final states by the coefficients, less what integrals add."""
        matrix = np.zeros((len(self._states), genome.controls))
        constants = genome.resting.initial.copy()
        matrix[chained], constants[chained, 0] = end_responses(self._responses, list(self._chains.rates))
        return matrix, constants

    def _integrate(self, flat: Vector, duration: float) -> Vector:
        """Integrals over time of every output, (outputs, P)."""
        shape = self._weights.size, flat.shape[0]
        if not self._outputs:
            return np.zeros((0, shape[1]))
        kernel = self._kernels.at(shape[0] * shape[1])
        values, first = kernel.inputs.reshape(-1, *shape), 0
        for tables in self._tables:
            tables.fill(flat, values[first : first + tables.count])
            first += tables.count
        kernel.run()
        return np.asarray(duration * (self._weights @ kernel.outputs.reshape(-1, *shape)), np.float64)


def _simpson(points: int) -> Vector:
    """Weights of Simpson's rule over [0, 1] on pairs of intervals between an odd number of points."""
    weights = np.full(points, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    return weights / (3.0 * (points - 1))
