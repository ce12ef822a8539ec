"""The program of a prediction: one segment on its own mesh, then the rest of the horizon on another.

Decision vector, n driven states, m controls, 2 (K1 + K2) + 1 nodes, the first 2 K1 + 1 the segment's:

    x_i: node 0, middle 0, node 1, ...        (a column for each driven state)
    u_j: the same instants
    s_b: at the first nodes after the start, how far a bounded state is outside
    d1, d2: lengths of the segment and of the rest

Hermite-Simpson defects on every interval. The segment begins where the plant will be, which may be outside
the bounds: at the first nodes they are soft, with an exact penalty. Lengths are fixed, or free with a state
that is given at the ends of both parts. One structure serves all segments alike; what changes is numbers.

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625;
Kerrigan, Maciejowski, "Soft constraints and exact penalty functions in model predictive control", 2000.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.piecewise.simple import SimpleModel
from solvers.program import NonlinearProgram
from solvers.scaling import magnitude
from solvers.symbolic import CASADI
from solvers.transcription.builder import Intervals, Matrix, Places, ProgramBuilder, fixed

Vector = NDArray[np.float64]

# Of the objective's scale, for a state that is outside by its own scale at one node: above the multipliers
# that bounds of the cases have, so that the penalty is exact.
_PENALTY = 30.0
# Path constraints, too, wait until the start is behind.
_SETTLING_NODES = 4


@dataclass(frozen=True)
class Scales:
    """Magnitudes of driven states, controls, time and objective."""

    states: Vector
    controls: Vector
    time: float
    objective: float


@dataclass
class Wanted:
    """The numbers of one prediction.

    ``start`` (n,) driven states; ``numbers`` (., K) of all places, see `Horizon.places`; ``lower``, ``upper``
    (n,) bounds of the driven states with their margins; ``segment_end``, ``horizon_end``: (n, 2) intervals of
    the driven states there; ``lengths`` (2, 2): intervals of d1 and d2; ``boundary`` (b, 2): intervals of the
    boundary constraints; ``guess``: states (n, K), controls (m, K), lengths (2,).
    """

    start: Vector
    initial: Sequence[float]
    time: float
    numbers: Vector
    lower: Vector
    upper: Vector
    segment_end: Vector
    horizon_end: Vector
    lengths: Vector
    boundary: Vector
    guess: tuple[Vector, Vector, Vector]


@dataclass
class Horizon:
    """The program for K1 = ``nodes`` intervals of a segment and K2 = ``rest`` after it, which may be none.

    Bounds are soft at the ``soft`` nodes after the start.
    """

    model: SimpleModel
    nodes: int
    rest: int
    soft: int
    scales: Scales
    smoothing: float
    builder: ProgramBuilder = field(default_factory=ProgramBuilder, init=False)

    @property
    def instants(self) -> int:
        """The number of nodes and middles."""
        return 2 * (self.nodes + self.rest) + 1

    @property
    def boundary_node(self) -> int:
        """Where the segment ends."""
        return 2 * self.nodes

    @property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """For each place of the dynamics its node and its part: the boundary is one of both."""
        first = np.arange(self.boundary_node + 1)
        second = np.arange(self.boundary_node, self.instants) if self.rest else first[:0]
        return np.concatenate([first, second]), np.repeat([0, 1], [first.size, second.size])

    @property
    def place_of_node(self) -> NDArray[np.intp]:
        """For each node its place; the boundary's is that of the segment."""
        nodes = np.arange(self.instants)
        return nodes + (nodes > self.boundary_node)

    def times(self, lengths: Vector) -> Vector:
        """For each place its time after the start, where both parts have these lengths."""
        _, part = self.places
        return np.asarray(np.where(part == 0, 0.0, lengths[0]) + self.local * lengths[part], np.float64)

    @property
    def local(self) -> Vector:
        """For each place its time over the length of its part, from 0 to 1."""
        parts = [np.linspace(0.0, 1.0, 2 * count + 1) for count in (self.nodes, self.rest) if count]
        return np.concatenate(parts)

    @property
    def soft_nodes(self) -> NDArray[np.intp]:
        """The nodes with soft bounds."""
        return np.arange(1, self.soft + 1)

    @property
    def bounded(self) -> list[int]:
        """Driven states with bounds (their places among the driven)."""
        bounds = self.model.problem.state_bounds
        return [place for place, index in enumerate(self.model.driven) if np.isfinite(bounds[index]).any()]

    def program(self, wanted: Wanted) -> NonlinearProgram:
        """The scaled program for these numbers."""
        if not self.builder.size:
            self._build(wanted)
        return self.builder.program(wanted, self.scales.objective)

    def read(self, unknowns: Vector) -> tuple[Vector, Vector, Vector]:
        """States (n, K), controls (m, K) and lengths (2,) of a (scaled) solution."""
        values = unknowns * self.builder.scale
        found = [
            np.array([values[block.start : block.stop] for block in self.builder.blocks[name]])
            for name in ("states", "controls", "lengths")
        ]
        return found[0].reshape(-1, self.instants), found[1].reshape(-1, self.instants), found[2].ravel()

    def _build(self, wanted: Wanted) -> None:
        builder, scales = self.builder, self.scales
        problem = self.model.problem
        builder.unknowns(
            "states",
            (scales.states.size, self.instants),
            scale=scales.states,
            initial=lambda this: this.guess[0],
            bounds=self._state_bounds,
        )
        controls = np.array(problem.control_bounds, np.float64).reshape(-1, 2)
        builder.unknowns(
            "controls",
            (scales.controls.size, self.instants),
            scale=scales.controls,
            initial=lambda this: this.guess[1],
            bounds=lambda _: (controls[:, :1], controls[:, 1:]),
        )
        builder.unknowns(
            "outside",
            (len(self.bounded), self.soft_nodes.size),
            scale=scales.states[self.bounded],
            initial=lambda _: 0.0,
            bounds=fixed(0.0, np.inf),
        )
        builder.unknowns(
            "lengths",
            (2, 1),
            scale=scales.time,
            initial=lambda this: this.guess[2][:, None],
            bounds=lambda this: (this.lengths[:, :1], this.lengths[:, 1:]),
        )
        self._add_dynamics()
        self._soften()
        self._add_path()
        self._add_ends()
        self._smooth()

    def _state_bounds(self, this: Wanted) -> tuple[Vector, Vector]:
        """Bounds after the soft nodes, the start, and what is given where segment and horizon end."""
        free = np.full((this.start.size, self.instants), np.inf)
        lower, upper = -free, free.copy()
        hard = slice(self.soft_nodes[-1] + 1, None)
        lower[:, hard], upper[:, hard] = this.lower[:, None], this.upper[:, None]
        lower[:, 0] = upper[:, 0] = this.start
        for node, ends in ((self.boundary_node, this.segment_end), (-1, this.horizon_end)):
            lower[:, node] = np.maximum(lower[:, node], ends[:, 0])
            upper[:, node] = np.minimum(upper[:, node], ends[:, 1])
        return lower, upper

    def _rows(self, name: str, nodes: NDArray[np.intp]) -> list[Matrix]:
        """For each block of unknowns its rows at these nodes."""
        return [self.builder.single_rows(block.start + nodes) for block in self.builder.blocks[name]]

    def _spans(self) -> list[Matrix]:
        """Rows of the time before a place's part, and of the length of that part."""
        builder = self.builder
        _, part = self.places
        first, second = (block.start for block in builder.blocks["lengths"])
        count = part.size
        before = sparse.csr_array(
            (np.ones(int(part.sum())), (np.flatnonzero(part), np.full(int(part.sum()), first))),
            shape=(count, builder.size),
        )
        return [before, builder.single_rows(np.where(part == 0, first, second))]

    def apply(self, name: Literal["rate", "cost", "path"]) -> Places:
        """Evaluate the rates or the running cost, times the length of the part, or the path constraints."""
        model, problem = self.model, self.model.problem
        n, m = len(model.driven), len(problem.controls)
        z = ca.SX.sym("z", n + m + 2)
        parts = ca.vertsplit(z)
        before, length = parts[-2:]
        p = ca.SX.sym("p", model.numbers if model.known_times else 2)
        numbers = ca.vertsplit(p) if model.known_times else [p[0] + before + p[1] * length]
        scope = model.scope(parts[:n], parts[n : n + m], numbers)
        if name == "rate":
            found = [length * rate for rate in model.driven_rate(scope)]
        elif name == "path":
            found = [item.expression.evaluate(scope, CASADI.functions) for item in problem.path]
        else:
            assert problem.running_cost is not None
            found = [length * problem.running_cost.evaluate(scope, CASADI.functions)]
        function = ca.Function(name, [z, p], [ca.vertcat(*[ca.SX(value) for value in found])])
        nodes, _ = self.places
        blocks = [*self._rows("states", nodes), *self._rows("controls", nodes), *self._spans()]
        return self.builder.apply(function, blocks, lambda this: this.numbers)

    def _add_dynamics(self) -> None:
        """Hermite's middle and Simpson's end of every interval; Simpson's rule for the running cost."""
        builder, n = self.builder, self.scales.states.size
        places = self.apply("rate")
        left = self._left_nodes()
        count = left.size
        # Where an interval's three places are: those of the second part come one later, after the boundary.
        left_place = left + (left >= self.boundary_node)
        widths = np.where(left < self.boundary_node, 1.0 / self.nodes, 1.0 / max(1, self.rest))
        hermite = _triples(left, [-0.5, 1.0, -0.5], np.ones(count), self.instants)
        simpson = _triples(left, [-1.0, 0.0, 1.0], np.ones(count), self.instants)
        total = self.local.size
        hermite_rates = _triples(left_place, [-1 / 8, 0.0, 1 / 8], widths, total)
        simpson_rates = _triples(left_place, [-1 / 6, -4 / 6, -1 / 6], widths, total)
        states = sparse.vstack([hermite, simpson], format="csr")
        rates = sparse.vstack([hermite_rates, simpson_rates], format="csr")
        linear = sparse.vstack(
            [builder.rows_of(block, sparse.csr_array(states)) for block in builder.blocks["states"]],
            format="csr",
        )
        chosen = [
            sparse.kron(rates, sparse.csr_array(np.eye(n)[[index]]), format="csr") for index in range(n)
        ]
        builder.constrain(
            fixed(0.0, 0.0),
            scale=np.repeat(self.scales.states, 2 * count),
            linear=sparse.csr_array(linear),
            places=places,
            scatter=sparse.csr_array(sparse.vstack(chosen, format="csr")),
        )
        if self.model.problem.running_cost is not None:
            builder.cost(self.apply("cost"), -np.asarray(simpson_rates.sum(axis=0), np.float64))

    def _left_nodes(self) -> NDArray[np.intp]:
        return np.arange(0, self.instants - 1, 2)

    def _soften(self) -> None:
        """Bounds on the soft nodes, up to what is outside, at a price."""
        builder, nodes = self.builder, self.soft_nodes
        for place, block in zip(self.bounded, builder.blocks["outside"], strict=True):
            state = builder.single_rows(builder.blocks["states"][place].start + nodes)
            outside = builder.rows_of(block)
            scale = float(self.scales.states[place])
            for sign, limits in ((1.0, _below(place)), (-1.0, _above(place))):
                builder.constrain(limits, scale=scale, linear=sparse.csr_array(state - sign * outside))
        if self.bounded:
            count = len(self.bounded)
            s, nothing = ca.SX.sym("s", count), ca.SX.sym("p", 0)
            weights = ca.DM(_PENALTY * self.scales.objective / self.scales.states[self.bounded])
            penalty = ca.Function("penalty", [s, nothing], [ca.dot(weights, s)])
            rows = [builder.rows_of(block) for block in builder.blocks["outside"]]
            places = builder.apply(penalty, rows, lambda _: np.zeros((0, nodes.size)))
            builder.cost(places, np.ones(nodes.size))

    def _add_path(self) -> None:
        problem = self.model.problem
        if not problem.path:
            return
        places = self.apply("path")
        nodes, _ = self.places
        waits = nodes < _SETTLING_NODES
        intervals = np.array([item.interval for item in problem.path], np.float64)
        both = np.where(waits[:, None, None], np.array(_FREE), intervals[None, :, :]).reshape(-1, 2)
        self.builder.constrain(
            lambda _: (both[:, 0], both[:, 1]),
            scale=np.tile([magnitude(item.interval) for item in problem.path], nodes.size),
            places=places,
        )

    def _add_ends(self) -> None:
        """Boundary constraints, which hold only where the horizon is the end, and the terminal cost."""
        problem, model = self.model.problem, self.model
        if problem.terminal_cost is None and not problem.boundary:
            return
        n, m = len(model.driven), len(problem.controls)
        all_states = len(problem.states)
        outside = len(model.exogenous)
        z = ca.SX.sym("z", n + 2 * m + 2)
        p = ca.SX.sym("p", all_states + outside + 1)
        x, first, last, lengths = (
            ca.vertsplit(part) for part in ca.vertsplit(z, [0, n, n + m, n + 2 * m, n + 2 * m + 2])
        )
        final: list[ca.SX] = [ca.SX(0)] * all_states
        for place, index in enumerate(model.driven):
            final[index] = x[place]
        for place, index in enumerate(model.exogenous):
            final[index] = p[all_states + place]
        start = p[all_states + outside]
        scope = problem.ends_scope(
            (ca.vertsplit(p[:all_states]), first, start),
            (final, last, start + lengths[0] + lengths[1]),
            problem.parameters,
            CASADI,
        )
        expressions = [item.expression for item in problem.boundary]
        if problem.terminal_cost is not None:
            expressions.append(problem.terminal_cost)
        values = [ca.SX(expression.evaluate(scope, CASADI.functions)) for expression in expressions]
        function = ca.Function("ends", [z, p], [ca.vertcat(*values)])
        end, begin = np.array([self.instants - 1]), np.array([0])
        blocks = [
            *self._rows("states", end),
            *self._rows("controls", begin),
            *self._rows("controls", end),
            *[self.builder.rows_of(block) for block in self.builder.blocks["lengths"]],
        ]
        places = self.builder.apply(
            function,
            blocks,
            lambda this: np.concatenate([this.initial, this.numbers[:outside, -1], [this.time]])[:, None],
        )
        count = len(problem.boundary)
        if count:
            self.builder.constrain(
                lambda this: (this.boundary[:, 0], this.boundary[:, 1]),
                scale=np.array([magnitude(item.interval) for item in problem.boundary]),
                places=places,
                scatter=sparse.csr_array(np.eye(count, len(values))),
            )
        if problem.terminal_cost is not None:
            self.builder.cost(places, np.eye(len(values))[-1])

    def _smooth(self) -> None:
        """A small price on steps of the controls: it decides where the objective does not care."""
        m = self.scales.controls.size
        if not m:
            return
        z, nothing = ca.SX.sym("z", 2 * m), ca.SX.sym("p", 0)
        steps = (z[m:] - z[:m]) / ca.DM(self.scales.controls)
        price = ca.Function(
            "steps", [z, nothing], [self.smoothing * self.scales.objective * ca.sumsqr(steps)]
        )
        before = np.arange(self.instants - 1)
        blocks = [*self._rows("controls", before), *self._rows("controls", before + 1)]
        places = self.builder.apply(price, blocks, lambda _: np.zeros((0, before.size)))
        self.builder.cost(places, np.ones(before.size))


_FREE = (-np.inf, np.inf)


def _below(place: int) -> Intervals:
    return lambda this: (-np.inf, this.upper[place])


def _above(place: int) -> Intervals:
    return lambda this: (this.lower[place], np.inf)


def _triples(left: NDArray[np.intp], entries: list[float], factors: Vector, columns: int) -> sparse.csr_array:
    """A row for each interval with ``entries`` times its factor at its left end, middle and right end."""
    rows = np.repeat(np.arange(left.size), 3)
    places = (left[:, None] + np.arange(3)).ravel()
    values = (factors[:, None] * np.array(entries)).ravel()
    return sparse.csr_array((values, (rows, places)), shape=(left.size, columns))
