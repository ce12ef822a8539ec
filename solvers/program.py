"""A nonlinear program in partially separable form, and its exact sparse derivatives.

Every direct transcription here has the form

    c(w) = A w + sum_g B_g vec(F_g(E_g w; P_g)),      J(w) = a'w + sum_g b_g' vec(F_g(E_g w; P_g))

with constant sparse A, B_g, E_g and a few small functions F_g, each applied to all its places alike. E_g
gathers the local variables of each place, P_g is a column of numbers for each place (never baked into the
graph). Hence

    Jacobian = A + sum_g B_g blkdiag(F_g') E_g
    Hessian  = sum_g E_g' blkdiag(sum_i mu_i F_gi'') E_g,      mu = B_g' lambda + sigma b_g

and exact derivatives cost one small symbolic differentiation, whatever the number of places.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class PlaceFunction:
    """A small function F applied alike to K places.

    ``function``: CasADi Function (z, p) -> y on SX, with n_z local variables, n_p numbers and n_y values;
    ``gather``: E, (K n_z) x n; ``numbers``: P, n_p x K; ``scatter``: B, m x (K n_y); ``cost``: b, (K n_y,).
    Place k owns rows k n_z ... of E and columns k n_y ... of B.
    """

    function: ca.Function
    gather: sparse.csr_array
    numbers: Vector
    scatter: sparse.csc_array
    cost: Vector

    @property
    def places(self) -> int:
        """K, the number of places."""
        return int(self.numbers.shape[1])

    def values(self, unknowns: Vector) -> Vector:
        """vec(F(E w; P)), (K n_y,), for the unknowns w."""
        local = (self.gather @ unknowns).reshape(self.places, -1).T
        found: Vector = self.function.map(self.places)(local, self.numbers).full().ravel(order="F")
        return found


@dataclass(frozen=True)
class NonlinearProgram:
    """Minimise J(w), ``lower <= w <= upper`` and ``constraint_lower <= c(w) <= constraint_upper``."""

    initial: Vector
    lower: Vector
    upper: Vector
    linear: sparse.csr_array
    linear_cost: Vector
    constraint_lower: Vector
    constraint_upper: Vector
    groups: tuple[PlaceFunction, ...]

    @property
    def variables(self) -> int:
        """The number of unknowns."""
        return int(self.initial.size)

    @property
    def constraints(self) -> int:
        """The number of constraint rows."""
        return int(self.constraint_lower.size)

    @property
    def operations(self) -> int:
        """How many operations all F_g at all their places take."""
        return sum(group.function.n_instructions() * group.places for group in self.groups)

    @property
    def numbers(self) -> Vector:
        """All P_g as one vector, column after column: the parameter of the compiled program."""
        return np.concatenate([group.numbers.ravel(order="F") for group in self.groups])

    def values(self, unknowns: Vector) -> tuple[float, Vector]:
        """J(w) and c(w) for the unknowns w, without compiling anything."""
        objective, rows = float(self.linear_cost @ unknowns), self.linear @ unknowns
        for group in self.groups:
            values = group.values(unknowns)
            objective += float(group.cost @ values)
            rows = rows + group.scatter @ values
        return objective, rows

    def scaled(self, variables: Vector, rows: Vector, objective: float) -> NonlinearProgram:
        """The same program in unknowns w / ``variables``, rows c * ``rows`` and cost J * ``objective``.

        All factors are positive. Scaling touches the constant matrices only.
        """
        columns = sparse.diags_array(variables)
        row_scale = sparse.diags_array(rows)
        return replace(
            self,
            initial=self.initial / variables,
            lower=self.lower / variables,
            upper=self.upper / variables,
            linear=sparse.csr_array(row_scale @ self.linear @ columns),
            linear_cost=self.linear_cost * variables * objective,
            constraint_lower=self.constraint_lower * rows,
            constraint_upper=self.constraint_upper * rows,
            groups=tuple(
                replace(
                    group,
                    gather=sparse.csr_array(group.gather @ columns),
                    scatter=sparse.csc_array(row_scale @ group.scatter),
                    cost=group.cost * objective,
                )
                for group in self.groups
            ),
        )
