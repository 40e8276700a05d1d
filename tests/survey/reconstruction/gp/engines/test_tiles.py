"""Tiles with a halo give the map of the whole."""

import numpy as np
import pytest

from survey.core.errors import CapacityError
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.tiled_gp import TiledGaussianProcess
from survey.reconstruction.gp.kernels import SquaredExponential

KERNEL = SquaredExponential(4.0, 5.0)
BOUNDS = (0.0, 0.0, 200.0, 100.0)


def _points() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    xy = rng.uniform((0.0, 0.0), (200.0, 100.0), (1500, 2))
    return xy, 2.0 * np.sin(xy[:, 0] / 7.0) + 0.1 * rng.standard_normal(1500), np.full(1500, 0.1)


def test_tiles_agree_with_the_whole() -> None:
    whole = FourierGaussianProcess.fit(*_points(), KERNEL, bounds=BOUNDS, tolerance_m=1e-3)
    # As much memory as half the site needs, not the whole.
    tiled = TiledGaussianProcess.fit(*_points(), KERNEL, bounds=BOUNDS, tolerance_m=1e-3, memory_mb=12.0)
    assert tiled.n_tiles[0] > 1
    x, y = np.linspace(0.0, 200.0, 81), np.linspace(0.0, 100.0, 41)
    for one, two in zip(tiled.predict_on_axes(x, y), whole.predict_on_axes(x, y), strict=True):
        # A centimetre is the halo's promise.
        np.testing.assert_allclose(one, two, atol=0.01)
    places = np.random.default_rng(1).uniform((0.0, 0.0), (200.0, 100.0), (30, 2))
    np.testing.assert_allclose(tiled.predict(places)[0], whole.predict(places)[0], atol=0.01)
    np.testing.assert_allclose(tiled.gradient(places), whole.gradient(places), atol=0.01)


def test_a_tile_that_never_fits_is_refused() -> None:
    with pytest.raises(CapacityError, match="halo"):
        TiledGaussianProcess.fit(*_points(), KERNEL, bounds=BOUNDS, memory_mb=0.05)


def test_a_mean_height_is_shared_by_all_tiles() -> None:
    xy, z, sigma = _points()
    tiled = TiledGaussianProcess.fit(
        xy, z + 1500.0, sigma, KERNEL, bounds=BOUNDS, trend="constant", memory_mb=12.0
    )
    flat = TiledGaussianProcess.fit(xy, z, sigma, KERNEL, bounds=BOUNDS, trend="constant", memory_mb=12.0)
    places = np.random.default_rng(2).uniform((0.0, 0.0), (200.0, 100.0), (30, 2))
    np.testing.assert_allclose(tiled.predict(places)[0], flat.predict(places)[0] + 1500.0, atol=1e-6)
