"""Hermite-Simpson collocation, separated: states and controls at the ends and middles of the intervals.

Decision vector, K intervals, a column for each state and control:

    x_i: knot 0, middle 0, knot 1, middle 1, ..., knot K   (2 K + 1)
    u_j: the same instants                                  (2 K + 1)
    t0 | tf

On an interval of normalised width h, with F = (tf - t0) f at left end, middle and right end:

    x_m - (x_l + x_r) / 2 - h (F_l - F_r) / 8 = 0,      x_r - x_l - h (F_l + 4 F_m + F_r) / 6 = 0.

The state between the nodes is the cubic through the ends with their slopes, the control the quadratic through
its three values. Where it shall be within its bounds between the nodes too, the unknown in the middle is
Bernstein's coefficient c, u_m = c / 2 + (u_l + u_r) / 4: the quadratic lies between u_l, c and u_r.

Source: Hargraves and Paris, "Direct trajectory optimization using nonlinear programming and collocation",
J. Guidance 10(4), 1987, doi 10.2514/3.20223; Betts, Practical Methods for Optimal Control, SIAM 2010, 4.6.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.backends import NUMPY
from solvers.coefficients import hermite
from solvers.curves import Curve, HermiteCurve, QuadraticCurve
from solvers.formulation.time_knots import LONGEST_MOMENT
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription, control_columns
from solvers.transcription.builder import fixed
from solvers.transcription.nodes import Instants

Vector = NDArray[np.float64]


@dataclass
class HermiteSimpson(Transcription):
    """Hermite-Simpson on the intervals between ``knots`` (normalised, from 0 to 1).

    ``within``: controls are within their bounds between the nodes too.
    """

    knots: Vector
    within: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        self.tau = np.empty(2 * self.knots.size - 1)
        self.tau[::2] = self.knots
        self.tau[1::2] = (self.knots[1:] + self.knots[:-1]) / 2.0

    @property
    def mesh(self) -> Hashable:
        """The knots, and what the unknowns of controls are."""
        return tuple(self.knots), self.within

    def allocate(self) -> None:
        """See :class:`Transcription`."""
        self.builder.unknowns(
            "states",
            (self.scaling.states.size, self.tau.size),
            scale=self.scaling.states,
            initial=lambda this: this.start.states_at(this.tau),
            bounds=fixed(-np.inf, np.inf),
        )
        self.allocate_controls()

    def allocate_controls(self) -> None:
        """Append the block of controls."""
        self.builder.unknowns(
            "controls",
            (self.scaling.controls.size, self.tau.size),
            scale=self.scaling.controls,
            initial=lambda this: this.start.controls_at(this.tau) @ this.from_values.T,
            bounds=control_columns,
        )

    def nodes(self) -> Instants:
        """The ends and middles of the intervals."""
        states = [self.builder.rows_of(block) for block in self.builder.blocks["states"]]
        return Instants(self.tau, states, self.control_rows())

    def control_rows(self) -> list[sparse.csr_array]:
        """The rows of each control at the nodes."""
        return [self.builder.rows_of(block, self.to_values) for block in self.builder.blocks["controls"]]

    @property
    def to_values(self) -> sparse.csr_array:
        """From the unknowns of a control to its values at the nodes."""
        unit = sparse.eye_array(self.tau.size)
        return sparse.csr_array(unit - 0.5 * self._at_middles()) if self.within else sparse.csr_array(unit)

    @property
    def from_values(self) -> sparse.csr_array:
        """From the values of a control at the nodes to its unknowns."""
        unit = sparse.eye_array(self.tau.size)
        return sparse.csr_array(unit + self._at_middles()) if self.within else sparse.csr_array(unit)

    def path_instants(self) -> Instants:
        """The ends and middles of the intervals."""
        return self.nodes()

    def quadrature(self) -> tuple[Instants, Vector]:
        """Simpson's rule on each interval."""
        return self.nodes(), np.asarray(self._simpson().sum(axis=0), np.float64)

    def constrain_dynamics(self) -> None:
        """Hermite's middle and Simpson's end, interval by interval."""
        widths = np.diff(self.knots)
        middles = self._middles()
        simpson = self._triples(-np.ones_like(widths), np.zeros_like(widths), np.ones_like(widths))
        hermite_rates = self._triples(-widths / 8.0, np.zeros_like(widths), widths / 8.0)
        order = np.arange(2 * widths.size).reshape(2, -1).T.ravel()
        differences = sparse.csr_array(sparse.vstack([middles, simpson], format="csr")[order])
        rates = sparse.csr_array(sparse.vstack([hermite_rates, -self._simpson()], format="csr")[order])
        states = [self.builder.rows_of(block, differences) for block in self.builder.blocks["states"]]
        self.add_defects(states, self.apply_rate(self.nodes()), rates)
        self.straighten_rates()
        self.straighten_moments()

    def straighten_rates(self) -> None:
        """Let rates of controls be linear on each interval, so that their bounds hold inside too."""
        middles = self._middles()
        for name in self.problem.rated:
            j = self.problem.controls.index(f"{name}_dot")
            rows = self.builder.rows_of(self.builder.blocks["controls"][j], middles)
            self.builder.constrain(fixed(0.0, 0.0), scale=self.scaling.controls[j], linear=rows)

    def straighten_moments(self) -> None:
        """Determine the middle control of an interval that is there for a jump of the model alone."""
        moments = np.diff(self.knots) < LONGEST_MOMENT
        if moments.any():
            rated = {f"{name}_dot" for name in self.problem.rated}  # straight already
            rows = self._middles()[moments]
            for j, control in enumerate(self.control_rows()):
                if self.problem.controls[j] not in rated:
                    middle = sparse.csr_array(rows @ control)
                    self.builder.constrain(fixed(0.0, 0.0), scale=self.scaling.controls[j], linear=middle)

    def read(self, unknowns: Vector) -> Trajectory:
        """See :class:`Transcription`."""
        problem = self.problem
        t0, tf = (float(unknowns[block.start]) for block in self.builder.blocks["times"])
        blocks = self.builder.blocks["states"]
        states = np.array([unknowns[block.start : block.stop] for block in blocks]).reshape(-1, self.tau.size)
        curves = self.control_curves(unknowns)
        controls = np.array([curve(self.knots) for curve in curves]).reshape(-1, self.knots.size)
        times = t0 + (tf - t0) * self.knots
        with np.errstate(all="ignore"):  # the last iterate of a failed solve may have no finite rate
            parameters = {**problem.parameters, **self.design(unknowns)}
            rate = problem.rate(states[:, ::2], controls, times, parameters, NUMPY)
        slopes = (tf - t0) * np.array(np.broadcast_arrays(*rate, self.knots)[:-1])
        slopes[~np.isfinite(slopes)] = 0.0
        return Trajectory(
            t0,
            tf,
            {
                name: HermiteCurve(self.knots, values[::2], slope)
                for name, values, slope in zip(problem.states, states, slopes, strict=True)
            },
            dict(zip(problem.controls, curves, strict=True)),
            interpolation="quadratic",
            basis=self.described_basis(),
            breakpoints=self.knots,
            nodes=self.tau,
        )

    def control_curves(self, unknowns: Vector) -> Sequence[Curve]:
        """The controls as functions of tau."""
        blocks = self.builder.blocks["controls"]
        values = [self.to_values @ unknowns[block.start : block.stop] for block in blocks]
        return [QuadraticCurve(self.knots, own) for own in values]

    def described_basis(self) -> dict[str, Any]:
        """The ``basis`` of a trajectory."""
        even = np.array_equal(self.knots, np.linspace(0.0, 1.0, self.knots.size))
        uneven = {} if even else {"knots": self.knots.tolist()}
        return {"name": hermite.NAME, "intervals": self.knots.size - 1, **uneven}

    def _simpson(self) -> sparse.csr_array:
        widths = np.diff(self.knots)
        return self._triples(widths / 6.0, 4.0 * widths / 6.0, widths / 6.0)

    def _middles(self) -> sparse.csr_array:
        """How far the middle of each interval is from the mean of its ends."""
        ones = np.ones(self.knots.size - 1)
        return self._triples(-0.5 * ones, ones, -0.5 * ones)

    def _at_middles(self) -> sparse.csr_array:
        """The rows of :meth:`_middles`, each at the middle of its interval, none at the knots."""
        rows = sparse.coo_array(self._middles())
        return sparse.csr_array((rows.data, (2 * rows.row + 1, rows.col)), shape=(self.tau.size,) * 2)

    def _triples(self, left: Vector, middle: Vector, right: Vector) -> sparse.csr_array:
        """A row for each interval with these entries at its left end, middle and right end."""
        rows = np.repeat(np.arange(left.size), 3)
        columns = (2 * np.arange(left.size)[:, None] + np.arange(3)).ravel()
        entries = np.column_stack([left, middle, right]).ravel()
        return sparse.csr_array((entries, (rows, columns)), shape=(left.size, self.tau.size))
