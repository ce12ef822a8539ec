"""Fly a control: integrate the model over every arc at once, and join the arcs to one flight.

An arc lies between two breakpoints of the control; on it everything is smooth. All arcs are integrated side
by side in s in [0, 1] by one call of DOP853 (Hairer, Norsett, Wanner 1993, II.5). The whole flight is the
solution of y_(k+1) = Phi_k(y_k), found by Newton's method on all arcs together (multiple shooting; Stoer,
Bulirsch 1993, 7.3.5): a few batches instead of one long sequence of steps, with its linearised growth as a
gift.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.arrays.rates import Rates
from solvers.curves import rests_between_breaks
from solvers.errors import OndeletteError
from solvers.formulation.time_knots import flight_corners
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verification.flown_controls import FlownControls
from solvers.verification.violations import SMALLEST_SCALE

Vector = NDArray[np.float64]

INTEGRATOR = "DOP853"
# With 1e-12 a stiff motion over ten thousand seconds is flown no better than to 2e-9, with this to 1e-12;
# others take no longer.
RTOL = 3e-13
_SMALLEST_RTOL = 2.5e-14
INSIDE = np.array([0.25, 0.5, 0.75, 1.0])
"""Where on an arc states are compared: parts of its length."""
_NEWTON_STEPS = 12
_NEWTON_DONE = 1e-7
_SLOPES_KEPT_BELOW = 0.1
# By how much of its scale a state is moved to see what that changes.
_OFFSET = 1e-6
# Most arcs are crossed in two steps; the first step that SciPy chooses by itself is far shorter.
_FIRST_STEP = 0.5
# The longest that one flight by itself may take, s.
_SECONDS = 20.0


class FlightError(OndeletteError):
    """The integration did not come to its end: out of time, or the state escaped."""


@dataclass(frozen=True)
class Arcs:
    """What K arcs give: ``ends`` (n, K), ``inside`` (n, K, 4) at ``INSIDE``, ``integrals`` (1 + i, K).

    The first of the integrals is that of the running cost.
    """

    ends: Vector
    inside: Vector
    integrals: Vector


@dataclass(frozen=True)
class Flight:
    """One whole flight: ``states`` (n, K + 1) at the breakpoints, ``integrals`` (1 + i,), the cost first."""

    states: Vector
    integrals: Vector


class ControlledModel:
    """The model under the control of a trajectory, clipped to its bounds; integrates arcs."""

    def __init__(
        self, problem: OptimalControlProblem, trajectory: Trajectory, scale: Vector, deadline: float
    ) -> None:
        self._trajectory = trajectory
        self._scale, self._deadline = scale, deadline
        self._controls = FlownControls(
            trajectory, problem.control_bounds, flight_corners(problem, trajectory)
        )
        self._integrals = 1 + len(problem.integrals)
        integrands = [problem.running_cost, *(item.expression for item in problem.integrals)]
        self._rates = Rates(problem, problem.parameters_of(trajectory), integrands)
        self.bounds, self.clipped = self._controls.bounds, self._controls.clipped
        self._rests = all(rests_between_breaks(curve) for curve in trajectory.controls.values())
        self.breakpoints = self._controls.breakpoints

    @property
    def arcs(self) -> int:
        """K, the number of arcs."""
        return self.breakpoints.size - 1

    def integrate(self, starts: Vector, arcs: NDArray[np.intp]) -> Arcs:
        """Integrate the arcs of these indices from ``starts`` (n, len(arcs)).

        Raises :class:`FlightError` when time runs out or a state is no longer finite.
        """
        n, count = starts.shape
        # Copies of an arc, as for its derivatives, share their control.
        own, copies = np.unique(arcs, return_inverse=True)
        left, width = self.breakpoints[own], np.diff(self.breakpoints)[own]
        # Strictly inside: at a jump of the control, an end belongs to the arc and not to its neighbour.
        margin = 1e-12 * width
        first, last = left + margin, left + width - margin
        duration = self._trajectory.duration * width[copies]
        # A control that rests on every arc, as one that goes from bound to bound, is asked once.
        resting = self.clipped(left + 0.5 * width)[:, copies] if self._rests else None

        def rate(s: float, flat: Vector) -> Vector:
            if time.monotonic() > self._deadline:
                raise FlightError("the time for verification ran out")
            tau = np.minimum(np.maximum(left + s * width, first), last)
            states = flat.reshape(-1, count)[:n]
            controls = self.clipped(tau)[:, copies] if resting is None else resting
            return (duration * self._rates(states, controls, self._trajectory.time(tau[copies]))).ravel()

        extra = self._integrals
        if not np.isfinite(starts).all():
            raise FlightError("an arc begins where a state is not finite")
        start = np.vstack([starts, np.zeros((extra, count))])
        if not np.isfinite(rate(0.0, start.ravel())).all():
            raise FlightError("the model has no finite rate at the start of an arc")
        # solve_ivp weighs errors by their mean square over all arcs: ask for more, so none is left behind.
        # A trial step may leave what a model has numbers for; it is taken back.
        with np.errstate(over="ignore", invalid="ignore"):
            solution = solve_ivp(
                rate,
                (0.0, 1.0),
                start.ravel(),
                method="DOP853",
                t_eval=INSIDE,
                first_step=_FIRST_STEP,
                rtol=max(RTOL / np.sqrt(count), _SMALLEST_RTOL),
                atol=np.repeat(np.append(self._scale, np.ones(extra)) * RTOL / 10.0, count),
            )
        if not solution.success:
            raise FlightError(f"the integration stopped: {solution.message}")
        values = solution.y.reshape(n + extra, count, INSIDE.size)
        if not np.isfinite(values).all():
            raise FlightError("the state is no longer finite")
        return Arcs(values[:n, :, -1], values[:n], values[n:, :, -1])

    def linearised(self, starts: Vector) -> tuple[Vector, Arcs]:
        """All arcs from ``starts`` (n, K), and how their ends and integrals change with their starts.

        By differences, (K, n + 1 + i, n). Raises :class:`FlightError` as :meth:`integrate` does.
        """
        n, count = starts.shape
        offset = _OFFSET * self._scale
        bundle = np.concatenate([starts, *[starts + (offset * unit)[:, None] for unit in np.eye(n)]], axis=1)
        flown = self.integrate(bundle, np.tile(np.arange(count), n + 1))
        found = np.concatenate([flown.ends, flown.integrals]).reshape(-1, n + 1, count)
        slopes = (found[:, 1:] - found[:, :1]) / offset[None, :, None]
        own = Arcs(found[:n, 0], flown.inside[:, :count], found[n:, 0])
        return np.moveaxis(slopes, -1, 0), own

    def growth(self, slopes: Vector) -> float:
        """The largest factor by which a small error on the way grows until the end, in scaled states."""
        scaled = slopes[:, : self._scale.size] * (self._scale[None, None, :] / self._scale[None, :, None])
        product = np.eye(self._scale.size)
        growth = 1.0
        with np.errstate(over="ignore", invalid="ignore"):
            for slope in scaled[::-1]:
                product = product @ slope
                size = float(np.max(np.abs(product)))
                if not np.isfinite(size):
                    return float("inf")
                growth = max(growth, size)
        return growth

    def fly(self, guess: Vector, slopes: Vector, arcs: Arcs, growth: float | None = None) -> Flight:
        """The whole flight from ``guess[:, 0]``.

        ``guess`` (n, K + 1) is near it at the breakpoints; ``slopes``, ``arcs``: its :meth:`linearised`,
        ``growth``: that of these slopes; without ``growth``, they are those of another guess.
        Raises :class:`FlightError` as :meth:`integrate` does.
        """
        states = guess.copy()
        largest = np.inf
        for _ in range(_NEWTON_STEPS):
            step = _accumulate(slopes, arcs.ends - states[:, 1:])
            states[:, 1:] += step
            if not np.isfinite(states).all():
                break
            before, largest = largest, float(np.max(np.abs(step) / self._scale[:, None]))
            if growth is not None and (largest + _OFFSET) * largest * growth < RTOL:
                # What straight lines leave out is less than what the integrator does.
                moved = np.column_stack([np.zeros(len(states)), step[:, :-1]])
                change = np.einsum("kij,jk->i", slopes[:, len(states) :], moved)
                return Flight(states, arcs.integrals.sum(axis=1) + change)
            if largest < _NEWTON_DONE:
                # The next step would be smaller by as much again: one pass closes the gaps to rounding.
                arcs = self.integrate(states[:, :-1], np.arange(self.arcs))
                states[:, 1:] += _accumulate(slopes, arcs.ends - states[:, 1:])
                return Flight(states, arcs.integrals.sum(axis=1))
            # Slopes cost n + 1 passes of the arcs: old ones will do as long as they make steps much smaller.
            if largest < _SLOPES_KEPT_BELOW * min(before, 1.0):
                arcs, growth = self.integrate(states[:, :-1], np.arange(self.arcs)), None
            else:
                slopes, arcs = self.linearised(states[:, :-1])
                growth = self.growth(slopes)
        return self._march(guess[:, 0])

    def _march(self, start: Vector) -> Flight:
        """The flight arc after arc, where Newton's method fails."""
        states, integrals = [start], np.zeros(self._integrals)
        for index in range(self.arcs):
            arc = self.integrate(states[-1][:, None], np.array([index]))
            states.append(arc.ends[:, 0])
            integrals += arc.integrals[:, 0]
        return Flight(np.column_stack(states), integrals)


