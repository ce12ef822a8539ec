"""Where a solve starts: the document's guess, and straight lines where it says nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.spec import Guess as GuessSpec
from solvers.spec import evaluate_constant

Vector = NDArray[np.float64]
Interval = tuple[float, float]
Ends = tuple[tuple[Interval, ...], tuple[Interval, ...]]
WHOLE = np.array([0.0, 1.0])


class Spanned(Protocol):
    """What begins and ends."""

    @property
    def t0(self) -> float:
        """Initial time."""
        ...

    @property
    def tf(self) -> float:
        """Final time."""
        ...

    @property
    def design(self) -> Mapping[str, float]:
        """Values of design parameters by name."""
        ...


class Start(Spanned, Protocol):
    """Where a transcription starts: a guess, or the trajectory of an earlier solve on any mesh."""

    def states_at(self, tau: Vector) -> Vector:
        """States at K instants of normalised time, (n, K)."""
        ...

    def controls_at(self, tau: Vector) -> Vector:
        """Controls at K instants of normalised time, (m, K)."""
        ...


class Earlier(Spanned, Protocol):
    """An earlier answer, or a piece of it."""

    def states_by_name(self, tau: Vector) -> Mapping[str, Vector]:
        """States at K instants of normalised time by name, (K,) each."""
        ...

    def controls_by_name(self, tau: Vector) -> Mapping[str, Vector]:
        """Controls at K instants of normalised time by name, (K,) each."""
        ...


@dataclass(frozen=True)
class WarmStart:
    """An earlier answer, of any method and mesh; what it does not name is taken from a guess."""

    earlier: Earlier
    guess: Guess
    states: tuple[str, ...]
    controls: tuple[str, ...]

    @property
    def t0(self) -> float:
        """Initial time of the earlier answer."""
        return self.earlier.t0

    @property
    def tf(self) -> float:
        """Final time of the earlier answer."""
        return self.earlier.tf

    @property
    def design(self) -> Mapping[str, float]:
        """Design parameters of the earlier answer."""
        return self.earlier.design

    def states_at(self, tau: Vector) -> Vector:
        """See :class:`Start`."""
        # What is a state here may have been a control there.
        known = {**self.earlier.controls_by_name(tau), **self.earlier.states_by_name(tau)}
        return _named(known, self.states, self.guess.states_at(tau))

    def controls_at(self, tau: Vector) -> Vector:
        """See :class:`Start`."""
        return _named(self.earlier.controls_by_name(tau), self.controls, self.guess.controls_at(tau))


@dataclass(frozen=True)
class Guess:
    """States and controls as piecewise linear functions of normalised time tau in [0, 1].

    ``states`` and ``controls`` hold a pair (tau, values) for each name in order. Design parameters start from
    the guesses that the problem has of them. ``default``: the document says nothing of states and controls.
    """

    t0: float
    tf: float
    states: tuple[tuple[Vector, Vector], ...]
    controls: tuple[tuple[Vector, Vector], ...]
    design: Mapping[str, float] = field(default_factory=dict)
    default: bool = False

    def with_rates(self, index: Sequence[int]) -> Guess:
        """The guess in which these controls are the last states, and their slopes stand in their places."""
        controls = list(self.controls)
        for j in index:
            tau, values = self.controls[j]
            slopes = np.gradient(values, tau) if tau.size > 1 else np.zeros(1)
            controls[j] = tau, slopes / (self.tf - self.t0)
        return replace(
            self,
            states=(*self.states, *(self.controls[j] for j in index)),
            controls=tuple(controls),
        )

    def states_at(self, tau: Vector) -> Vector:
        """States at K instants, (n, K)."""
        return _sample(self.states, tau)

    def controls_at(self, tau: Vector) -> Vector:
        """Controls at K instants, (m, K)."""
        return _sample(self.controls, tau)


def make_guess(
    spec: GuessSpec,
    states: Sequence[str],
    controls: Sequence[str],
    parameters: dict[str, float],
    *,
    times: tuple[Interval, Interval],
    ends: Ends,
    bounds: Ends,
    design: Mapping[str, float],
) -> Guess:
    """Build the guess of a document.

    Default: straight lines between the known ends (a free end takes the other end's value, else the middle of
    the bounds, else 0); controls at the middle of two-sided bounds, else the value nearest to 0 inside them;
    the final time at the geometric mean of its bounds, max(2 lower, 1) without an upper one.
    """
    t0 = _middle(times[0])
    if spec.final_time is not None:
        tf = evaluate_constant(spec.final_time, parameters)
    elif spec.from_result is not None:
        tf = evaluate_constant(spec.from_result["t"][-1], parameters)
    else:
        tf = default_final_time(times[1], t0)
    return Guess(
        t0,
        tf,
        tuple(
            _history(spec, name, parameters, times=(t0, tf))
            or (WHOLE, _line(ends[0][i], ends[1][i], bounds[0][i]))
            for i, name in enumerate(states)
        ),
        tuple(
            _history(spec, name, parameters, times=(t0, tf)) or (WHOLE, np.full(2, _middle(bounds[1][j])))
            for j, name in enumerate(controls)
        ),
        design,
        default=not spec.states and not spec.controls and spec.from_result is None,
    )


def _named(known: Mapping[str, Vector], names: Sequence[str], otherwise: Vector) -> Vector:
    """Values by name, (n, K); those of ``otherwise`` (n, K) where they are not known.

    A state of one of several plants, ``name@case``, may begin as the state of the only plant did.
    """
    rows = otherwise.copy()
    for name, row in zip(names, rows, strict=True):
        values = known.get(name, known.get(name.partition("@")[0]))
        if values is not None:
            np.copyto(row, values, where=~np.isnan(values))
    return rows


def _sample(pieces: Sequence[tuple[Vector, Vector]], tau: Vector) -> Vector:
    return np.array([np.interp(tau, *piece) for piece in pieces]).reshape(len(pieces), tau.size)


def _middle(interval: Interval) -> float:
    lower, upper = interval
    if math.isfinite(lower) and math.isfinite(upper):
        return 0.5 * (lower + upper)
    return min(max(0.0, lower), upper)


def default_final_time(interval: Interval, initial_time: float) -> float:
    """Where a search for a final time within an interval starts if the document does not say."""
    lower, upper = interval
    if np.isfinite(lower) and np.isfinite(upper):
        return float(np.sqrt(lower * upper)) if lower > 0 else 0.5 * (lower + upper)
    if np.isfinite(upper):
        return 0.5 * (initial_time + upper)
    return max(2 * lower, 1.0) if np.isfinite(lower) else initial_time + 1.0


def _line(start: Interval, stop: Interval, bounds: Interval) -> Vector:
    ends = [_middle(end) if any(map(math.isfinite, end)) else None for end in (start, stop)]
    known = [value for value in ends if value is not None]
    fallback = known[0] if known else _middle(bounds)
    return np.array([fallback if value is None else value for value in ends])


def _history(
    spec: GuessSpec, name: str, parameters: dict[str, float], *, times: Interval
) -> tuple[Vector, Vector] | None:
    """What the document gives for a state or control, over normalised time."""
    given = spec.history(name, parameters)
    if given is None:
        return _earlier(spec.from_result or {}, name, parameters)
    instants, values = given
    if instants is None:
        return np.linspace(0.0, 1.0, len(values)), np.array(values)
    return (np.array(instants) - times[0]) / (times[1] - times[0]), np.array(values)


def _earlier(
    nodes: Mapping[str, Any], name: str, parameters: dict[str, float]
) -> tuple[Vector, Vector] | None:
    """The nodes of an earlier result, its own time span stretched to [0, 1]."""
    values = nodes.get("states", {}).get(name, nodes.get("controls", {}).get(name))
    if values is None:
        return None
    times = np.array([evaluate_constant(time, parameters) for time in nodes["t"]])
    having = [index for index, value in enumerate(values) if value is not None]
    if not having:
        return None
    tau = (times - times[0]) / (times[-1] - times[0])
    return tau[having], np.array([evaluate_constant(values[index], parameters) for index in having])
