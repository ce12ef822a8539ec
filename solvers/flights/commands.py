"""What the actuators are told: the control of an answer or its table, late by the delay of each control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.quantities import FREE
from solvers.formulation.time_knots import flight_corners
from solvers.output.command import make_command, played
from solvers.spec import CommandSpec
from solvers.verification.flown_controls import FlownControls
from solvers.verification.legs import Leg

Vector = NDArray[np.float64]
Rows = NDArray[np.intp]

_INSIDE = 1e-11


@dataclass(frozen=True)
class Commands:
    """Commands over time, from the begin of a flight to when the last one has had its effect.

    Those of ``pieces``, which follow each other, each late by the delay of its control (0 where none is
    named); zero where no piece has the control.
    """

    pieces: Sequence[FlownControls]
    delays: Mapping[str, float]

    @property
    def start(self) -> float:
        """When the flight begins."""
        return self.pieces[0].trajectory.t0

    @property
    def end(self) -> float:
        """When the last command has ended."""
        return self.pieces[-1].trajectory.tf + max(self.delays.values(), default=0.0)

    def breakpoints(self, start: float, end: float) -> Vector:
        """Ascending times between which every command is smooth, from one time to another one."""
        own = np.concatenate([piece.trajectory.time(piece.breakpoints) for piece in self.pieces])
        controls = {name for piece in self.pieces for name in piece.trajectory.controls}
        every = np.concatenate([own + delay for delay in {self.delays.get(name, 0.0) for name in controls}])
        return np.concatenate([[start], np.unique(every[(every > start) & (every < end)]), [end]])

    def told(self, controls: Sequence[str]) -> Told:
        """The commands of these controls."""
        delays = [self.delays.get(name, 0.0) for name in controls]
        sources = []
        for piece in self.pieces:
            columns = {name: column for column, name in enumerate(piece.trajectory.controls)}
            for delay in sorted({*delays}):
                rows = [row for row, name in enumerate(controls) if name in columns and delays[row] == delay]
                if rows:
                    own = np.array([columns[controls[row]] for row in rows])
                    sources.append((delay, piece, np.array(rows), own))
        return Told(len(controls), sources)

    def sizes(self, controls: Sequence[str]) -> Vector:
        """The largest magnitude (m,) of each of these controls."""
        largest = dict.fromkeys(controls, 0.0)
        for piece in self.pieces:
            values = np.abs(piece.clipped(piece.breakpoints)).max(axis=1)
            for name, value in zip(piece.trajectory.controls, values, strict=True):
                largest[name] = max(largest.get(name, 0.0), float(value))
        return np.array([largest[name] for name in controls], np.float64)


@dataclass(frozen=True)
class Told:
    """Commands of some controls over time.

    ``sources``: a delay, the piece that comes late by it, and which rows are which of its controls.
    """

    count: int
    sources: Sequence[tuple[float, FlownControls, Rows, Rows]]

    def at(self, times: Vector) -> Vector:
        """Commands (m, K) at K times."""
        values = np.zeros((self.count, times.size))
        for delay, piece, rows, columns in self.sources:
            flown, own = piece.trajectory, times - delay
            given = (own > flown.t0) & (own < flown.tf)
            if given.any():
                values[np.ix_(rows, given)] = piece.clipped(flown.tau(own[given]))[columns]
        return values


def inside(start: float, stop: float, parts: Vector) -> Vector:
    """The times at these parts of a step, its ends a little inside: what jumps there belongs to the step."""
    margin = _INSIDE * (stop - start) + 8.0 * np.spacing(max(abs(start), abs(stop)))
    return np.clip(start + (stop - start) * parts, start + margin, stop - margin)


def commands_of(legs: Sequence[Leg], table: CommandSpec | None, delays: Mapping[str, float]) -> Commands:
    """The commands of an answer, whose ``legs`` have the controls of the document, not their rates.

    ``table``: how its table is made, None where the control itself is flown.
    """
    if table is None:
        return Commands([_own(leg) for leg in legs], delays)
    command = make_command(table, legs)
    flown = played(command, command.controls, legs[0].answer.t0, command.end)
    corners = np.concatenate([flight_corners(leg.problem, flown) for leg in legs])
    return Commands([FlownControls(flown, [FREE] * len(command.controls), corners)], delays)


def _own(leg: Leg) -> FlownControls:
    """The controls of a leg itself."""
    answer, problem = leg.answer, leg.problem
    curves = {**answer.states, **answer.controls}
    flown = replace(answer, controls={name: curves[name] for name in problem.controls})
    return FlownControls(flown, problem.control_bounds, flight_corners(problem, answer))
