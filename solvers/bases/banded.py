"""Linear systems whose sparse matrix is a narrow band, solved in time proportional to their size."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg.lapack import dgbtrf, dgbtrs


class BandedMatrix:
    """A sparse matrix (N, N) as the narrowest band that holds its entries, and its factors once needed.

    What is not finite on the right is not finite in the solution.
    """

    def __init__(self, matrix: sparse.csr_array) -> None:
        entries = matrix.tocoo()
        row, column = entries.coords
        self._lower, self._upper = int(np.max(row - column)), int(np.max(column - row))
        # LAPACK keeps what its pivoting fills in above the band.
        self._band = np.zeros((2 * self._lower + self._upper + 1, matrix.shape[1]))
        self._band[self._lower + self._upper + row - column, column] = entries.data

    def solve(self, right_side: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve ``matrix @ x = right_side`` for x of the shape of ``right_side``, (N,) or (N, m).

        Gaussian elimination with partial pivoting inside the band costs O(N b^2) for band width b, once.

        Raises numpy.linalg.LinAlgError if the matrix is singular.
        """
        factors, pivots = self._factors
        solution: NDArray[np.float64] = dgbtrs(factors, self._lower, self._upper, right_side, pivots)[0]
        return solution

    @cached_property
    def _factors(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        factors, pivots, zero = dgbtrf(self._band, self._lower, self._upper)
        if zero:
            raise np.linalg.LinAlgError("singular matrix")
        return factors, pivots


def solve_banded_system(matrix: sparse.csr_array, right_side: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve one system with a matrix that is not needed again, see :class:`BandedMatrix`."""
    return BandedMatrix(matrix).solve(right_side)
