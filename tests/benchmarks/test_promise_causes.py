import numpy as np
import pytest

from benchmarks.promise_on_real_ground.causes import Cause, _log_actual, _log_predicted, cause_rows
from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel
from survey import Dem, Grid
from survey.reconstruction.gp.kernel_search import Cell


def test_the_roughness_of_a_parabola_is_twice_its_squared_lag():
    grid = Grid((0.0, 0.0, 60.0, 60.0), 5.0, "EPSG:32608")
    terrain = Dem.on(grid, (np.square(grid.xy).sum(axis=1)).reshape(grid.shape))
    assert _log_actual(terrain, 10.0) == pytest.approx(np.log(2.0 * 10.0**2))


def test_the_roughness_of_a_covariance_is_that_of_independent_heights_beyond_its_length():
    one = WeightedKernel(Cell.of("matern-3/2", 1.0, 0.0), 4.0, 0.1, 1.0)
    assert _log_predicted(KernelPosterior((one,)), 500.0) == pytest.approx(0.5 * np.log(6.0 * 4.0))


def test_the_cause_that_goes_with_the_error_is_named():
    level = np.linspace(-1.0, 1.0, 9)
    rows = {
        row.name: row.value
        for row in cause_rows([Cause(2.0 * one, one, 0.1 * one**2, 0.1 * one**3) for one in level[:8]])
    }
    correlated = [value for name, value in rows.items() if "half a cell: correlation" in name]
    assert correlated == [pytest.approx(1.0)]
    assert any("below 0.6" in name for name in rows)
