"""Where a bounded control rests on its bounds, and where it switches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.quantities import Interval
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

# A node counts as on a bound within this part of the range between the bounds, or of the control's own range.
_ON_BOUND = 0.02
SHORTEST_INTERIOR = 4
"""An interior stretch of fewer nodes than this between two bounds is a switch seen through the mesh."""

# A visit to a bound is chatter of a singular arc if it is shorter than this many nodes ...
_CHATTER = 4
# ... and its switching function stays below this part of the largest.
_WEAK = 1e-2


@dataclass(frozen=True)
class ControlArc:
    """Nodes ``first`` to ``last`` of a trajectory, where a control is ``lower``, ``upper``, ``interior``."""

    first: int
    last: int
    kind: str

    @property
    def nodes(self) -> int:
        """The number of nodes."""
        return self.last - self.first + 1

    def level(self, bounds: Interval) -> float | None:
        """The bound that the control rests on, None inside."""
        return {"lower": bounds[0], "upper": bounds[1]}.get(self.kind)


def find_switching(problem: OptimalControlProblem, trajectory: Trajectory) -> dict[str, Any]:
    """The ``switching`` of a result: for each control with two bounds its switch times, levels and arcs.

    Read off the control on its nodes: a switch is placed where the control crosses the middle between the
    levels of the arcs that meet, so it is as sharp as the mesh. ``times`` lie strictly inside (t0, tf).
    """
    found = {}
    for name, bounds in zip(problem.controls, problem.control_bounds, strict=True):
        if is_switched(bounds):
            values = trajectory.controls[name](trajectory.nodes)
            arcs = control_arcs(values, bounds)
            found[name] = {
                "times": trajectory.time(switch_instants(trajectory.nodes, values, bounds, arcs)).tolist(),
                "levels": [arc.level(bounds) for arc in arcs],
                "arcs": [arc.kind for arc in arcs],
            }
    return found


def is_switched(bounds: Interval) -> bool:
    """Whether a control has two bounds and room between them."""
    return bool(np.isfinite(bounds).all()) and bounds[0] < bounds[1]


def control_arcs(
    values: Vector,
    bounds: Interval,
    strength: Vector | None = None,
    held: NDArray[np.bool_] | None = None,
) -> list[ControlArc]:
    """Arcs in order, from a control at K nodes; a few interior nodes between two bounds are no arc.

    ``strength`` (K,): the magnitude of the switching function relative to its largest. Where it is given,
    short visits to bounds amid interior nodes that it does not support count as interior. ``held`` (K,):
    where a limit decides the control; it is not free there, so that what lies beside is no chatter.
    """
    nearer = np.where(values - bounds[0] < bounds[1] - values, "lower", "upper")
    kinds = np.where(inside(values, bounds), "interior", nearer)
    if strength is not None:
        decided = (kinds == "interior") & (False if held is None else held)
        kinds = _without_chatter(np.where(decided, "held", kinds), strength)
        kinds = np.where(kinds == "held", "interior", kinds)
    runs = list(_runs(kinds))
    lasting = [
        run for run in runs if len(runs) == 1 or run.kind != "interior" or run.nodes >= SHORTEST_INTERIOR
    ]
    return _joined(lasting or runs[:1])


def inside(values: Vector, bounds: Interval) -> NDArray[np.bool_]:
    """Which values lie between the bounds and on neither."""
    width = bounds[1] - bounds[0]
    margin = _ON_BOUND * (width if np.isfinite(width) else max(float(np.ptp(values)), 1e-6))
    return np.asarray((values > bounds[0] + margin) & (values < bounds[1] - margin))


def switch_instants(tau: Vector, values: Vector, bounds: Interval, arcs: Sequence[ControlArc]) -> Vector:
    """Where arcs meet, in ``tau``: midway, between two bounds where the control crosses their middle."""
    instants = []
    for before, after in pairwise(arcs):
        if "interior" in (before.kind, after.kind):
            instants.append(0.5 * (tau[before.last] + tau[after.first]))
        else:
            stretch = slice(before.last, after.first + 1)
            crossing = values[stretch] - 0.5 * (bounds[0] + bounds[1])
            instants.append(float(np.interp(0.0, *_ascending(crossing, tau[stretch]))))
    return np.array(instants)


def _without_chatter(kinds: NDArray[np.str_], strength: Vector) -> NDArray[np.str_]:
    """Interior nodes and weak short visits to bounds between them, together, as interior."""
    runs = list(_runs(kinds))
    loose = [
        run.kind == "interior" or (run.nodes < _CHATTER and strength[run.first : run.last + 1].max() < _WEAK)
        for run in runs
    ]
    result = kinds.copy()
    for is_loose, group in groupby(range(len(runs)), key=loose.__getitem__):
        members = [runs[index] for index in group]
        inside = sum(run.nodes for run in members if run.kind == "interior")
        nodes = slice(members[0].first, members[-1].last + 1)
        if is_loose and inside >= SHORTEST_INTERIOR and 3 * inside >= nodes.stop - nodes.start:
            result[nodes] = "interior"
    return result


def _runs(kinds: NDArray[np.str_]) -> Iterator[ControlArc]:
    edges = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1
    for start, stop in pairwise([0, *edges.tolist(), kinds.size]):
        yield ControlArc(start, stop - 1, str(kinds[start]))


def _joined(runs: Sequence[ControlArc]) -> list[ControlArc]:
    """Neighbours of one kind as one arc."""
    joined: list[ControlArc] = []
    for run in runs:
        if joined and joined[-1].kind == run.kind:
            run = ControlArc(joined.pop().first, run.last, run.kind)
        joined.append(run)
    return joined


def _ascending(crossing: Vector, tau: Vector) -> tuple[Vector, Vector]:
    """Abscissae and ordinates for inverse interpolation, made ascending."""
    return (crossing, tau) if crossing[-1] > crossing[0] else (crossing[::-1], tau[::-1])
