"""What every direct transcription shares: ends, bounds, path constraints, costs, scaling, costates.

A transcription says where its unknowns are, how states and controls follow from them (rows of constant
matrices), and how the dynamics become defects. The rest is common and written here once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.guess import Start
from solvers.problem import Constraint, Interval, OptimalControlProblem
from solvers.program import NonlinearProgram
from solvers.scaling import Scaling, magnitude
from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory
from solvers.transcription.builder import Intervals, Places, ProgramBuilder, fixed
from solvers.transcription.nodes import Instants, NodeSymbols

Vector = NDArray[np.float64]


@dataclass
class Transcription(ABC):
    """A problem on a mesh, to be solved from ``start``.

    ``program()`` builds the scaled program, ``trajectory(w)`` reads its solution. What enters the builder as
    a function of the transcription (``this``) must not use numbers of the transcription that builds.
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
        moving = [
            (problem.state_bounds[i], problem.initial_state[i], problem.final_state[i]) for i in self.per_tau
        ]
        ends = zip(problem.state_bounds, problem.initial_state, problem.final_state, strict=True)
        return (
            type(self).__name__,
            self.mesh,
            problem.structure,
            tuple(tuple(_sides(interval) for interval in intervals) for intervals in ends),
            tuple(moving),
            self._times_may_cross,
            (*scaling.states, *scaling.controls, scaling.time, scaling.objective),
            tuple(magnitude(item.interval) for item in (*problem.path, *problem.boundary)),
        )

    def program(self) -> NonlinearProgram:
        """The scaled program."""
        if not self.builder.size:
            self._build()
        return self.builder.program(self, self.scaling.objective)

    def _build(self) -> None:
        self.allocate()
        self.builder.unknowns(
            "times",
            (2, 1),
            scale=self.scaling.time,
            initial=lambda this: [[this.start.t0], [this.start.tf]],
            bounds=lambda this: _columns([this.problem.initial_time, this.problem.final_time]),
        )
        self.constrain_dynamics()
        self._hold_states()
        self._order_times()
        self._add_ends()
        self._add_path()
        self._add_running_cost()

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
        adjoint = self.builder.adjoint(self.builder.places["rates"], row_multipliers) * self.scaling.objective
        _, weights = self.quadrature()
        return self.spread(adjoint.reshape(weights.size, -1).T / weights)

    def spread(self, costates: Vector) -> Vector:
        """Costates at the nodes of the trajectory from those where the dynamics are evaluated."""
        return costates

    def apply(
        self, function: ca.Function, instants: Instants, extra: Sequence[sparse.csr_array] = ()
    ) -> Places:
        """Apply a function of :class:`NodeSymbols` at these instants."""
        span = instants.span or self.span(instants.tau.size)
        blocks = [*instants.states, *extra, *instants.controls, *span]
        tau = instants.tau

        def numbers(this: Transcription) -> Vector:
            parameters = np.array(list(this.problem.parameters.values()), np.float64)
            return np.vstack([tau, np.tile(parameters[:, None], (1, tau.size))])

        return self.builder.apply(function, blocks, numbers)

    def span(self, count: int) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Rows of t0 and of tf, ``count`` times each."""
        ones = sparse.csr_array(np.ones((count, 1)))
        t0, tf = (self.builder.rows_of(block, ones) for block in self.builder.blocks["times"])
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
        self.builder.places["rates"] = places
        n, count = len(states), states[0].shape[0]
        order = np.arange(n * count).reshape(n, count).T.ravel()
        self.builder.constrain(
            fixed(0.0, 0.0),
            scale=np.tile(self.scaling.states, count),
            linear=sparse.csr_array(sparse.vstack(states, format="csr")[order]),
            places=places,
            scatter=sparse.kron(rates, sparse.eye_array(n), format="csr"),
        )

    def _hold_states(self) -> None:
        nodes = self.nodes()
        count = nodes.tau.size
        t0, tf = self.span(count)
        for i, rows in enumerate(nodes.states):
            if i in self.per_tau:
                lower, upper = self.state_bounds(i, count)
                self._hold_slopes(rows, tf - t0, lower, upper, self.scaling.states[i] * self.scaling.time)
            else:
                self.builder.hold(self, rows, _bounds_of_state(i, count), scale=self.scaling.states[i])

    def state_bounds(self, index: int, count: int) -> tuple[Vector, Vector]:
        """Bounds of a state at ``count`` nodes, of which the first and the last meet the end conditions."""
        problem = self.problem
        lower, upper = (np.full(count, bound) for bound in problem.state_bounds[index])
        for node, end in ((0, problem.initial_state[index]), (-1, problem.final_state[index])):
            lower[node], upper[node] = max(lower[node], end[0]), min(upper[node], end[1])
        return lower, upper

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
            self.builder.constrain(fixed(*limits), scale=scale, linear=linear)

    @property
    def _times_may_cross(self) -> bool:
        return self.problem.final_time[0] <= self.problem.initial_time[1]

    def _order_times(self) -> None:
        if self._times_may_cross:
            t0, tf = self.span(1)
            self.builder.constrain(fixed(0.0, np.inf), scale=self.scaling.time, linear=tf - t0)

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
            CASADI,
        )
        expressions = [item.expression for item in problem.boundary]
        if problem.terminal_cost is not None:
            expressions.append(problem.terminal_cost)
        values = [ca.SX(expression.evaluate(scope, CASADI.functions)) for expression in expressions]
        blocks = [rows[[side]] for side in (0, -1) for rows in (*nodes.states, *nodes.controls)]
        blocks += self.span(1)
        function = ca.Function("ends", [z, p], [ca.vertcat(*values)])
        places = self.builder.apply(
            function, blocks, lambda this: np.array([*this.problem.parameters.values()]).reshape(-1, 1)
        )
        self._constrain_expressions(
            places, problem.boundary, 1, lambda this: _tiled(this.problem.boundary, 1)
        )
        if problem.terminal_cost is not None:
            self.builder.cost(places, np.eye(len(values))[-1])

    def _add_path(self) -> None:
        if self.problem.path:
            instants = self.path_instants()
            count = instants.tau.size
            self.hold_path(instants, lambda this: this.path_bounds(count))

    def hold_path(self, instants: Instants, bounds: Intervals) -> None:
        """Hold the path constraints at these instants within ``bounds``, instant by instant."""
        problem, symbols = self.problem, NodeSymbols(self.problem, self.per_tau)
        values = [item.expression.evaluate(symbols.scope, CASADI.functions) for item in problem.path]
        places = self.apply(symbols.function("path", values), instants)
        self._constrain_expressions(places, problem.path, instants.tau.size, bounds)

    def path_bounds(self, count: int) -> tuple[Vector, Vector]:
        """Bounds of the path constraints at ``count`` instants, (count constraints,), instant by instant."""
        return _tiled(self.problem.path, count)

    def _constrain_expressions(
        self,
        places: Places,
        constraints: Sequence[Constraint],
        count: int,
        bounds: Intervals,
    ) -> None:
        """Hold the leading values of each of ``count`` places within ``bounds``, place after place."""
        if not constraints:
            return
        per_place = places.values // count
        index = (np.arange(count)[:, None] * per_place + np.arange(len(constraints))).ravel()
        self.builder.constrain(
            bounds,
            scale=np.tile([magnitude(item.interval) for item in constraints], count),
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


def _bounds_of_state(index: int, count: int) -> Intervals:
    return lambda this: this.state_bounds(index, count)


def _sides(interval: Interval) -> tuple[bool, bool, bool]:
    """Which sides are bounded, and whether they meet."""
    return bool(np.isfinite(interval[0])), bool(np.isfinite(interval[1])), interval[0] == interval[1]


def _columns(intervals: Sequence[Interval]) -> tuple[Vector, Vector]:
    """Lower and upper ends of n intervals, each (n, 1)."""
    both = np.array(intervals, np.float64).reshape(-1, 2)
    return both[:, :1], both[:, 1:]


def control_columns(this: Transcription) -> tuple[Vector, Vector]:
    """Bounds of the controls, each (m, 1): for unknowns that are values of the controls."""
    return _columns(this.problem.control_bounds)


def _tiled(constraints: Sequence[Constraint], count: int) -> tuple[Vector, Vector]:
    intervals = np.array([item.interval for item in constraints], np.float64)
    both = np.tile(intervals.reshape(-1, 2), (count, 1))
    return both[:, 0], both[:, 1]