def whole_flight(problem: OptimalControlProblem, flown: Trajectory, promised: Vector) -> Vector:
    """The states (n,) in which the flight of a control from ``promised[:, 0]`` ends.

    ``promised`` (n, K + 1): about where it goes at the breakpoints. Raises FlightError where it does not come
    to its end.
    """
    scale = np.maximum(SMALLEST_SCALE, np.abs(promised).max(axis=1))
    model = ControlledModel(problem, flown, scale, time.monotonic() + _SECONDS)
    if model.breakpoints.size != promised.shape[1]:
        rows = [np.interp(model.breakpoints, flown.breakpoints, row) for row in promised]
        promised = np.array(rows)
    slopes, arcs = model.linearised(promised[:, :-1])
    return model.fly(promised, slopes, arcs).states[:, -1]


def _accumulate(slopes: Vector, gaps: Vector) -> Vector:
    """The recursion d_(k+1) = A_k d_k + r_k from d_0 = 0: columns d_1 ... d_K."""
    steps = np.empty_like(gaps)
    step = np.zeros(gaps.shape[0])
    with np.errstate(over="ignore", invalid="ignore"):
        for index, slope in enumerate(slopes[:, : step.size]):
            step = slope @ step + gaps[:, index]
            steps[:, index] = step
    return steps
