"""Linear systems whose sparse matrix is a narrow band, solved in time proportional to their size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solve_banded


def solve_banded_system(matrix: sparse.csr_array, right_side: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve ``matrix @ x = right_side`` for x of the shape of ``right_side``, (N,) or (N, m).

    ``matrix`` (N, N) is read as the narrowest band that holds its entries; Gaussian elimination with partial
    pivoting inside the band costs O(N b^2) for band width b.

    Raises numpy.linalg.LinAlgError if the matrix is singular.
    """
    entries = matrix.tocoo()
    row, column = entries.coords
    lower, upper = int(np.max(row - column)), int(np.max(column - row))
    band = np.zeros((lower + upper + 1, matrix.shape[1]))
    band[upper + row - column, column] = entries.data
    solution: NDArray[np.float64] = solve_banded((lower, upper), band, right_side)
    return solution
