"""Linear systems whose sparse matrix is a narrow band, solved in time proportional to their size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solve_banded


class BandedMatrix:
    """A sparse matrix (N, N) as the narrowest band that holds its entries."""

    def __init__(self, matrix: sparse.csr_array) -> None:
        entries = matrix.tocoo()
        row, column = entries.coords
        self._lower, self._upper = int(np.max(row - column)), int(np.max(column - row))
        self._band = np.zeros((self._lower + self._upper + 1, matrix.shape[1]))
        self._band[self._upper + row - column, column] = entries.data

    def solve(self, right_side: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve ``matrix @ x = right_side`` for x of the shape of ``right_side``, (N,) or (N, m).

        Gaussian elimination with partial pivoting inside the band costs O(N b^2) for band width b.

        Raises numpy.linalg.LinAlgError if the matrix is singular.
        """
        solution: NDArray[np.float64] = solve_banded((self._lower, self._upper), self._band, right_side)
        return solution


def solve_banded_system(matrix: sparse.csr_array, right_side: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve one system with a matrix that is not needed again, see :class:`BandedMatrix`."""
    return BandedMatrix(matrix).solve(right_side)
