"""What every direct transcription shares: ends, bounds, path constraints, costs; scaling; local variables.

A transcription says where its unknowns are, how states and controls follow from them (rows of constant
matrices), and how the dynamics become defects. The rest is common and written here once.

The local variables of a node are z = (x, u, ta, tb), where [ta, tb] is the span of time on which its tau
counts from 0 to 1: all of [t0, tf], or an arc of it. States in ``per_tau`` stand in z as derivatives with
respect to tau and are divided by the duration before the model sees them. The numbers of a node are
P = (tau, parameters).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.guess import Start
from solvers.problem import Constraint, Interval, OptimalControlProblem
from solvers.program import NonlinearProgram
from solvers.scaling import Scaling
from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory
from solvers.transcription.builder import Places, ProgramBuilder

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Instants:
    """K instants, and the rows (K x unknowns) that give each state and control there.

    ``tau`` counts from 0 to 1 over a span of time; ``span``: the rows of its start and end, by default those
    of t0 and tf.
    """

    tau: Vector
    states: Sequence[sparse.csr_array]
    controls: Sequence[sparse.csr_array] = ()
    span: tuple[sparse.csr_array, sparse.csr_array] | None = None


class NodeSymbols:
    """SX symbols of one node, as the model wants them."""

    def __init__(
        self, problem: OptimalControlProblem, per_tau: Collection[int] = (), accelerations: int = 0
    ) -> None:
        n, m = len(problem.states), len(problem.controls)
        self.z = ca.SX.sym("z", n + accelerations + m + 2)
        self.p = ca.SX.sym("p", 1 + len(problem.parameters))
        parts = ca.vertsplit(self.z)
        start, stop = parts[-2:]
        self.duration = stop - start
        self.x = [part / self.duration if i in per_tau else part for i, part in enumerate(parts[:n])]
        self.accelerations = [part / self.duration**2 for part in parts[n : n + accelerations]]
        self.u = parts[n + accelerations : -2]
        self.t = start + self.p[0] * self.duration
        self.parameters = dict(zip(problem.parameters, ca.vertsplit(self.p)[1:], strict=True))
        self.scope: dict[str, Any] = problem.scope(self.x, self.u, self.t, self.parameters)

    def function(self, name: str, values: Sequence[Any]) -> ca.Function:
        """The Function (z, p) -> values."""
        return ca.Function(name, [self.z, self.p], [ca.vertcat(*[ca.SX(value) for value in values])])


@dataclass
class Transcription(ABC):
    """A problem on a mesh, to be solved from ``start``.

    ``program()`` builds the scaled program, ``trajectory(w)`` reads its solution.
    """

    problem: OptimalControlProblem
    scaling: Scaling
    start: Start
    builder: ProgramBuilder = field(default_factory=ProgramBuilder, init=False)

    @property
    def per_tau(self) -> Collection[int]:
        """Indices of states that the unknowns give as derivatives with respect to tau."""
        return ()

    @abstractmethod
    def allocate(self) -> None:
        """Append the blocks of states and controls to the builder, started from the guess."""

    @abstractmethod
    def constrain_dynamics(self) -> None:
        """Add the defects."""

    @abstractmethod
    def nodes(self) -> Instants:
        """Where bounds of states hold: first the initial instant, last the final one."""

    @abstractmethod
    def path_instants(self) -> Instants:
        """Where path constraints hold."""

    @abstractmethod
    def quadrature(self) -> tuple[Instants, Vector]:
        """Instants and weights (for an integral over tau in [0, 1]) of the running cost."""

    @abstractmethod
    def read(self, unknowns: Vector) -> Trajectory:
        """The trajectory that these unknowns (unscaled) stand for."""

    def program(self) -> NonlinearProgram:
        """Build the scaled program."""
        problem, builder = self.problem, self.builder
        self.allocate()
        times = self.start.t0, self.start.tf
        bounds = problem.initial_time, problem.final_time
        self.times = [
            builder.unknowns(np.array([time]), scale=self.scaling.time, lower=lower, upper=upper)
            for time, (lower, upper) in zip(times, bounds, strict=True)
        ]
        self.constrain_dynamics()
        self._hold_states()
        self._order_times()
        self._add_ends()
        self._add_path()
        self._add_running_cost()
        return builder.program(self.scaling.objective)

    def trajectory(self, scaled: Vector) -> Trajectory:
        """The trajectory of a (scaled) solution of the program."""
        return self.read(scaled * self.builder.scale)

    def costates(self, trajectory: Trajectory, row_multipliers: Vector) -> Vector:
        """Costates lambda = dJ*/dx, (n, K) at the nodes of the trajectory, from the row multipliers.

        The covector mapping that all methods share: a small change d of the rate at node k changes the
        optimum by the integral of lambda' d, that is w_k (tf - t0) lambda_k' d with the weight w_k of the
        node, and by (B' mu)_k (tf - t0) d through the defects; hence lambda_k = (B' mu)_k / w_k. For Gauss
        points this is the mapping of Benson et al. (2006).
        """
        adjoint = self.builder.adjoint(self._rates, row_multipliers) * self.scaling.objective
        _, weights = self.quadrature()
        return self.spread(adjoint.reshape(weights.size, -1).T / weights)

    def spread(self, costates: Vector) -> Vector:
        """Costates at the nodes of the trajectory from those where the dynamics are evaluated."""
        return costates

    def apply(
        self, function: ca.Function, instants: Instants, extra: Sequence[sparse.csr_array] = ()
    ) -> Places:
        """Apply a function of :class:`NodeSymbols` at these instants."""
        count = instants.tau.size
        span = instants.span or self.span(count)
        numbers = np.vstack([instants.tau, np.tile(list(self.problem.parameters.values()), (count, 1)).T])
        blocks = [*instants.states, *extra, *instants.controls, *span]
        return self.builder.apply(function, blocks, numbers)

    def span(self, count: int) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Rows of t0 and of tf, ``count`` times each."""
        ones = sparse.csr_array(np.ones((count, 1)))
        t0, tf = (self.builder.rows_of(block, ones) for block in self.times)
        return t0, tf

    def apply_rate(self, instants: Instants) -> Places:
        """Evaluate (tb - ta) f(x, u, t) at these instants: n values a place."""
        symbols = NodeSymbols(self.problem, self.per_tau)
        rate = self.problem.rate(symbols.x, symbols.u, symbols.t, symbols.parameters, CASADI)
        return self.apply(symbols.function("rate", [symbols.duration * value for value in rate]), instants)

    def add_defects(
        self, states: Sequence[sparse.csr_array], places: Places, rates: sparse.csr_array
    ) -> None:
        """Add the defects  states_i w + rates (tb - ta) f_i = 0  of every state i.

        ``states``: R x unknowns for each state; ``rates``: R x K for the K places of :meth:`apply_rate`.
        """
        self._rates = places
        n, count = len(states), states[0].shape[0]
        order = np.arange(n * count).reshape(n, count).T.ravel()
        self.builder.constrain(
            0.0,
            0.0,
            scale=np.tile(self.scaling.states, count),
            linear=sparse.csr_array(sparse.vstack(states, format="csr")[order]),
            places=places,
            scatter=sparse.kron(rates, sparse.eye_array(n), format="csr"),
        )

    def _hold_states(self) -> None:
        nodes = self.nodes()
        problem = self.problem
        t0, tf = self.span(nodes.tau.size)
        for i, rows in enumerate(nodes.states):
            lower, upper = (np.full(nodes.tau.size, bound) for bound in problem.state_bounds[i])
            for index, end in ((0, problem.initial_state[i]), (-1, problem.final_state[i])):
                lower[index], upper[index] = max(lower[index], end[0]), min(upper[index], end[1])
            if i in self.per_tau:
                self._hold_slopes(rows, tf - t0, lower, upper, self.scaling.states[i] * self.scaling.time)
            else:
                self.builder.hold(rows, lower, upper, scale=self.scaling.states[i])

    def _hold_slopes(
        self, rows: sparse.csr_array, duration: sparse.csr_array, lower: Vector, upper: Vector, scale: float
    ) -> None:
        """Hold rows w / (tf - t0) within bounds, which is linear in the unknowns."""
        equal = lower == upper
        for side, wanted, limits in (
            (lower, equal, (0.0, 0.0)),
            (lower, np.isfinite(lower) & ~equal, (0.0, np.inf)),
            (upper, np.isfinite(upper) & ~equal, (-np.inf, 0.0)),
        ):
            linear = rows[wanted] - sparse.diags_array(side[wanted]) @ duration[wanted]
            self.builder.constrain(*limits, scale=scale, linear=linear)

    def _order_times(self) -> None:
        if self.problem.final_time[0] <= self.problem.initial_time[1]:
            t0, tf = self.span(1)
            self.builder.constrain(0.0, np.inf, scale=self.scaling.time, linear=tf - t0)

    def _add_ends(self) -> None:
        problem = self.problem
        if problem.terminal_cost is None and not problem.boundary:
            return
        nodes = self.nodes()
        n, m = len(problem.states), len(problem.controls)
        z = ca.SX.sym("z", 2 * (n + m) + 2)
        p = ca.SX.sym("p", len(problem.parameters))
        parts = ca.vertsplit(z)
        duration = parts[-1] - parts[-2]
        sides = []
        for start in (0, n + m):
            x = [
                part / duration if i in self.per_tau else part
                for i, part in enumerate(parts[start : start + n])
            ]
            sides.append((x, parts[start + n : start + n + m]))
        scope = problem.ends_scope(
            (*sides[0], parts[-2]),
            (*sides[1], parts[-1]),
            dict(zip(problem.parameters, ca.vertsplit(p), strict=True)),
        )
        expressions = [item.expression for item in problem.boundary]
        if problem.terminal_cost is not None:
            expressions.append(problem.terminal_cost)
        values = [ca.SX(expression.evaluate(scope, CASADI.functions)) for expression in expressions]
        blocks = [rows[[side]] for side in (0, -1) for rows in (*nodes.states, *nodes.controls)]
        blocks += self.span(1)
        numbers = np.array(list(problem.parameters.values())).reshape(-1, 1)
        places = self.builder.apply(ca.Function("ends", [z, p], [ca.vertcat(*values)]), blocks, numbers)
        self._constrain_expressions(places, problem.boundary, 1)
        if problem.terminal_cost is not None:
            self.builder.cost(places, np.eye(len(values))[-1])

    def _add_path(self) -> None:
        problem = self.problem
        if not problem.path:
            return
        symbols = NodeSymbols(problem, self.per_tau)
        values = [item.expression.evaluate(symbols.scope, CASADI.functions) for item in problem.path]
        instants = self.path_instants()
        places = self.apply(symbols.function("path", values), instants)
        self._constrain_expressions(places, problem.path, instants.tau.size)

    def _constrain_expressions(self, places: Places, constraints: Sequence[Constraint], count: int) -> None:
        """Hold the leading values of each of ``count`` places within the intervals of the constraints."""
        if not constraints:
            return
        per_place = places.values // count
        index = (np.arange(count)[:, None] * per_place + np.arange(len(constraints))).ravel()
        self.builder.constrain(
            np.tile([item.interval[0] for item in constraints], count),
            np.tile([item.interval[1] for item in constraints], count),
            scale=np.tile([_magnitude(item.interval) for item in constraints], count),
            places=places,
            scatter=sparse.csr_array(sparse.eye_array(places.values, format="csr")[index]),
        )

    def _add_running_cost(self) -> None:
        problem = self.problem
        if problem.running_cost is None:
            return
        symbols = NodeSymbols(problem, self.per_tau)
        cost = problem.running_cost.evaluate(symbols.scope, CASADI.functions)
        instants, weights = self.quadrature()
        places = self.apply(symbols.function("running_cost", [symbols.duration * cost]), instants)
        self.builder.cost(places, weights)


def _magnitude(interval: Interval) -> float:
    finite = [abs(bound) for bound in interval if np.isfinite(bound)]
    return max(finite, default=0.0) or 1.0
