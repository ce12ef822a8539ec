"""States of a population by the classical Runge-Kutta method, all individuals side by side.

A step is a dyadic interval; the control on it is the parabola that has the function's values at its ends and
its exact integral. The running cost, and what bounds and path constraints do not allow, are integrated along.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.kernel import Kernels
from solvers.arrays.structure import depends_on
from solvers.genetic.energy import energy_of
from solvers.genetic.genome import Genome, Individuals
from solvers.genetic.model import ArrayModel
from solvers.genetic.simulation import Simulated

Vector = NDArray[np.float64]


class RungeKuttaSimulator:
    """Runge-Kutta steps on the dyadic intervals of ``level``.

    ``clipped``: controls are cut off at their bounds, as they will be flown.
    """

    block = 1024

    def __init__(self, model: ArrayModel, genome: Genome, level: int, *, clipped: bool = False) -> None:
        problem = model.problem
        self._states = len(problem.states)
        self._table = genome.basis.parabolas(level).T.copy()
        self._bounds = np.array(problem.control_bounds, np.float64).reshape(-1, 2, 1) if clipped else None
        self._bounded = bool(depends_on([model.violation]))
        self._energy = energy_of(model, genome.basis)
        self._design = len(model.design)
        self._integrals = len(model.integrands)
        outputs = [
            *model.rates,
            *model.integrands,
            *([model.running_cost] if self._energy is None else []),
            *([model.violation] if self._bounded else []),
        ]
        self._kernels = Kernels(outputs, model.inputs)

    def simulate(self, individuals: Individuals) -> Simulated:
        """See :class:`Simulator`."""
        return self._summed(deque(self._march(individuals), maxlen=1)[0], individuals)

    def fly(self, individuals: Individuals) -> tuple[Vector, Simulated]:
        """States at the ends of all steps, (n, P, steps + 1), and what :meth:`simulate` gives."""
        rows = np.stack([states.copy() for states in self._march(individuals)], axis=-1)
        return rows[: self._states], self._summed(rows[..., -1], individuals)

    def _summed(self, last: Vector, individuals: Individuals) -> Simulated:
        n, k, duration = self._states, self._integrals, individuals.tf - individuals.t0
        flat = individuals.coefficients.reshape(duration.size, -1)
        cost = last[n + k].copy() if self._energy is None else duration * self._energy(flat)
        violation = last[-1] / duration if self._bounded else np.zeros(duration.size)
        return Simulated(last[:n].copy(), cost, last[n : n + k].copy(), violation)

    def _march(self, individuals: Individuals) -> Iterator[Vector]:
        """States and integrals (n + extra, P) at the ends of all steps; the array is used again."""
        count = individuals.t0.size
        kernel = self._kernels.at(count)
        inputs, slopes = kernel.inputs, kernel.outputs
        n, rows = self._states, slopes.shape[0]
        states, controls, clock, tau = inputs[:n], inputs[n : -2 - self._design], inputs[-2], inputs[-1]
        inputs[-2 - self._design : -2] = individuals.design
        commands = self._commands(individuals.coefficients)
        duration = individuals.tf - individuals.t0
        steps = (commands.shape[0] - 1) // 2
        step = duration / steps
        half, sixth = step / 2.0, step / 6.0
        now = np.zeros((rows, count))
        now[:n] = individuals.initial
        total, part = np.empty((rows, count)), np.empty((n, count))
        yield now
        for k in range(steps):
            start = individuals.t0 + k * step
            states[:], controls[:], clock[:], tau[:] = now[:n], commands[2 * k], start, k / steps
            kernel.run()
            total[:] = slopes
            controls[:] = commands[2 * k + 1]
            clock[:], tau[:] = start + half, (k + 0.5) / steps
            for _ in range(2):
                np.multiply(slopes[:n], half, out=part)
                np.add(now[:n], part, out=states)
                kernel.run()
                total += slopes
                total += slopes
            controls[:] = commands[2 * k + 2]
            clock[:], tau[:] = start + step, (k + 1) / steps
            np.multiply(slopes[:n], step, out=part)
            np.add(now[:n], part, out=states)
            kernel.run()
            total += slopes
            total *= sixth
            now += total
            yield now

    def _commands(self, coefficients: Vector) -> Vector:
        """Controls at the ends and middles of all steps, (2 steps + 1, m, P)."""
        commands = np.einsum("kn,pjn->kjp", self._table, coefficients, optimize=True)
        if self._bounds is not None:
            commands = np.clip(commands, self._bounds[:, 0], self._bounds[:, 1])
        return np.ascontiguousarray(commands)
