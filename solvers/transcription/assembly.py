"""What of a program is the same for every transcription: ends, bounds, path constraints, costs, scalars.

A transcription gives the rows of states and controls where all this holds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.formulation.quantities import Constraint, Interval
from solvers.problem import OptimalControlProblem
from solvers.start.guess import Start
from solvers.start.scaling import Scaling, magnitude
from solvers.symbolic import CASADI
from solvers.transcription.builder import Intervals, Numbers, Places, ProgramBuilder, fixed
from solvers.transcription.nodes import Instants, NodeSymbols

Vector = NDArray[np.float64]


@dataclass
class Assembly(ABC):
    """A problem on a mesh, to be solved from ``start``, and what is added to its program.

    What enters the builder as a function of the transcription (``this``) must not use numbers of the
    transcription that builds.
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
    def nodes(self) -> Instants:
        """Where bounds of states hold: first the initial instant, last the final one."""

    @abstractmethod
    def path_instants(self) -> Instants:
        """Where path constraints hold."""

    @abstractmethod
    def quadrature(self) -> tuple[Instants, Vector]:
        """Instants and weights (for an integral over tau in [0, 1]) of the running cost."""

    @property
    def quadrature_weights(self) -> Vector:
        """The weights alone."""
        return self.quadrature()[1]

    def allocate_scalars(self) -> None:
        """Append the design parameters and the values of the integrals."""
        self.builder.unknowns(
            "design",
            (len(self.problem.design), 1),
            scale=self.scaling.design,
            initial=lambda this: [
                [this.start.design.get(item.name, item.guess)] for item in this.problem.design
            ],
            bounds=lambda this: columns([item.interval for item in this.problem.design]),
        )
        self.builder.unknowns(
            "integrals",
            (len(self.problem.integrals), 1),
            scale=self.scaling.integrals,
            initial=lambda this: this.problem.integrals_along(this.start)[:, None],
            bounds=lambda this: columns([item.interval for item in this.problem.integrals]),
        )

    def apply(
        self, function: ca.Function, instants: Instants, extra: Sequence[sparse.csr_array] = ()
    ) -> Places:
        """Apply a function of :class:`NodeSymbols` at these instants."""
        count = instants.tau.size
        start, stop = instants.span or self.span(count)
        duration = sparse.csr_array(stop - start)
        time = sparse.csr_array(start + sparse.diags_array(instants.tau) @ duration)
        design = self.scalar_rows("design", count)
        blocks = [*instants.states, *extra, *instants.controls, *design, time, duration]
        return self.builder.apply(function, blocks, lambda this: this.parameter_columns(count))

    def parameter_columns(self, count: int) -> Vector:
        """The parameters as a column for each of ``count`` places."""
        return np.tile(np.array([[*self.problem.parameters.values()]], np.float64).T, (1, count))

    def span(self, count: int) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Rows of t0 and of tf, ``count`` times each."""
        t0, tf = self.scalar_rows("times", count)
        return t0, tf

    def scalar_rows(self, name: str, count: int) -> list[sparse.csr_array]:
        """Rows of each of the scalars of a name, ``count`` times each."""
        ones = sparse.csr_array(np.ones((count, 1)))
        return [self.builder.rows_of(block, ones) for block in self.builder.blocks[name]]

    def hold_states(self) -> None:
        """Hold the states within their bounds at the nodes, and at both ends where they shall be there."""
        nodes = self.nodes()
        count = nodes.tau.size
        t0, tf = self.span(count)
        for i, rows in enumerate(nodes.states):
            if i in self.per_tau:
                self._hold_slopes(i, rows, sparse.csr_array(tf - t0))
            else:
                self.builder.hold(self, rows, _bounds_of_state(i, count), scale=self.scaling.states[i])

    def state_bounds(self, index: int, count: int) -> tuple[Vector, Vector]:
        """Bounds of a state at ``count`` nodes, of which the first and the last meet the end conditions."""
        problem = self.problem
        lower, upper = (np.full(count, bound) for bound in problem.state_bounds[index])
        for node, end in ((0, problem.initial_state[index]), (-1, problem.final_state[index])):
            lower[node], upper[node] = max(lower[node], end[0]), min(upper[node], end[1])
        return lower, upper

    def _hold_slopes(self, index: int, rows: sparse.csr_array, duration: sparse.csr_array) -> None:
        """Hold the state rows w / (tf - t0) within its bounds: rows w - bound (tf - t0) has one sign.

        The bounds are numbers of places, so that another end of a velocity is no other structure.
        """
        lower, upper = self.state_bounds(index, rows.shape[0])
        equal = lower == upper
        slope, bound = ca.SX.sym("z", 2), ca.SX.sym("p")
        room = ca.Function("room", [slope, bound], [slope[0] - bound * slope[1]])
        for side, wanted, limits in (
            (0, equal, (0.0, 0.0)),
            (0, np.isfinite(lower) & ~equal, (0.0, np.inf)),
            (1, np.isfinite(upper) & ~equal, (-np.inf, 0.0)),
        ):
            if wanted.any():
                numbers = _bounds_at(index, side, wanted)
                places = self.builder.apply(room, [rows[wanted], duration[wanted]], numbers)
                scale = self.scaling.states[index] * self.scaling.time
                self.builder.constrain(fixed(*limits), scale=scale, places=places)

    def hold_control_ends(self) -> None:
        """Hold controls within the bounds that they have at the very ends."""
        nodes = self.nodes()
        for node, key in ((0, "initial_control"), (-1, "final_control")):
            for j, interval in enumerate(getattr(self.problem, key)):
                if np.isfinite(interval).any():
                    self.builder.hold(
                        self,
                        nodes.controls[j][[node]],
                        _bounds_of_control(key, j),
                        scale=self.scaling.controls[j],
                    )

    @property
    def times_may_cross(self) -> bool:
        """Whether the bounds of the times alone allow a flight that ends before it begins."""
        return self.problem.final_time[0] <= self.problem.initial_time[1]

    def order_times(self) -> None:
        """Let the flight end after its begin."""
        if self.times_may_cross:
            t0, tf = self.span(1)
            self.builder.constrain(fixed(0.0, np.inf), scale=self.scaling.time, linear=tf - t0)

    def add_ends(self) -> None:
        """Add the boundary constraints and the terminal cost."""
        problem = self.problem
        if not problem.at_the_ends:
            return
        nodes = self.nodes()
        n, m = len(problem.states), len(problem.controls)
        scalars = len(problem.design) + len(problem.integrals)
        z = ca.SX.sym("z", 2 * (n + m) + scalars + 2)
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
        parameters = dict(zip(problem.parameters, ca.vertsplit(p), strict=True))
        scalar_parts = parts[2 * (n + m) : -2]
        parameters |= {item.name: scalar_parts[index] for index, item in enumerate(problem.design)}
        scope = problem.ends_scope(
            (*sides[0], parts[-2]),
            (*sides[1], parts[-1]),
            parameters,
            CASADI,
            scalar_parts[len(problem.design) :],
        )
        values = [ca.SX(item.evaluate(scope, CASADI.functions)) for item in problem.at_the_ends]
        blocks = [rows[[side]] for side in (0, -1) for rows in (*nodes.states, *nodes.controls)]
        blocks += [row for name in ("design", "integrals", "times") for row in self.scalar_rows(name, 1)]
        function = ca.Function("ends", [z, p], [ca.vertcat(*values)])
        places = self.builder.apply(function, blocks, lambda this: this.parameter_columns(1))
        self._constrain_expressions(
            places, problem.boundary, 1, lambda this: _tiled(this.problem.boundary, 1)
        )
        if problem.terminal_cost is not None:
            self.builder.cost(places, np.eye(len(values))[-1])

    def add_path(self) -> None:
        """Hold the path constraints where they live."""
        if self.problem.path:
            instants = self.path_instants()
            count = instants.tau.size
            self.hold_path(instants, lambda this: this.path_bounds(count))

    def hold_path(self, instants: Instants, bounds: Intervals) -> None:
        """Hold the path constraints at these instants within ``bounds``, instant by instant."""
        problem, symbols = self.problem, NodeSymbols(self.problem, self.per_tau)
        values = [item.expression.evaluate(symbols.scope, CASADI.functions) for item in problem.path]
        places = self.apply(symbols.function("path", values), instants)
        held = np.column_stack([item.holds_at(instants.tau) for item in problem.path])
        self._constrain_expressions(places, problem.path, instants.tau.size, bounds, held.ravel())

    def path_bounds(self, count: int) -> tuple[Vector, Vector]:
        """Bounds of the path constraints at ``count`` instants, (count constraints,), instant by instant."""
        return _tiled(self.problem.path, count)

    def _constrain_expressions(
        self,
        places: Places,
        constraints: Sequence[Constraint],
        count: int,
        bounds: Intervals,
        wanted: NDArray[np.bool_] | None = None,
    ) -> None:
        """Hold the leading values of each of ``count`` places within ``bounds``, place after place.

        ``wanted``: which of these values are held, by default all of them.
        """
        if not constraints:
            return
        per_place = places.values // count
        index = (np.arange(count)[:, None] * per_place + np.arange(len(constraints))).ravel()
        if wanted is None:
            wanted = np.ones(index.size, bool)
        self.builder.constrain(
            bounds,
            scale=np.tile([magnitude(item.interval) for item in constraints], count)[wanted],
            places=places,
            scatter=sparse.csr_array(sparse.eye_array(places.values, format="csr")[index[wanted]]),
            wanted=wanted,
        )

    def add_running_cost(self) -> None:
        """Add the integral of the running cost to the objective."""
        problem = self.problem
        if problem.running_cost is None:
            return
        symbols = NodeSymbols(problem, self.per_tau)
        cost = problem.running_cost.evaluate(symbols.scope, CASADI.functions)
        instants, weights = self.quadrature()
        places = self.apply(symbols.function("running_cost", [symbols.duration * cost]), instants)
        self.builder.cost(places, weights)

    def add_integrals(self) -> None:
        """The unknown of each integral is what its integrand adds up to over the places."""
        problem = self.problem
        if not problem.integrals:
            return
        symbols = NodeSymbols(problem, self.per_tau)
        values = [item.expression.evaluate(symbols.scope, CASADI.functions) for item in problem.integrals]
        instants, weights = self.quadrature()
        function = symbols.function("integrals", [symbols.duration * value for value in values])
        places = self.apply(function, instants)
        self.builder.places["integrals"] = places
        rows = self.scalar_rows("integrals", 1)
        self.builder.constrain(
            fixed(0.0, 0.0),
            scale=self.scaling.integrals,
            linear=sparse.csr_array(sparse.vstack(rows, format="csr")),
            places=places,
            scatter=-sparse.kron(weights[None, :], sparse.eye_array(len(values)), format="csr"),
        )


def _bounds_of_control(key: str, index: int) -> Intervals:
    return lambda this: getattr(this.problem, key)[index]


def _bounds_at(index: int, side: int, wanted: NDArray[np.bool_]) -> Numbers:
    """The lower or upper bounds of a state at the nodes that are wanted, (1, K)."""
    return lambda this: this.state_bounds(index, wanted.size)[side][None, wanted]


def _bounds_of_state(index: int, count: int) -> Intervals:
    return lambda this: this.state_bounds(index, count)


def columns(intervals: Sequence[Interval]) -> tuple[Vector, Vector]:
    """Lower and upper ends of n intervals, each (n, 1)."""
    both = np.array(intervals, np.float64).reshape(-1, 2)
    return both[:, :1], both[:, 1:]


def _tiled(constraints: Sequence[Constraint], count: int) -> tuple[Vector, Vector]:
    intervals = np.array([item.interval for item in constraints], np.float64)
    both = np.tile(intervals.reshape(-1, 2), (count, 1))
    return both[:, 0], both[:, 1]
