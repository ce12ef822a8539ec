"""What every direct transcription shares: ends, bounds, path constraints, costs, scaling, costates.

A transcription says where its unknowns are, how states and controls follow from them (rows of constant
matrices), and how the dynamics become defects. The rest is common and written here once.
"""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.formulation.quantities import Interval
from solvers.problem import OptimalControlProblem
from solvers.program import NonlinearProgram
from solvers.start.scaling import magnitude
from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory
from solvers.transcription.assembly import Assembly, columns
from solvers.transcription.builder import Places, fixed
from solvers.transcription.nodes import Instants, NodeSymbols

Vector = NDArray[np.float64]


@dataclass
class Transcription(Assembly):
    """A problem on a mesh, to be solved from ``start``.

    ``program()`` builds the scaled program, ``trajectory(w)`` reads its solution.
    """

    @abstractmethod
    def allocate(self) -> None:
        """Append the blocks of states and controls to the builder, started from the guess."""

    @abstractmethod
    def constrain_dynamics(self) -> None:
        """Add the defects."""

    @abstractmethod
    def read(self, unknowns: Vector) -> Trajectory:
        """The trajectory that these unknowns (unscaled) stand for."""

    @property
    @abstractmethod
    def mesh(self) -> Hashable:
        """What of the mesh enters matrices: equal for transcriptions that may share a builder."""

    @property
    def key(self) -> Hashable:
        """Equal for transcriptions whose programs differ in numbers only; they may share a builder.

        Expressions, names, the mesh, which bounds there are, and the numbers that scale or enter matrices.
        """
        problem, scaling = self.problem, self.scaling
        ends = [*zip(problem.state_bounds, problem.initial_state, problem.final_state, strict=True)]
        # Bounds and ends of velocities are held by rows of their own, which differ where both sides meet.
        moving = [
            _sides((max(bounds[0], end[0]), min(bounds[1], end[1])))
            for bounds, *both in (ends[i] for i in self.per_tau)
            for end in both
        ]
        return (
            type(self).__name__,
            self.mesh,
            problem.structure,
            tuple(tuple(_sides(interval) for interval in intervals) for intervals in ends),
            tuple(moving),
            self.times_may_cross,
            scaling.numbers,
            tuple(magnitude(item.interval) for item in (*problem.path, *problem.boundary)),
            tuple(_sides(item) for item in (*problem.initial_control, *problem.final_control)),
        )

    def of(self, problem: OptimalControlProblem) -> Self:
        """The same transcription, with its builder, of a problem that differs in numbers only."""
        twin = copy.copy(self)
        twin.problem = problem
        return twin

    def program(self, initial: Vector | None = None) -> NonlinearProgram:
        """The scaled program, to be solved from the start, or from the scaled unknowns ``initial``."""
        if not self.builder.size:
            self._build()
        return self.builder.program(self, self.scaling.objective, initial)

    def _build(self) -> None:
        self.allocate()
        self.builder.unknowns(
            "times",
            (2, 1),
            scale=self.scaling.time,
            initial=lambda this: [[this.start.t0], [this.start.tf]],
            bounds=lambda this: columns([this.problem.initial_time, this.problem.final_time]),
        )
        self.allocate_scalars()
        self.constrain_dynamics()
        self.hold_states()
        self.hold_control_ends()
        self.order_times()
        self.add_ends()
        self.add_path()
        self.add_running_cost()
        self.add_integrals()

    def trajectory(self, scaled: Vector) -> Trajectory:
        """The trajectory of a (scaled) solution of the program."""
        unknowns = scaled * self.builder.scale
        return replace(self.read(unknowns), design=self.design(unknowns))

    @property
    def objective_scale(self) -> float:
        """What the objective of the program is multiplied by to give that of the document."""
        return self.scaling.objective

    def sketch(self, scaled: Vector, samples: int) -> dict[str, Any]:
        """The trajectory of (scaled) unknowns on a grid of so many samples."""
        trajectory = self.trajectory(scaled)
        return trajectory.sample(np.linspace(trajectory.t0, trajectory.tf, samples))

    def design(self, unknowns: Vector) -> dict[str, float]:
        """The design parameters of a solution (unscaled) by name."""
        return self._scalars(unknowns, "design")

    def integrals(self, scaled: Vector) -> dict[str, float]:
        """The integrals of a (scaled) solution by name."""
        return self._scalars(scaled * self.builder.scale, "integrals")

    def _scalars(self, unknowns: Vector, name: str) -> dict[str, float]:
        items, blocks = getattr(self.problem, name), self.builder.blocks[name]
        return {item.name: float(unknowns[block.start]) for item, block in zip(items, blocks, strict=True)}

    def weighted_problem(self, row_multipliers: Vector) -> OptimalControlProblem:
        """The problem with its integrals in the running cost, each times its multiplier."""
        if not self.problem.integrals:
            return self.problem
        places = self.builder.places["integrals"]
        adjoint = self.builder.adjoint(places, row_multipliers) * self.scaling.objective
        weights = self.quadrature_weights
        return self.problem.with_integrals_in_cost(
            adjoint.reshape(weights.size, -1).sum(axis=0) / weights.sum()
        )

    def costates(self, trajectory: Trajectory, row_multipliers: Vector) -> Vector:
        """Costates lambda = dJ*/dx, (n, K) at the nodes of the trajectory, from the row multipliers.

        The covector mapping that all methods share: a small change d of the rate at node k changes the
        optimum by the integral of lambda' d, that is w_k (tf - t0) lambda_k' d with the weight w_k of the
        node, and by (B' mu)_k (tf - t0) d through the defects; hence lambda_k = (B' mu)_k / w_k. For Gauss
        points this is the mapping of Benson et al. (2006).
        """
        adjoint = self.builder.adjoint(self.builder.places["rates"], row_multipliers) * self.scaling.objective
        weights = self.quadrature_weights
        return self.spread(adjoint.reshape(weights.size, -1).T / weights)

    def spread(self, costates: Vector) -> Vector:
        """Costates at the nodes of the trajectory from those where the dynamics are evaluated."""
        return costates

    def apply_rate(self, instants: Instants, count: int | None = None) -> Places:
        """Evaluate (tb - ta) f(x, u, t) at these instants: n values a place, or the first ``count``."""
        symbols = NodeSymbols(self.problem, self.per_tau)
        rate = self.problem.rate(symbols.x, symbols.u, symbols.t, symbols.parameters, CASADI)
        return self.apply(
            symbols.function("rate", [symbols.duration * value for value in rate[:count]]), instants
        )

    def add_defects(
        self, states: Sequence[sparse.csr_array], places: Places, rates: sparse.csr_array
    ) -> None:
        """Add the defects  states_i w + rates (tb - ta) f_i = 0  of every state i.

        ``states``: R x unknowns for each state; ``rates``: R x K for the K places of :meth:`apply_rate`.
        """
        self.builder.places["rates"] = places
        n, count = len(states), states[0].shape[0]
        order = np.arange(n * count).reshape(n, count).T.ravel()
        self.builder.constrain(
            fixed(0.0, 0.0),
            scale=np.tile(self.scaling.states[:n], count),
            linear=sparse.csr_array(sparse.vstack(states, format="csr")[order]),
            places=places,
            scatter=sparse.kron(rates, sparse.eye_array(n), format="csr"),
        )


def _sides(interval: Interval) -> tuple[bool, bool, bool]:
    """Which sides are bounded, and whether they meet."""
    return bool(np.isfinite(interval[0])), bool(np.isfinite(interval[1])), interval[0] == interval[1]


def control_columns(this: Transcription) -> tuple[Vector, Vector]:
    """Bounds of the controls, each (m, 1): for unknowns that are values of the controls."""
    return columns(this.problem.control_bounds)
