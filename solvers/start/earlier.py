"""What the parts of a flight take over from an earlier one, whose parts may be others.

A part is a phase, or the whole flight, without a name, where there are none. The phase of a name begins as
the phase of that name did. What is between such phases, here and there, is matched one by one where there
are as many; else the time that is left there is shared out, at times that are given, else as the guess has
it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solvers.part import Part
from solvers.phases.trajectory import AnyTrajectory
from solvers.spec import JobSpec
from solvers.start.guess import Guess, Start, WarmStart
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Excerpt:
    """An earlier flight from one time to another one, over one or several of its parts, or pieces of them."""

    parts: Sequence[Trajectory]
    t0: float
    tf: float

    @property
    def design(self) -> Mapping[str, float]:
        """See :class:`~solvers.start.guess.Earlier`."""
        return {name: value for part in self.parts for name, value in part.design.items()}

    def states_by_name(self, tau: Vector) -> Mapping[str, Vector]:
        """See :class:`~solvers.start.guess.Earlier`; NaN where a part does not have the state."""
        return self._joined([part.states_by_name(own) for part, own in self._shares(tau)], tau)

    def controls_by_name(self, tau: Vector) -> Mapping[str, Vector]:
        """See :class:`~solvers.start.guess.Earlier`; NaN where a part does not have the control."""
        return self._joined([part.controls_by_name(own) for part, own in self._shares(tau)], tau)

    def _owners(self, tau: Vector) -> NDArray[np.int64]:
        """The part of each instant: the second one where two meet, the first at the end of the excerpt."""
        meetings = [part.tf for part in self.parts[:-1]]
        times = self.t0 + (self.tf - self.t0) * tau
        last = np.searchsorted(meetings, self.tf, side="left")
        return np.asarray(np.minimum(np.searchsorted(meetings, times, side="right"), last), np.int64)

    def _shares(self, tau: Vector) -> Iterator[tuple[Trajectory, Vector]]:
        owners, times = self._owners(tau), self.t0 + (self.tf - self.t0) * tau
        for index, part in enumerate(self.parts):
            yield part, part.tau(times[owners == index])

    def _joined(self, shares: Sequence[Mapping[str, Vector]], tau: Vector) -> Mapping[str, Vector]:
        owners = self._owners(tau)
        found: dict[str, Vector] = {}
        for index, share in enumerate(shares):
            for name, values in share.items():
                found.setdefault(name, np.full(tau.size, np.nan))[owners == index] = values
        return found


Piece = Trajectory | Excerpt | None
"""What a part takes over: a part of the earlier flight as it is, an excerpt, or nothing."""


def taken_over(earlier: AnyTrajectory, parts: Sequence[Part]) -> list[Piece]:
    """What each part takes over from an earlier flight."""
    found: list[Piece] = []
    here = there = 0
    for own, other in [*_same_names(earlier, parts), (len(parts), len(earlier.parts))]:
        found += _shared_out(earlier.parts[there:other], parts[here:own])
        found += earlier.parts[other : other + 1]
        here, there = own + 1, other + 1
    return found


def starts_from(earlier: AnyTrajectory, parts: Sequence[Part]) -> list[Start]:
    """Where each part starts; what takes nothing over from its guess, when the part before it has ended."""
    starts: list[Start] = []
    for piece, part in zip(taken_over(earlier, parts), parts, strict=True):
        guess = part.problem.guess
        if piece is not None:
            starts.append(WarmStart(piece, guess, part.problem.states, part.problem.controls))
        elif starts:
            starts.append(replace(guess, t0=starts[-1].tf, tf=starts[-1].tf + _duration(guess)))
        else:
            starts.append(guess)
    return starts


def other_phases(
    spec: JobSpec, earlier: AnyTrajectory | None, parts: Sequence[Part]
) -> Iterator[dict[str, str]]:
    """Yield the warning that tells from what each part starts, where ``warm_start`` had other phases."""
    names = [part.name for part in parts]
    if earlier is None or spec.warm_start is None or names == list(earlier.names):
        return
    pieces = zip(names, taken_over(earlier, parts), strict=True)
    told = "; ".join(f"{_called(name)} starts from {_told(piece, earlier)}" for name, piece in pieces)
    yield {
        "code": "other_phases",
        "pointer": "/warm_start",
        "detail": f"The earlier job flew other phases: {told}.",
    }


def _same_names(earlier: AnyTrajectory, parts: Sequence[Part]) -> list[tuple[int, int]]:
    """Places here and there of the phases that both have; none where their orders differ."""
    there = {name: index for index, name in enumerate(earlier.names)}
    pairs = [(index, there[part.name]) for index, part in enumerate(parts) if part.name in there]
    return pairs if all(first[1] < second[1] for first, second in pairwise(pairs)) else []


def _shared_out(earlier: Sequence[Trajectory], parts: Sequence[Part]) -> list[Piece]:
    """What parts take over from as many parts of an earlier flight, or from more or fewer of them."""
    if len(earlier) == len(parts) or not earlier:
        return [*earlier] if earlier else [None] * len(parts)
    if not parts:
        return []
    t0, tf = earlier[0].t0, earlier[-1].tf
    guessed = [parts[0].problem.guess.t0, *(part.problem.guess.tf for part in parts)]
    given = [time for time in guessed[1:-1] if t0 < time < tf and _is_given(time, parts)]
    edges = np.interp(guessed, [guessed[0], *given, guessed[-1]], [t0, *given, tf])
    return [Excerpt(earlier, begin, end) for begin, end in pairwise(edges.tolist())]


def _is_given(time: float, parts: Sequence[Part]) -> bool:
    """Whether a phase is to end at that very time."""
    return any(part.problem.final_time == (time, time) for part in parts)


def _duration(guess: Guess) -> float:
    return guess.tf - guess.t0


def _called(name: str) -> str:
    return f"'{name}'" if name else "the flight"


def _told(piece: Piece, earlier: AnyTrajectory) -> str:
    if piece is None:
        return "the guess"
    if isinstance(piece, Excerpt):
        return f"what was flown from {piece.t0:.6g} to {piece.tf:.6g}"
    name = next(name for name, part in zip(earlier.names, earlier.parts, strict=True) if part is piece)
    return _called(name) if name else "the whole of it"
