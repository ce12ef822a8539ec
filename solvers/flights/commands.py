"""What the actuators are told: the control of an answer or its table, late by the delay of each control."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solvers.command import make_command, played
from solvers.flight import ControlledModel
from solvers.problem import OptimalControlProblem
from solvers.spec import CommandSpec
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

_INSIDE = 1e-11


@dataclass(frozen=True)
class Commands:
    """Commands (m,) over time: those of ``model`` between its ends, zero elsewhere, each with its delay (m,).

    ``start`` and ``end``: when the flight begins, and when the last command has had its effect.
    """

    model: ControlledModel
    flown: Trajectory
    delays: Vector

    @property
    def start(self) -> float:
        """When the flight begins."""
        return self.flown.t0

    @property
    def end(self) -> float:
        """When the last command has ended."""
        return self.flown.tf + float(np.max(self.delays, initial=0.0))

    @property
    def breakpoints(self) -> Vector:
        """Ascending times between which every command is smooth, the start and the end among them."""
        own = self.flown.time(self.model.breakpoints)
        every = np.concatenate([[self.start, self.end], *(own + delay for delay in np.unique(self.delays))])
        return np.unique(every)

    def at(self, times: Vector) -> Vector:
        """Commands (m, K) at K times."""
        values = np.zeros((self.delays.size, times.size))
        for delay in np.unique(self.delays):
            own = times - delay
            given = (own > self.flown.t0) & (own < self.flown.tf)
            if given.any():
                late = self.delays == delay
                values[np.ix_(late, given)] = self.model.clipped(self.flown.tau(own[given]))[late]
        return values


def inside(start: float, stop: float, parts: Vector) -> Vector:
    """The times at these parts of a step, its ends a little inside: what jumps there belongs to the step."""
    margin = _INSIDE * (stop - start) + 8.0 * np.spacing(max(abs(start), abs(stop)))
    return np.clip(start + (stop - start) * parts, start + margin, stop - margin)


def commands_of(
    problem: OptimalControlProblem, answer: Trajectory, table: CommandSpec | None, delays: Vector
) -> Commands:
    """The commands of an answer; ``table``: how its table is made, None where the control itself is flown.

    ``problem`` has the controls of the document, not their rates.
    """
    if table is not None:
        flown = played(make_command(table, problem, answer), problem, answer)
    else:
        curves = {**answer.states, **answer.controls}
        flown = replace(
            answer,
            states={name: answer.states[name] for name in problem.states},
            controls={name: curves[name] for name in problem.controls},
        )
    scale = np.ones(len(problem.states))
    return Commands(ControlledModel(problem, flown, scale, math.inf), flown, delays)
