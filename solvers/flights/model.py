"""The model of an answer whose numbers differ from flight to flight."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.kernel import Kernels
from solvers.backends import NUMPY
from solvers.expressions import parse
from solvers.formulation.dynamics import NodeScope
from solvers.formulation.quantities import FREE, DesignParameter
from solvers.formulation.scenarios import NOMINAL
from solvers.genetic.model import ArrayModel
from solvers.problem import End, OptimalControlProblem
from solvers.spec import ProblemSpec
from solvers.verification.legs import Leg

Vector = NDArray[np.float64]


def dispersed(leg: Leg, names: Collection[str]) -> Leg:
    """The leg whose model has these of its parameters as unknown numbers.

    They stand among the design parameters; what follows from them is a definition.
    """
    problem, model = leg.problem, leg.spec.model
    fixed = _own_parameters(leg.spec, leg.name)
    following = [name for name in model.depending_on(names) if name not in {*names, *fixed}]
    free = {name: problem.parameters[name] for name in names if name in problem.parameters}
    drawn = replace(
        problem,
        parameters={
            name: value for name, value in problem.parameters.items() if name not in {*free, *following}
        },
        definitions={
            **{name: parse(model.parameters[name]) for name in following},
            **problem.definitions,
        },
        design=(
            *problem.design,
            *(DesignParameter(name, FREE, value) for name, value in free.items()),
        ),
    )
    return replace(leg, problem=drawn)


def _own_parameters(spec: ProblemSpec, plant: str) -> Mapping[str, Any]:
    """The parameters that a scenario gives to the leading plant."""
    cases = [] if spec.scenarios is None else spec.scenarios.cases
    return next((case.parameters for case in cases if case.name == plant and plant != NOMINAL), {})


class Fleet:
    """The model of P flights at once.

    Its states (n + l + 1 + i, P) are those of the problem, the l controls with a lag as the actuators give
    them, the running cost and the integrals. ``design`` (d, P): the unknown numbers; ``lags`` (m,).
    """

    def __init__(self, problem: OptimalControlProblem, design: Vector, lags: Vector) -> None:
        self.problem = problem
        self.states = len(problem.states)
        self._design, self._lagging = design, np.flatnonzero(lags > 0.0)
        self._lags = lags[self._lagging][:, None]
        model = ArrayModel(problem)
        outputs = [*model.rates, model.running_cost, *model.integrands]
        self._kernel = Kernels(outputs, model.inputs).at(design.shape[1])
        self._kernel.inputs[self.states + len(problem.controls) : -2] = design
        parameters = {item.name: row for item, row in zip(problem.design, design, strict=True)}
        self.parameters: dict[str, Any] = {**problem.parameters, **parameters}

    @property
    def size(self) -> int:
        """The number of states of one flight, all that belongs to it counted."""
        return self.states + self._lagging.size + 1 + len(self.problem.integrals)

    def sizes(self, of_states: Vector, of_controls: Vector) -> Vector:
        """Magnitudes of all states of a flight; infinite for what is integrated along."""
        along = np.full(1 + len(self.problem.integrals), np.inf)
        return np.concatenate([of_states, of_controls[self._lagging], along])

    def rate(self, states: Vector, commands: Vector, t: float, rates: Vector) -> None:
        """Fill in the rates (size, P) under the commands (m,)."""
        n, lagging = self.states, self._lagging.size
        inputs, outputs = self._kernel.inputs, self._kernel.outputs
        inputs[:n] = states[:n]
        self._feel(states, commands, inputs[n : n + commands.size])
        inputs[-2] = t
        self._kernel.run()
        rates[:n] = outputs[:n]
        rates[n : n + lagging] = (commands[self._lagging][:, None] - states[n : n + lagging]) / self._lags
        rates[n + lagging :] = outputs[n:]

    def controls(self, states: Vector, commands: Vector) -> Vector:
        """The controls (m, P) that the model feels."""
        felt = np.empty((commands.size, states.shape[1]))
        self._feel(states, commands, felt)
        return felt

    def _feel(self, states: Vector, commands: Vector, felt: Vector) -> None:
        felt[:] = commands[:, None]
        felt[self._lagging] = states[self.states : self.states + self._lagging.size]

    def begin(self, states: Vector, felt: Mapping[str, Vector]) -> Vector:
        """All states of flights that begin in ``states`` (n, P), with what actuators give (P,), else zero."""
        everything = np.zeros((self.size, states.shape[1]))
        everything[: self.states] = states
        for row, name in enumerate(self._names, self.states):
            everything[row] = felt.get(name, 0.0)
        return everything

    def given(self, states: Vector) -> dict[str, Vector]:
        """What lagging actuators give (P,), by control."""
        return {name: states[row].copy() for row, name in enumerate(self._names, self.states)}

    @property
    def _names(self) -> list[str]:
        return [self.problem.controls[index] for index in self._lagging]

    def switch_off(self, states: Vector) -> None:
        """Set what lagging actuators give to zero."""
        states[self.states : self.states + self._lagging.size] = 0.0

    def integrals(self, states: Vector) -> Vector:
        """The running cost and the integrals so far, (1 + i, P)."""
        return states[self.states + self._lagging.size :]

    def scope(self, states: Vector, controls: Vector, t: float) -> NodeScope:
        """The names of an instant, with values (P,)."""
        times = np.full(states.shape[1], t)
        return self.problem.scope(states[: self.states], controls, times, self.parameters, NUMPY)

    def ends_scope(self, initial: End, final: End, integrals: Sequence[Vector]) -> dict[str, Any]:
        """The names of both ends (states, controls, time), with values (P,)."""
        return self.problem.ends_scope(initial, final, self.parameters, NUMPY, integrals)
