"""The prior's own error: as large and as wide as bilinear interpolation makes it."""

import numpy as np
import pytest

from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.gp.mean import prior_error_kernel


def test_the_kernel_is_that_of_interpolated_noise() -> None:
    rng = np.random.default_rng(0)
    cells = Grid((0.0, 0.0, 20_000.0, 20_000.0), 100.0, "EPSG:32608")
    noise = Dem.on(cells, rng.standard_normal(cells.shape))
    places = rng.uniform(1000.0, 19_000.0, (40_000, 2))
    kernel = prior_error_kernel(100.0, 1.0)
    here = noise.at(places)
    # 40,000 places on 32,000 independent cells: four standard errors are 3 %.
    assert here.var() == pytest.approx(kernel.variance_m2, rel=0.03)
    for lag in (50.0, 100.0):
        # On average over all directions; the spline is a Gaussian to within three hundredths of the variance.
        turn = rng.uniform(0.0, 2.0 * np.pi, len(places))
        there = noise.at(places + lag * np.column_stack([np.cos(turn), np.sin(turn)]))
        expected = float(kernel.covariance_of_lag(np.array([lag, 0.0])))
        assert np.mean(here * there) == pytest.approx(expected, abs=0.03)
