"""The structure of an answer: which control rests on which bound and which limit is followed, arc by arc."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.limits import Limit
from solvers.problem import OptimalControlProblem
from solvers.switching import is_switched
from solvers.trajectory import Trajectory
from solvers.transcription.limit_rates import LimitRates
from solvers.transcription.multi_arc import Follow

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]

SHORTEST_ARC = 1e-5
"""Instants closer than this part of the horizon are one instant."""

# Pinned controls keep a trajectory on a limit if it stays within this part of the quantity's range.
_IDLE = 1e-3
_INSIDE = np.array([0.1, 0.3, 0.5, 0.7, 0.9])


@dataclass(frozen=True)
class Pieces:
    """A control that changes from one of R ``levels`` (NaN: free) to the next at R - 1 ``instants``."""

    instants: Vector
    levels: Vector

    def at(self, edges: Vector) -> Vector:
        """The levels between ``edges``, among which all instants are."""
        return self.levels[np.searchsorted(self.instants, (edges[1:] + edges[:-1]) / 2.0)]


@dataclass(frozen=True)
class Structure:
    """S arcs between normalised ``edges`` (S + 1).

    ``pinned``: for each control S values, NaN where it is free; ``followed``: for each limit which of the
    arcs follow it; ``touched``: which of the arcs start where it is touched; ``rates``: those of all limits
    that are active somewhere.
    """

    edges: Vector
    pinned: Mapping[str, Vector]
    followed: Mapping[Limit, Flags] = field(default_factory=dict)
    touched: Mapping[Limit, Flags] = field(default_factory=dict)
    rates: Mapping[Limit, LimitRates] = field(default_factory=dict)

    @property
    def arcs(self) -> int:
        """The number S of arcs."""
        return self.edges.size - 1

    @property
    def pattern(self) -> Hashable:
        """What is the same for structures that differ in instants only."""
        levels = tuple(
            tuple(values.tolist()) for values in np.nan_to_num([*self.pinned.values()], nan=np.inf)
        )
        flags = tuple(
            tuple((limit.pointer, limit.upper, *arcs.tolist()) for limit, arcs in which.items())
            for which in (self.followed, self.touched)
        )
        return levels, flags

    @property
    def is_free(self) -> bool:
        """Whether a control is free anywhere."""
        return bool(np.isnan([*self.pinned.values()]).any())

    @property
    def is_decided(self) -> bool:
        """Whether every control rests on a bound or is decided by a limit that is followed, everywhere."""
        return bool(self.decided_arcs.all())

    @property
    def decided_arcs(self) -> Flags:
        """The arcs on which every control rests on a bound or is decided by a limit that is followed."""
        free = np.isnan([*self.pinned.values()]).reshape(-1, self.arcs).sum(axis=0)
        return np.asarray(free <= sum(self.followed.values(), np.zeros(self.arcs, int)))

    @property
    def entry_conditions(self) -> int:
        """The number of equations that hold where limits begin to be followed or are touched."""
        entries = [
            int(flags[1:][~flags[:-1]].sum()) * self.rates[limit].order
            for limit, flags in self.followed.items()
        ]
        touches = [
            int(flags.sum()) * min(self.rates[limit].order, 2) + len(self._tangent(limit))
            for limit, flags in self.touched.items()
        ]
        return sum(entries) + sum(touches)

    def follows(self, problem: OptimalControlProblem, trajectory: Trajectory) -> tuple[Follow, ...]:
        """The limits with their arcs, as the multi-arc program wants them."""
        none = np.zeros(self.arcs, bool)
        found = []
        for limit, rates in self.rates.items():
            arcs, touched = (
                tuple(np.flatnonzero(which.get(limit, none)).tolist())
                for which in (self.followed, self.touched)
            )
            idle = self._idle(problem, trajectory, limit)
            if arcs or touched or idle:
                parted, tangent = self._parted(problem, trajectory, limit), self._tangent(limit)
                found.append(Follow(limit, rates, arcs, touched, idle, parted, tangent))
        return tuple(found)

    def _tangent(self, limit: Limit) -> tuple[int, ...]:
        """The arcs that start where a limit of order 1 is touched while every control goes on as decided."""
        if self.rates[limit].order != 1 or limit not in self.touched:
            return ()
        decided = self.decided_arcs
        return tuple(
            arc
            for arc in np.flatnonzero(self.touched[limit]).tolist()
            if arc and decided[[arc - 1, arc]].all() and self._alike(arc - 1, arc)
        )

    def _parted(
        self, problem: OptimalControlProblem, trajectory: Trajectory, limit: Limit
    ) -> tuple[tuple[int, int], ...]:
        """The arcs that follow a limit and the sides on which the control rests on a bound through the limit.

        With S <= 0 and S = ... = S^(q-1) = 0 at an edge, S^(q) must not be positive behind it, nor
        (-1)^q S^(q) before it.
        """
        rates, flags = self.rates[limit], self.followed.get(limit, np.zeros(self.arcs, bool))
        if len(rates.controls) != 1:
            return ()
        (control,) = rates.controls
        lower, upper = problem.control_bounds[control]
        pinned, found = self.pinned[problem.controls[control]], []
        for arc, side in product(np.flatnonzero(flags).tolist(), (0, 1)):
            other = arc + 2 * side - 1
            if not 0 <= other < self.arcs or flags[other] or np.isnan(pinned[other]) or lower == upper:
                continue
            at = self.edges[[arc + side]]
            controls = np.repeat(trajectory.controls_at(at), 2, axis=1)
            resting = pinned[other]
            controls[control] = [resting, resting + (1.0 if resting == lower else -1.0)]
            values = rates.along(
                problem.parameters_of(trajectory),
                np.repeat(trajectory.states_at(at), 2, axis=1),
                controls,
                np.repeat(trajectory.time(at), 2),
            )
            rise = values[-1, 0] - values[-1, 1]
            outward = rise if limit.upper else -rise
            if side == 0 and rates.order % 2:
                outward = -outward
            if outward > 0.0:
                found.append((arc, side))
        return tuple(found)

    def _idle(self, problem: OptimalControlProblem, trajectory: Trajectory, limit: Limit) -> tuple[int, ...]:
        """Arcs along which pinned controls alone keep the trajectory on a limit."""
        rates, idle = self.rates[limit], []
        own_range = max(float(np.ptp(limit.room(problem, trajectory, trajectory.nodes))), 1e-9)
        pinned = np.array([*self.pinned.values()]).reshape(-1, self.arcs)
        for arc, (start, stop) in enumerate(pairwise(self.edges)):
            if not np.isnan(pinned[list(rates.controls), arc]).any():
                tau = start + (stop - start) * _INSIDE
                controls = np.where(np.isnan(pinned[:, [arc]]), trajectory.controls_at(tau), pinned[:, [arc]])
                values = rates.along(
                    problem.parameters_of(trajectory),
                    trajectory.states_at(tau),
                    controls,
                    trajectory.time(tau),
                )
                values[0] -= limit.level
                lengths = ((stop - start) * trajectory.duration) ** np.arange(rates.order + 1)
                if np.max(np.abs(values * lengths[:, None])) <= _IDLE * own_range:
                    idle.append(arc)
        return tuple(idle)

    def without_empty_arcs(self) -> Structure:
        """Arcs of no length dropped, neighbours that are alike joined; a limit followed there is touched."""
        lasting = np.diff(self.edges) > SHORTEST_ARC
        touched = {limit: flags.copy() for limit, flags in self.touched.items()}
        for limit, flags in self.followed.items():
            for arc in np.flatnonzero(flags & ~lasting):
                if 0 < arc < self.arcs - 1 and not flags[[arc - 1, arc + 1]].any():
                    touched.setdefault(limit, np.zeros(self.arcs, bool))[arc + 1] = True
        for flags in touched.values():
            for arc in np.flatnonzero(flags & ~lasting)[::-1]:
                flags[arc] = False
                if arc + 1 < self.arcs:
                    flags[arc + 1] = True
        starts: list[int] = []
        for arc in np.flatnonzero(lasting):
            touch = any(flags[arc] for flags in touched.values())
            if not starts or touch or not self._alike(starts[-1], int(arc)):
                starts.append(int(arc))
        return Structure(
            np.concatenate([[0.0], self.edges[starts[1:]], [1.0]]),
            {name: values[starts] for name, values in self.pinned.items()},
            present({limit: flags[starts] for limit, flags in self.followed.items()}),
            present({limit: flags[starts] for limit, flags in touched.items()}),
            self.rates,
        )

    def changed(
        self, problem: OptimalControlProblem, levels: Mapping[str, Sequence[Pieces | None]]
    ) -> Structure:
        """Arcs cut: for each control, arc by arc, its new pieces, or None where the arc stays as it is.

        A limit is still followed where it was and a control that decides is free.
        """
        controls = {}
        for name, arcs in levels.items():
            whole = [
                Pieces(np.zeros(0), self.pinned[name][[arc]]) if pieces is None else pieces
                for arc, pieces in enumerate(arcs)
            ]
            ends = [[edge] for edge in self.edges[1:-1]] + [[]]
            instants = [
                part for pieces, end in zip(whole, ends, strict=True) for part in (pieces.instants, end)
            ]
            controls[name] = Pieces(np.concatenate(instants), np.concatenate([item.levels for item in whole]))
        edges = distinct(np.concatenate([self.edges[1:-1], *[item.instants for item in controls.values()]]))
        owner = np.searchsorted(self.edges, (edges[1:] + edges[:-1]) / 2.0) - 1
        first = np.diff(owner, prepend=-1) > 0
        return Structure(
            edges,
            {name: pieces.at(edges) for name, pieces in controls.items()},
            {limit: flags[owner] for limit, flags in self.followed.items()},
            {limit: flags[owner] & first for limit, flags in self.touched.items()},
            self.rates,
        ).decided(problem)

    def following(self, problem: OptimalControlProblem, active: Mapping[Limit, Flags]) -> Structure:
        """The same, with every limit also followed on the free arcs along which it is ``active``."""
        none = np.zeros(self.arcs, bool)
        followed = {limit: self.followed.get(limit, none) | flags for limit, flags in active.items()}
        return replace(self, followed=present(followed)).decided(problem)

    def without(self, limit: Limit) -> Structure:
        """The same, but ``limit`` neither followed nor touched."""
        return replace(
            self,
            followed={other: flags for other, flags in self.followed.items() if other != limit},
            touched={other: flags for other, flags in self.touched.items() if other != limit},
        ).without_empty_arcs()

    def switching(self, problem: OptimalControlProblem, trajectory: Trajectory) -> dict[str, Any]:
        """The ``switching`` of a result: for each control with two bounds its times, levels and arcs."""
        found = {}
        for name, bounds in zip(problem.controls, problem.control_bounds, strict=True):
            if is_switched(bounds):
                levels = self.pinned[name]
                same = (levels[1:] == levels[:-1]) | (np.isnan(levels[1:]) & np.isnan(levels[:-1]))
                starts = np.concatenate([[0], 1 + np.flatnonzero(~same)])
                found[name] = {
                    "times": trajectory.time(self.edges[starts[1:]]).tolist(),
                    "levels": [None if np.isnan(level) else float(level) for level in levels[starts]],
                    "arcs": [_kind(level, bounds) for level in levels[starts]],
                }
        return found

    def decided(self, problem: OptimalControlProblem) -> Structure:
        """Limits followed only along arcs on which a control that decides is free; alike arcs joined."""
        followed = {}
        for limit, flags in self.followed.items():
            names = [problem.controls[index] for index in self.rates[limit].controls]
            free = np.any([np.isnan(self.pinned[name]) for name in names], axis=0)
            followed[limit] = flags & free
        return replace(self, followed=present(followed)).without_empty_arcs()

    def _alike(self, first: int, second: int) -> bool:
        return all(
            np.array_equal(values[first], values[second], equal_nan=True) for values in self.pinned.values()
        ) and all(flags[first] == flags[second] for flags in self.followed.values())


def distinct(instants: Vector) -> Vector:
    """The instants in order between 0 and 1, without those next to another one or to an end."""
    kept = [0.0]
    for instant in np.sort(instants):
        if instant - kept[-1] > SHORTEST_ARC and 1.0 - instant > SHORTEST_ARC:
            kept.append(float(instant))
    return np.array([*kept, 1.0])


def present(which: Mapping[Limit, Flags]) -> dict[Limit, Flags]:
    """Those of the limits that have an arc."""
    return {limit: flags for limit, flags in which.items() if flags.any()}


def _kind(level: float, bounds: tuple[float, float]) -> str:
    return "interior" if np.isnan(level) else "lower" if level == bounds[0] else "upper"
