"""What a model does after the flight, without control: how much still swings."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.backends import NUMPY
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verification.flight import FlightError

Vector = NDArray[np.float64]

SAMPLES = 401
_SECONDS = 20.0


def coast(problem: OptimalControlProblem, flown: Trajectory, start: Vector, seconds: float) -> dict[str, Any]:
    """Fly on from ``start`` at the end of ``flown`` with all controls zero.

    Samples of states and outputs, and for each of them the ``residual``: smallest and largest value, and half
    of the distance between them, the amplitude of what swings about a constant.
    """
    begin, parameters = flown.tf, problem.parameters_of(flown)
    still = np.zeros((len(problem.controls), 1))
    deadline = time.monotonic() + _SECONDS

    def rate(t: float, x: Vector) -> Vector:
        if time.monotonic() > deadline:
            raise FlightError("the time for coasting ran out")
        with np.errstate(all="ignore"):
            rates = problem.rate(x[:, None], still, np.array([t]), parameters, NUMPY)
        return np.array(np.broadcast_arrays(*rates, np.zeros(1))[:-1], np.float64)[:, 0]

    times = np.linspace(begin, begin + seconds, SAMPLES)
    try:
        flight = solve_ivp(
            rate, (times[0], times[-1]), start, method="DOP853", t_eval=times, rtol=1e-9, atol=1e-12
        )
    except FlightError as error:
        return {"seconds": seconds, "note": f"It was not flown to its end: {error}."}
    if not flight.success:
        return {"seconds": seconds, "note": f"It was not flown to its end: {flight.message}"}
    zeros = np.zeros((still.shape[0], times.size))
    scope = problem.scope(flight.y, zeros, times, parameters, NUMPY)
    with np.errstate(all="ignore"):
        outputs = {
            item.name: np.broadcast_to(item.expression.evaluate(scope, NUMPY.functions), times.shape)
            for item in problem.outputs
        }
    states = dict(zip(problem.states, flight.y, strict=True))
    return {
        "seconds": seconds,
        "t": times.tolist(),
        "states": {name: values.tolist() for name, values in states.items()},
        "outputs": {name: values.tolist() for name, values in outputs.items()},
        "residual": {name: _swing(values) for name, values in {**states, **outputs}.items()},
        "note": "",
    }


def _swing(values: Vector) -> dict[str, float]:
    low, high = float(values.min()), float(values.max())
    return {"min": low, "max": high, "amplitude": (high - low) / 2.0}
