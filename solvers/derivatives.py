"""The exact sparse derivatives of a partially separable program, see :mod:`solvers.program`.

One small symbolic differentiation of each function, whose values at all places are scattered by constant
matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.program import NonlinearProgram, PlaceFunction

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class CompiledProgram:
    """The functions that an optimizer calls, of w and of p = ``NonlinearProgram.numbers``.

    ``program`` (w, p) -> (J, c); ``gradient`` (w, p) -> (J, dJ/dw); ``jacobian`` (w, p) -> (nothing, dc/dw);
    ``hessian`` (w, p, sigma, lambda) -> upper triangle, of the Lagrangian. CasADi gives the Jacobian a first
    output for the constraints, which its IPOPT never asks for and an MX function would compute all the same.
    """

    program: ca.Function
    gradient: ca.Function
    jacobian: ca.Function
    hessian: ca.Function

    def unrolled(self) -> CompiledProgram:
        """The same as straight code over scalars, place after place: faster, and larger."""
        every = (self.program, self.gradient, self.jacobian, self.hessian)
        return CompiledProgram(*(function.expand() for function in every))


def compile_program(program: NonlinearProgram) -> CompiledProgram:
    """Build objective, constraints and their exact sparse derivatives."""
    w = ca.MX.sym("w", program.variables)
    p = ca.MX.sym("p", sum(group.numbers.size for group in program.groups))
    sigma, multipliers = ca.MX.sym("sigma"), ca.MX.sym("lambda", program.constraints)
    constraints = ca.mtimes(_dm(program.linear), w)
    objective = ca.dot(ca.DM(program.linear_cost), w)
    gradient = ca.MX(ca.DM(program.linear_cost))
    jacobian = _LinearAssembly((program.constraints, program.variables))
    jacobian.constant(program.linear)
    hessian = _LinearAssembly((program.variables, program.variables))
    start = 0
    for group in program.groups:
        stop = start + group.numbers.size
        places = _Places(group, w, p[start:stop])
        start = stop
        values = places.values()
        slopes = places.slopes()
        constraints += ca.mtimes(_dm(group.scatter), values)
        jacobian.add(*places.jacobian_pattern(group.scatter), slopes)
        weights = ca.mtimes(_dm(group.scatter.T), multipliers)
        if group.cost.any():
            cost = ca.DM(group.cost)
            objective += ca.dot(cost, values)
            weights += sigma * cost
            cost_row = _LinearAssembly((program.variables, 1))
            row, column, entry, factor = places.jacobian_pattern(sparse.csc_array(group.cost[None, :]))
            cost_row.add(column, row, entry, factor, slopes)
            gradient += ca.densify(cost_row.matrix())
        curvatures = places.curvatures(weights)
        if curvatures is not None:
            hessian.add(*places.hessian_pattern(), curvatures)
    return CompiledProgram(
        ca.Function("nlp", [w, p], [objective, constraints], ["x", "p"], ["f", "g"]),
        ca.Function("nlp_grad_f", [w, p], [objective, ca.densify(gradient)], ["x", "p"], ["f", "grad_f_x"]),
        ca.Function(
            "nlp_jac_g", [w, p], [ca.MX(*constraints.shape), jacobian.matrix()], ["x", "p"], ["g", "jac_g_x"]
        ),
        ca.Function(
            "nlp_hess_l",
            [w, p, sigma, multipliers],
            [hessian.matrix()],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    )


class _Places:
    """The K evaluations of one F and of its derivatives, as vectors of nonzeros, place after place."""

    def __init__(self, group: PlaceFunction, w: ca.MX, numbers: ca.MX) -> None:
        self._group = group
        function = group.function
        self._n_z, self._n_y = function.size1_in(0), function.size1_out(0)
        self._z = ca.reshape(ca.mtimes(_dm(group.gather), w), self._n_z, group.places)
        self._p = ca.reshape(numbers, group.numbers.shape[0], group.places)
        z, p = ca.SX.sym("z", self._n_z), ca.SX.sym("p", group.numbers.shape[0])
        y = function(z, p)
        slope = ca.jacobian(y, z)
        mu = ca.SX.sym("mu", self._n_y)
        curvature = ca.triu(ca.hessian(ca.dot(mu, y), z)[0])
        self._slope_rows, self._slope_columns = _triplet(slope)
        self._curvature_rows, self._curvature_columns = _triplet(curvature)
        self._slope = ca.Function("slope", [z, p], [_nonzeros(slope)])
        self._curvature = ca.Function("curvature", [z, p, mu], [_nonzeros(curvature)])

    def values(self) -> ca.MX:
        return ca.vec(self._group.function.map(self._group.places)(self._z, self._p))

    def slopes(self) -> ca.MX:
        return ca.vec(self._slope.map(self._group.places)(self._z, self._p))

    def curvatures(self, weights: ca.MX) -> ca.MX | None:
        if not self._curvature_rows.size:
            return None
        mu = ca.reshape(weights, self._n_y, self._group.places)
        return ca.vec(self._curvature.map(self._group.places)(self._z, self._p, mu))

    def jacobian_pattern(self, scatter: sparse.csc_array) -> tuple[Indices, Indices, Indices, Vector]:
        """Triplets (row, column, slope entry, factor) of B blkdiag(F') E."""
        y = self._per_place(self._slope_rows, self._n_y)
        z = self._per_place(self._slope_columns, self._n_z)
        return _product(y, z, scatter, sparse.csr_array(self._group.gather))

    def hessian_pattern(self) -> tuple[Indices, Indices, Indices, Vector]:
        """Triplets (row, column, curvature entry, factor) of the upper triangle of E' blkdiag(H) E."""
        gather = sparse.csr_array(self._group.gather)
        columns = sparse.csc_array(gather.T)
        i = self._per_place(self._curvature_rows, self._n_z)
        j = self._per_place(self._curvature_columns, self._n_z)
        row, column, entry, factor = _product(i, j, columns, gather)
        off_diagonal = (i != j)[entry]
        mirrored = [
            np.concatenate(pair)
            for pair in (
                (row, column[off_diagonal]),
                (column, row[off_diagonal]),
                (entry, entry[off_diagonal]),
            )
        ]
        factors = np.concatenate([factor, factor[off_diagonal]])
        upper = mirrored[0] <= mirrored[1]
        return mirrored[0][upper], mirrored[1][upper], mirrored[2][upper], factors[upper]

    def _per_place(self, local: Indices, size: int) -> Indices:
        return (np.arange(self._group.places)[:, None] * size + local[None, :]).ravel()


class _LinearAssembly:
    """A sparse matrix whose nonzeros are a constant plus constant matrices times vectors of MX."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._keys: list[Indices] = []
        self._parts: list[tuple[Indices, Vector, ca.MX | None]] = []

    def constant(self, matrix: sparse.csr_array) -> None:
        entries = sparse.coo_array(matrix)
        self._keys.append(self._key(entries.row.astype(np.int64), entries.col.astype(np.int64)))
        self._parts.append((np.zeros(entries.nnz, np.int64), entries.data, None))

    def add(self, row: Indices, column: Indices, entry: Indices, factor: Vector, values: ca.MX) -> None:
        self._keys.append(self._key(row, column))
        self._parts.append((entry, factor, values))

    def _key(self, row: Indices, column: Indices) -> Indices:
        return column * self._shape[0] + row  # ascending keys are CasADi's column-major order

    def matrix(self) -> ca.MX:
        keys = [np.zeros(0, np.int64), *self._keys]
        pattern, place = np.unique(np.concatenate(keys), return_inverse=True)
        nonzeros = ca.MX(ca.DM.zeros(pattern.size))
        start = 0
        for entry, factor, values in self._parts:
            nonzero = place[start : start + entry.size]
            start += entry.size
            size = 1 if values is None else values.numel()
            matrix = _dm(sparse.csc_array((factor, (nonzero, entry)), shape=(pattern.size, size)))
            nonzeros += ca.densify(matrix) if values is None else ca.mtimes(matrix, values)
        rows, columns = pattern % self._shape[0], pattern // self._shape[0]
        offsets = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=self._shape[1]))])
        sparsity = ca.Sparsity(*self._shape, offsets.tolist(), rows.tolist())
        return ca.MX(sparsity, nonzeros)


def _product(
    left: Indices, right: Indices, scatter: sparse.csc_array, gather: sparse.csr_array
) -> tuple[Indices, Indices, Indices, Vector]:
    """All contributions of entries (left, right) of a matrix X to scatter @ X @ gather."""
    left_count = np.diff(scatter.indptr)[left].astype(np.int64)
    right_count = np.diff(gather.indptr)[right].astype(np.int64)
    count = left_count * right_count
    entry = np.repeat(np.arange(left.size), count)
    within = np.arange(entry.size) - np.repeat(np.cumsum(count) - count, count)
    from_left = scatter.indptr[left[entry]] + within // right_count[entry]
    from_right = gather.indptr[right[entry]] + within % right_count[entry]
    factor = scatter.data[from_left] * gather.data[from_right]
    return (
        scatter.indices[from_left].astype(np.int64),
        gather.indices[from_right].astype(np.int64),
        entry,
        factor,
    )


def _triplet(matrix: ca.SX) -> tuple[Indices, Indices]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.asarray(rows, np.int64), np.asarray(columns, np.int64)


def _nonzeros(matrix: ca.SX) -> ca.SX:
    """The nonzeros as a column, common subexpressions written once: derivatives repeat themselves a lot."""
    return ca.cse(ca.SX(matrix.nz[:]))


def _dm(matrix: sparse.csr_array | sparse.csc_array) -> ca.DM:
    columns = sparse.csc_array(matrix)
    columns.sum_duplicates()
    sparsity = ca.Sparsity(*columns.shape, columns.indptr.tolist(), columns.indices.tolist())
    return ca.DM(sparsity, columns.data.tolist())  # lists pass twice as fast as arrays
