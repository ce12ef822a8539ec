"""A document as the predictor and the tracker need it: weights, scales, boxes, limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.formulation.stated import stated_problem
from solvers.piecewise.gains import Weights
from solvers.piecewise.plan import Plan, actuator_limits
from solvers.piecewise.simple import SimpleModel
from solvers.piecewise.track import Tracker
from solvers.piecewise.wanted import Scales
from solvers.problem import OptimalControlProblem
from solvers.spec import JobSpec, PiecewiseMethod, Value, evaluate_constant
from solvers.start.scaling import nearest_power_of_two

Vector = NDArray[np.float64]

# A deviation that weighs 1, where a document says nothing, as part of a state's scale and a control's range.
_USUAL_STATE, _USUAL_CONTROL = 1e-2, 0.25
_FINAL_FACTOR = 10.0
# A state without bounds is as large as its ends, or as this many of its tracking tolerances.
_TOLERANCES = 50.0


@dataclass(frozen=True)
class Setup:
    """What a document with the method ``piecewise`` asks for, in numbers."""

    spec: JobSpec
    problem: OptimalControlProblem
    method: PiecewiseMethod

    @classmethod
    def of(cls, spec: JobSpec) -> Setup:
        """The setup of a checked document with this method."""
        assert isinstance(spec.method, PiecewiseMethod)
        return cls(spec, stated_problem(spec.problem), spec.method)

    @cached_property
    def model(self) -> SimpleModel:
        """The simple model."""
        return SimpleModel(self.problem, known_times=self.method.segments.by == "time")

    @cached_property
    def plan(self) -> Plan:
        """The segments."""
        return Plan.of(self.method, self.problem)

    @property
    def scheme(self) -> str:
        """How predictions start."""
        return self.method.scheme

    @property
    def smoothing(self) -> float:
        """Weight of squared steps of the controls."""
        return self.method.smoothing

    @property
    def tolerance(self) -> float:
        """Of the nonlinear programs."""
        return self.spec.options.tolerance

    @property
    def max_iterations(self) -> int:
        """Of each nonlinear program."""
        return self.spec.options.max_iterations

    def _number(self, value: Value) -> float:
        return evaluate_constant(value, self.problem.parameters)

    @cached_property
    def limits(self) -> Vector:
        """Limits of the actuators, (m, 2)."""
        return actuator_limits(self.problem, self.method)

    @cached_property
    def lower(self) -> Vector:
        """Lower bounds of the driven states in predictions, (n,)."""
        return self._boxes[:, 0] + self._margins

    @cached_property
    def upper(self) -> Vector:
        """Upper bounds of the driven states in predictions, (n,)."""
        return self._boxes[:, 1] - self._margins

    @property
    def _boxes(self) -> Vector:
        return np.array([self.problem.state_bounds[index] for index in self.model.driven]).reshape(-1, 2)

    @property
    def _margins(self) -> Vector:
        names = [self.problem.states[index] for index in self.model.driven]
        return np.array([self._number(self.method.margins.get(name, 0.0)) for name in names])

    @cached_property
    def _magnitudes(self) -> Vector:
        """A typical size of every state of the problem, (n,)."""
        problem, given = self.problem, self.method.tracking.Q
        sizes = []
        for name, bounds, start, end in zip(
            problem.states, problem.state_bounds, problem.initial_state, problem.final_state, strict=True
        ):
            known = [abs(value) for value in (*bounds, *start, *end) if np.isfinite(value)]
            known.append(_TOLERANCES * self._number(given[name]) if name in given else 0.0)
            sizes.append(nearest_power_of_two(max(known)))
        return np.array(sizes)

    @cached_property
    def scales(self) -> Scales:
        """Magnitudes of the quantities of a prediction."""
        problem, driven = self.problem, list(self.model.driven)
        controls = [
            nearest_power_of_two(max((abs(side) for side in bounds if np.isfinite(side)), default=0.0))
            for bounds in self.limits
        ]
        guess = problem.guess
        whole = guess.tf - guess.t0 if self.plan.state is not None else self.method.segments.length
        assert whole is not None
        return Scales(
            self._magnitudes[driven],
            np.array(controls),
            nearest_power_of_two(whole),
            self._objective_scale(whole),
        )

    def _objective_scale(self, whole: float) -> float:
        """How large the objective of a horizon is, from the guess with controls at half their range."""
        problem, size = self.problem, 0.0
        x = np.array([interval[0] for interval in problem.initial_state])
        u = np.array([_inside(bounds, 0.5) for bounds in problem.control_bounds])
        if problem.running_cost is not None:
            with np.errstate(all="ignore"):
                scope = problem.scope(x, u, problem.initial_time[0], problem.parameters, NUMPY)
                size += abs(float(problem.running_cost.evaluate(scope, NUMPY.functions))) * whole
        if problem.terminal_cost is not None:
            times = problem.initial_time[0], problem.initial_time[0] + whole
            first, last = (
                (problem.guess.states_at(np.array([tau]))[:, 0], u, t) for tau, t in enumerate(times)
            )
            with np.errstate(all="ignore"):
                scope_of_ends = problem.ends_scope(first, last, problem.parameters, NUMPY)
                size += abs(float(problem.terminal_cost.evaluate(scope_of_ends, NUMPY.functions)))
        return nearest_power_of_two(size)

    @cached_property
    def tracker(self) -> Tracker:
        """The tracker with the document's weights."""
        tracking, problem = self.method.tracking, self.problem
        driven = list(self.model.driven)
        names = [problem.states[index] for index in driven]
        usual = {
            name: _USUAL_STATE * size for name, size in zip(names, self._magnitudes[driven], strict=True)
        }
        state = self._weights(names, tracking.Q or usual)
        final = self._weights(names, tracking.S) if tracking.S else _FINAL_FACTOR * state
        controls = {
            name: _USUAL_CONTROL * scale
            for name, scale in zip(problem.controls, self.scales.controls, strict=True)
        }
        control = self._weights(list(problem.controls), {**controls, **tracking.R})
        horizon = None if tracking.horizon == "end" else int(tracking.horizon)
        return Tracker(self.model, Weights(state, control, final), self.limits, horizon)

    def _weights(self, names: list[str], tolerances: dict[str, Value] | dict[str, float]) -> Vector:
        """A diagonal matrix of 1/tolerance^2, 0 where nothing is asked."""
        values = [1.0 / self._number(tolerances[name]) ** 2 if name in tolerances else 0.0 for name in names]
        return np.diag(np.array(values, np.float64))


def _inside(bounds: tuple[float, float], part: float) -> float:
    lower, upper = (side if np.isfinite(side) else 1.0 for side in bounds)
    return lower + part * (upper - lower)
