"""Copies of terrain with the errors of a product."""

from dataclasses import replace

import numpy as np

from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.prior import PRODUCTS
from survey.terrain import satellite_copy
from survey.terrain.satellite import ProductErrors, product_copy

GRID = Grid((0.0, 0.0, 600.0, 600.0), 5.0)
SLOPE = Dem.on(GRID, 0.1 * GRID.xy[:, 0].reshape(GRID.shape))


def test_white_errors_give_the_plain_copy():
    white = product_copy(SLOPE, ProductErrors(sigma_m=1.3), rng=np.random.default_rng(3))
    plain = satellite_copy(SLOPE, rng=np.random.default_rng(3), sigma_m=1.3)
    np.testing.assert_array_equal(white.elevation, plain.elevation)


def test_a_copy_displaced_to_the_east_is_lower_on_ground_that_rises_to_the_east():
    none = ProductErrors(sigma_m=0.0)
    exact, moved = (
        product_copy(SLOPE, errors, rng=np.random.default_rng(3)).elevation
        for errors in (none, replace(none, shift_m=(10.0, 0.0)))
    )
    # Edges continue: the outer cells differ by less.
    np.testing.assert_allclose((moved - exact)[:, 1:-1], -1.0, atol=1e-9)


def test_a_copy_displaced_to_the_north_is_lower_on_ground_that_rises_to_the_north():
    north = Dem.on(GRID, 0.1 * GRID.xy[:, 1].reshape(GRID.shape))
    none = ProductErrors(sigma_m=0.0)
    exact, moved = (
        product_copy(north, errors, rng=np.random.default_rng(3)).elevation
        for errors in (none, replace(none, shift_m=(0.0, 10.0)))
    )
    np.testing.assert_allclose((moved - exact)[1:-1], -1.0, atol=1e-9)


def test_offset_and_tilt_add_a_plane():
    tilted = ProductErrors(offset_m=0.5, tilt_m_per_km=(2.0, 0.0), sigma_m=0.0)
    exact = satellite_copy(SLOPE, rng=np.random.default_rng(3), sigma_m=0.0)
    error = product_copy(SLOPE, tilted, rng=np.random.default_rng(3)).elevation - exact.elevation
    np.testing.assert_allclose(error[0], 0.5 + 2e-3 * (exact.x - exact.x.mean()), atol=1e-12)


def test_correlated_errors_have_their_size_and_length():
    shared = ProductErrors(correlated_sigma_m=3.0, sigma_m=0.0)
    flat = Dem.on(GRID, np.zeros(GRID.shape))
    drawn = np.stack(
        [product_copy(flat, shared, rng=np.random.default_rng(seed)).elevation for seed in range(300)]
    )
    # 300 draws: 4 % of a standard deviation, taken three times; neighbours lie 75 m apart.
    assert abs(drawn.std() / 3.0 - 1.0) < 0.12
    neighbours = np.mean(drawn[:, :, 1:] * drawn[:, :, :-1]) / np.mean(drawn**2)
    assert abs(neighbours - np.exp(-75.0 / 250.0)) < 0.1


def test_a_draw_of_a_class_has_its_sizes():
    drawn = [ProductErrors.drawn(PRODUCTS["srtm-90"], np.random.default_rng(seed)) for seed in range(200)]
    offsets = np.array([one.offset_m for one in drawn])
    # 200 draws: 5 % of a standard deviation, taken three times.
    assert abs(offsets.std() / PRODUCTS["srtm-90"].level_sigma_m - 1.0) < 0.15
    assert ProductErrors.drawn(PRODUCTS["unbiased"], np.random.default_rng(1)).is_white
