import numpy as np
import pytest
from scipy import sparse

from solvers.bases.banded import BandedMatrix


@pytest.mark.parametrize(("lower", "upper"), [(0, 0), (1, 1), (2, 1), (0, 3)])
def test_a_band_is_solved_as_the_whole_matrix_is(lower: int, upper: int) -> None:
    generator = np.random.default_rng(1)
    whole = np.triu(np.tril(generator.standard_normal((9, 9)), upper), -lower) + 4.0 * np.eye(9)
    band = BandedMatrix(sparse.csr_array(whole))
    # The factors are kept from one to the next.
    for right_side in (generator.standard_normal(9), generator.standard_normal((9, 3))):
        np.testing.assert_allclose(band.solve(right_side), np.linalg.solve(whole, right_side), atol=1e-13)
    right_side[4, 1] = np.nan
    assert np.isfinite(band.solve(right_side)).all(axis=0).tolist() == [True, False, True]


def test_a_singular_band_is_no_system() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        BandedMatrix(sparse.csr_array(np.diag([1.0, 0.0, 1.0]))).solve(np.ones(3))
