"""Where an answer will be that lies in a row with others: the polynomial through them, carried on.

A predictor of numerical continuation (E. L. Allgower, K. Georg, Numerical Continuation Methods, 1990): from k
answers a step h apart its error is of the order h^k, that of the nearest answer alone of the order h.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solvers.curves import Curve, LagrangeCurve
from solvers.phases.trajectory import AnyTrajectory, PhasedTrajectory
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]
Shapes = dict[str, tuple[int, ...]]

# Weights whose magnitudes add up to more than this reach too far; those of three answers in a row make 7.
_FAR = 16.0


def predicted(places: Sequence[float], answers: Sequence[AnyTrajectory], at: float) -> AnyTrajectory | None:
    """The trajectory ``at`` a place on the polynomial through ``answers`` at other ``places``, nearest first.

    Switches move along, and the times at which phases meet. None where the answers have other phases or are
    not polynomials on as many segments each, where the place is too far from theirs, or where two switches
    would pass each other.
    """
    nearest = answers[0]
    if any(answer.names != nearest.names for answer in answers):
        return None
    parts = [_predicted(places, own, at) for own in zip(*(answer.parts for answer in answers), strict=True)]
    found = tuple(part for part in parts if part is not None)
    if len(found) < len(parts):
        return None
    return replace(nearest, parts=found) if isinstance(nearest, PhasedTrajectory) else found[0]


def _predicted(places: Sequence[float], answers: Sequence[Trajectory], at: float) -> Trajectory | None:
    weights, nearest = _weights(np.array(places), at), answers[0]
    shapes = [(_shapes(answer.states), _shapes(answer.controls), answer.nodes.size) for answer in answers]
    if None in shapes[0] or any(other != shapes[0] for other in shapes) or np.abs(weights).sum() > _FAR:
        return None
    breakpoints = _sum(weights, [answer.breakpoints for answer in answers])
    if np.diff(breakpoints).min() <= 0.0:
        return None
    return replace(
        nearest,
        t0=float(weights @ [answer.t0 for answer in answers]),
        tf=float(weights @ [answer.tf for answer in answers]),
        states=_curves(weights, [answer.states for answer in answers]),
        controls=_curves(weights, [answer.controls for answer in answers]),
        breakpoints=breakpoints,
        nodes=_sum(weights, [answer.nodes for answer in answers]),
        design={
            name: float(weights @ [answer.design[name] for answer in answers]) for name in nearest.design
        },
    )


def _weights(places: Vector, at: float) -> Vector:
    """Lagrange's weights of the places for another one."""
    others = [np.delete(places, index) for index in range(places.size)]
    return np.array(
        [np.prod((at - rest) / (place - rest)) for place, rest in zip(places, others, strict=True)]
    )


def _shapes(curves: Mapping[str, Curve]) -> Shapes | None:
    """How many supports each segment of each curve has; None where one is not made of such polynomials."""
    polynomials = {name: curve for name, curve in curves.items() if isinstance(curve, LagrangeCurve)}
    if len(polynomials) < len(curves):
        return None
    return {name: tuple(rows.size for rows in curve.values) for name, curve in polynomials.items()}


def _curves(weights: Vector, parts: Sequence[Mapping[str, Curve]]) -> dict[str, Curve]:
    found: dict[str, Curve] = {}
    for name in parts[0]:
        curves = [curve for part in parts if isinstance(curve := part[name], LagrangeCurve)]
        values = zip(*(curve.values for curve in curves), strict=True)
        found[name] = LagrangeCurve(
            _sum(weights, [curve.breaks for curve in curves]),
            curves[0].supports,
            tuple(_sum(weights, rows) for rows in values),
        )
    return found


def _sum(weights: Vector, rows: Sequence[Vector]) -> Vector:
    return np.asarray(weights @ np.array(rows), np.float64)
