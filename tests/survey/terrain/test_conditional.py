import numpy as np

from survey import Dem, Grid
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.terrain.random_fields import CoarseCells


def test_cells_of_a_grid_share_their_covariances_by_lag(rng):
    heights = rng.standard_normal((5, 6))
    heights[0, 0] = heights[2, 3] = np.nan
    cells = CoarseCells(Dem.on(Grid((25.0, 25.0, 275.0, 225.0), 50.0, "EPSG:32608"), heights), 1.0)
    kernel = SquaredExponential(9.0, 60.0, anisotropy=2.0, angle_deg=30.0)
    n, per_cell, _ = cells.places.shape
    places = cells.places.reshape(-1, 2)
    fine = kernel.covariance(places, places).reshape(n, per_cell, n, per_cell)
    # Lags are rounded to a nanometre before equal ones are counted.
    np.testing.assert_allclose(cells.covariance(kernel), fine.mean(axis=(1, 3)), rtol=1e-9)
