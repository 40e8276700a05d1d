import numpy as np
import pytest

from planners.prediction.error_distribution import Correlogram
from survey.reconstruction.gp.kernel_search import ALL, Cell


@pytest.mark.parametrize("family", ALL)
def test_the_table_agrees_with_the_covariance_function(family, rng):
    cell = Cell.of(family, 100.0, -12.0)
    a, b = rng.uniform(0.0, 300.0, (20, 2)), rng.uniform(0.0, 300.0, (30, 2))
    squared = ((a[:, None] - b[None]) ** 2).sum(axis=2)
    read = Correlogram(cell, reach_m=500.0).between(a, b)
    assert read.shape == (20, 30)
    np.testing.assert_allclose(read, cell.correlation(squared), atol=2e-7)


def test_a_place_is_fully_correlated_with_itself():
    here = np.array([[5.0, 5.0]])
    assert Correlogram(Cell.of("matern-3/2", 50.0, -12.0), 100.0).between(here, here)[0, 0] == 1.0


def test_beyond_the_reach_the_last_entry_counts():
    cell, origin = Cell.of("matern-3/2", 50.0, -12.0), np.zeros((1, 2))
    read = Correlogram(cell, 100.0).between(origin, np.array([[100.0, 0.0], [1e6, 0.0]]))
    assert read[0, 1] == pytest.approx(read[0, 0], rel=0.01)
