"""Small lattices exactly: band matrix, determinant, diagonal of the inverse."""

import numpy as np
import pytest
from scipy import linalg

from survey.core.errors import InputError
from survey.reconstruction.lattice.multigrid import Operator
from survey.reconstruction.lattice.solver import band_cholesky, band_of, exact_variance, log_determinant

NO_FACTORS = np.zeros((0, 0, 0))


@pytest.fixture
def operator(rng: np.random.Generator) -> Operator:
    """Data on single nodes, a thin plate and springs on 6 × 7 nodes."""
    return Operator(rng.uniform(0.5, 2.0, (1, 6, 7)), (0.3, 0.1, 0.01), NO_FACTORS)


def matrix_of(operator: Operator) -> np.ndarray:
    """Return the operator as a dense matrix, column by column."""
    units = np.eye(operator.shape[0] * operator.shape[1]).reshape(-1, *operator.shape)
    return np.column_stack([operator.apply(unit).ravel() for unit in units])


def test_the_band_holds_the_lower_triangle(operator: Operator) -> None:
    band, matrix = band_of(operator), matrix_of(operator)
    for below, diagonal in enumerate(band):
        np.testing.assert_allclose(diagonal[: len(matrix) - below], np.diag(matrix, -below), atol=1e-14)
    assert not np.tril(matrix, -len(band)).any()


def test_the_variance_is_the_diagonal_of_the_inverse(operator: Operator) -> None:
    expected = np.diag(linalg.inv(matrix_of(operator))).reshape(operator.shape)
    np.testing.assert_allclose(exact_variance(operator), expected, rtol=1e-10)


def test_the_determinant_is_that_of_the_matrix(operator: Operator) -> None:
    _, expected = np.linalg.slogdet(matrix_of(operator))
    assert log_determinant(band_cholesky(band_of(operator))) == pytest.approx(expected, rel=1e-12)


def test_a_surface_that_nothing_holds_is_refused() -> None:
    loose = Operator(np.zeros((1, 6, 7)), (0.3, 0.0, 0.0), NO_FACTORS)
    with pytest.raises(InputError, match="not determined by its points"):
        band_cholesky(band_of(loose) - 1e-9 * np.eye(1, 42))
