"""What a prediction pays for beside its objective: states outside their bounds, and steps of the controls.

Source: Kerrigan, Maciejowski, "Soft constraints and exact penalty functions in model predictive control",
UKACC Control 2000 (exact penalty).
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy import sparse

from solvers.piecewise.layout import Layout
from solvers.transcription.builder import Intervals

# Of the objective's scale, for a state that is outside by its own scale at one instant: above the multipliers
# that bounds of the cases have, so that the penalty is exact.
_PENALTY = 30.0


def soften(layout: Layout) -> None:
    """Bounds at the soft instants, up to what is outside, at a price."""
    builder, instants, bounded = layout.builder, layout.mesh.soft_instants, layout.bounded
    if not bounded:
        return
    states = layout.rows("states", instants)
    outside = [builder.rows_of(block) for block in builder.blocks["outside"]]
    for place, slack in zip(bounded, outside, strict=True):
        scale = float(layout.scales.states[place])
        for sign, limits in ((1.0, _below(place)), (-1.0, _above(place))):
            builder.constrain(limits, scale=scale, linear=sparse.csr_array(states[place] - sign * slack))
    s, nothing = ca.SX.sym("s", len(bounded)), ca.SX.sym("p", 0)
    weights = ca.DM(_PENALTY * layout.scales.objective / layout.scales.states[bounded])
    penalty = ca.Function("penalty", [s, nothing], [ca.dot(weights, s)])
    places = builder.apply(penalty, outside, lambda _: np.zeros((0, instants.size)))
    builder.cost(places, np.ones(instants.size))


def smooth(layout: Layout, weight: float) -> None:
    """A small price on steps of the controls: it decides where the objective does not care."""
    builder, scales = layout.builder, layout.scales
    m = scales.controls.size
    if not m:
        return
    z, nothing = ca.SX.sym("z", 2 * m), ca.SX.sym("p", 0)
    steps = (z[m:] - z[:m]) / ca.DM(scales.controls)
    price = ca.Function("steps", [z, nothing], [weight * scales.objective * ca.sumsqr(steps)])
    before = np.arange(layout.mesh.instants - 1)
    blocks = [*layout.rows("controls", before), *layout.rows("controls", before + 1)]
    places = builder.apply(price, blocks, lambda _: np.zeros((0, before.size)))
    builder.cost(places, np.ones(before.size))


def _below(place: int) -> Intervals:
    return lambda this: (-np.inf, this.upper[place])


def _above(place: int) -> Intervals:
    return lambda this: (this.lower[place], np.inf)
