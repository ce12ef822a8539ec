"""Nodes: where they are among the unknowns, and the symbols of one node as the model wants them.

The local variables of a node are z = (x, u, d, t, T), where d are the design parameters, T = tb - ta is the
duration of the span of time on which its tau counts from 0 to 1 (all of [t0, tf], or an arc of it) and
t = ta + tau T. Both are linear in the unknowns; a model without t then has no derivatives with respect to it.
States in ``per_tau`` stand in z as derivatives with respect to tau and are divided by T before the model sees
them. The numbers of a node are P, the parameters.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.problem import OptimalControlProblem
from solvers.symbolic import CASADI

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Instants:
    """K instants, and the rows (K x unknowns) that give each state and control there.

    ``tau`` counts from 0 to 1 over a span of time; ``span``: the rows of its start and end, by default those
    of t0 and tf.
    """

    tau: Vector
    states: Sequence[sparse.csr_array]
    controls: Sequence[sparse.csr_array] = ()
    span: tuple[sparse.csr_array, sparse.csr_array] | None = None


class NodeSymbols:
    """SX symbols of one node, as the model wants them."""

    def __init__(
        self, problem: OptimalControlProblem, per_tau: Collection[int] = (), accelerations: int = 0
    ) -> None:
        n, m = len(problem.states), len(problem.controls)
        design = [item.name for item in problem.design]
        self.z = ca.SX.sym("z", n + accelerations + m + len(design) + 2)
        self.p = ca.SX.sym("p", len(problem.parameters))
        parts = ca.vertsplit(self.z)
        self.t, self.duration = parts[-2:]
        self.x = [part / self.duration if i in per_tau else part for i, part in enumerate(parts[:n])]
        self.accelerations = [part / self.duration**2 for part in parts[n : n + accelerations]]
        self.u = parts[n + accelerations : n + accelerations + m]
        self.parameters = dict(zip(problem.parameters, ca.vertsplit(self.p), strict=True))
        self.parameters |= dict(zip(design, parts[n + accelerations + m : -2], strict=True))
        self.scope: dict[str, Any] = problem.scope(self.x, self.u, self.t, self.parameters, CASADI)

    def function(self, name: str, values: Sequence[Any]) -> ca.Function:
        """The Function (z, p) -> values."""
        return ca.Function(name, [self.z, self.p], [ca.vertcat(*[ca.SX(value) for value in values])])
