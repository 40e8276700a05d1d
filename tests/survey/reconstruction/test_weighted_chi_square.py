"""Distribution of weighted sums of squared normal variables."""

import numpy as np
import pytest

from survey.reconstruction.checks import WeightedChiSquare


@pytest.mark.parametrize("weights", [[1.0], [1.0] * 3, [4.0, 1.0, 0.5, 0.1], list(0.7 ** np.arange(12.0))])
def test_upper_probabilities_are_those_of_draws_within_one_percent(weights):
    drawn = np.random.default_rng(1).standard_normal((200_000, len(weights))) ** 2 @ np.array(weights)
    found = WeightedChiSquare.of(np.array(weights))
    for share in (0.8, 0.9, 0.95, 0.99):
        value = float(np.quantile(drawn, share))
        assert found.below(value) == pytest.approx(share, abs=0.01)
        assert found.above(value) == pytest.approx(1.0 - share, abs=0.01)


def test_a_covariance_gives_the_same_as_its_eigenvalues():
    root = np.random.default_rng(2).standard_normal((6, 6))
    covariance = root @ root.T
    by_matrix = WeightedChiSquare.of_mean_square(covariance)
    by_values = WeightedChiSquare.of(np.linalg.eigvalsh(covariance) / 6.0)
    assert by_matrix.mean == pytest.approx(by_values.mean)
    assert by_matrix.variance == pytest.approx(by_values.variance)
    assert by_matrix.n_free == pytest.approx(by_values.n_free)


def test_equal_independent_errors_count_one_by_one_and_common_ones_as_one():
    assert WeightedChiSquare.of_mean_square(np.eye(7)).n_effective == pytest.approx(7.0)
    assert WeightedChiSquare.of_mean_square(np.ones((7, 7))).n_effective == pytest.approx(1.0)
