"""Angles among the controls that differ by whole turns from node to node.

Nothing tells a heading of 7 rad from one of 0.72 rad, and each node of a mesh has its own: on the way from a
guess some go round. Between nodes the control then turns through all directions. Where whole turns change
nothing of a problem, an answer is unwound to where neighbours differ least.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.formulation.other_controls import is_named_at_the_ends
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

_TURN = 2.0 * np.pi
# What a turn may change, relative: the rounding of its sine.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Unwound:
    """An answer as a :class:`solvers.start.guess.Start`, some controls with more ``turns`` at its nodes."""

    answer: Trajectory
    turns: Mapping[int, Vector]

    @property
    def t0(self) -> float:
        """Initial time of the answer."""
        return self.answer.t0

    @property
    def tf(self) -> float:
        """Final time of the answer."""
        return self.answer.tf

    @property
    def design(self) -> Mapping[str, float]:
        """Design parameters of the answer."""
        return self.answer.design

    def states_at(self, tau: Vector) -> Vector:
        """See :class:`solvers.start.guess.Start`."""
        return self.answer.states_at(tau)

    def controls_at(self, tau: Vector) -> Vector:
        """See :class:`solvers.start.guess.Start`."""
        nodes, controls = self.answer.nodes, self.answer.controls_at(tau)
        values = self.answer.controls_at(nodes)
        for index, turns in self.turns.items():
            controls[index] = np.interp(tau, nodes, values[index] + _TURN * turns)
        return controls


def unwound(problem: OptimalControlProblem, answer: Trajectory) -> Unwound | None:
    """The answer without superfluous turns; None where it has none."""
    controls, turns = answer.controls_at(answer.nodes), dict[int, Vector]()
    for index, bounds in enumerate(problem.control_bounds):
        if np.isfinite(bounds).any() or not np.isfinite(controls[index]).all():
            continue
        needed = np.round((np.unwrap(controls[index]) - controls[index]) / _TURN)
        if needed.any() and _turns_back(problem, answer, controls, index):
            turns[index] = needed
    return Unwound(answer, turns) if turns else None


def _turns_back(problem: OptimalControlProblem, answer: Trajectory, controls: Vector, index: int) -> bool:
    """Whether a whole turn of a control changes nothing along the answer, nor at its ends."""
    if is_named_at_the_ends(problem, problem.controls[index]):
        return False
    turned = controls.copy()
    turned[index] += _TURN
    here, there = (_along(problem, answer, values) for values in (controls, turned))
    scale = np.maximum(np.abs(here).max(axis=1, keepdims=True), np.finfo(float).tiny)
    return bool(np.all(np.abs(here - there) <= _ROUNDING * scale))


def _along(problem: OptimalControlProblem, answer: Trajectory, controls: Vector) -> Vector:
    """All that holds or counts along the answer under these controls, a row each."""
    times, parameters = answer.time(answer.nodes), problem.parameters_of(answer)
    scope = problem.scope(answer.states_at(answer.nodes), controls, times, parameters, NUMPY)
    costs = [] if problem.running_cost is None else [problem.running_cost]
    every = [*costs, *(item.expression for item in problem.path)]
    every += [item.expression for item in problem.integrals]
    with np.errstate(all="ignore"):
        values = [item.evaluate(scope, NUMPY.functions) for item in every]
        values += problem.dynamics.rate(scope, NUMPY)
    return np.array(np.broadcast_arrays(*values, times)[:-1], np.float64)
