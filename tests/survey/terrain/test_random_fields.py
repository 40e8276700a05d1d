"""Random terrain has the statistics it is named after, the relief asked for, and no hidden state."""

from typing import get_args

import numpy as np
import pytest

from sim.config.world import TerrainFamily
from survey.core.errors import ConfigError, InputError
from survey.data.grid import Grid
from survey.reconstruction.gp.kernels import Kernel, Matern32, Matern52, SquaredExponential
from survey.terrain import (
    fractional_brownian,
    matern_field,
    random_dem,
    spectral_field,
    squared_exponential_field,
)
from survey.terrain.random_fields import kernel_field

FAMILIES = get_args(TerrainFamily)
SITE = Grid((0.0, 0.0, 600.0, 600.0), 10.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_relief_is_what_was_asked_for(family: str) -> None:
    dem = random_dem(family, SITE, np.random.default_rng(3), relief_m=12.5)
    # Two roundings of a double below 12.5.
    assert dem.relief_m == pytest.approx(12.5, abs=1e-14)
    assert dem.elevation.min() == 0.0


@pytest.mark.parametrize("family", FAMILIES)
def test_same_seed_same_bytes(family: str) -> None:
    first, second, other = (
        random_dem(family, SITE, np.random.default_rng(seed)).elevation.tobytes() for seed in (5, 5, 6)
    )
    assert first == second
    assert first != other


@pytest.mark.parametrize("family", FAMILIES)
def test_oblong_sites_in_utm_are_no_special_case(family: str) -> None:
    grid = Grid((500_000.0, 6_470_000.0, 500_230.0, 6_470_080.0), 2.0)
    dem = random_dem(family, grid, np.random.default_rng(8))
    assert dem.shape == (41, 116)
    assert np.isfinite(dem.elevation).all()


@pytest.mark.parametrize(
    "kernel",
    [
        SquaredExponential(4.0, 40.0),
        Matern32(4.0, 30.0),
        Matern52(4.0, 30.0),
        Matern32(4.0, 60.0, anisotropy=3.0, angle_deg=30.0),
    ],
)
def test_covariance_is_the_kernels(kernel: Kernel) -> None:
    """Over 4000 draws the covariance of the corner with every node is the kernel's."""
    grid = Grid((0.0, 0.0, 120.0, 120.0), 10.0)
    rng = np.random.default_rng(11)
    n_draws = 4000
    fields = np.stack([kernel_field(grid, rng, kernel).ravel() for _ in range(n_draws)])
    corner = grid.xy[(grid.shape[0] - 1) * grid.shape[1]]
    expected = kernel.covariance_of_lag(grid.xy - corner)
    found = fields.T @ fields[:, (grid.shape[0] - 1) * grid.shape[1]] / n_draws
    # A sample covariance has the standard deviation v sqrt((1 + ρ²) / n) at most; of 169 nodes none
    # should lie beyond 4 of them. 0.02 v is the variance of waves shorter than two steps (Matérn 3/2).
    tolerance = 4.0 * kernel.variance_m2 * np.sqrt(2.0 / n_draws) + 0.02 * kernel.variance_m2
    np.testing.assert_allclose(found, expected, atol=tolerance)
    np.testing.assert_allclose(fields.mean(axis=0), 0.0, atol=4.5 * np.sqrt(kernel.variance_m2 / n_draws))


def test_opposite_edges_of_the_site_are_independent() -> None:
    """Without padding the spectral sum would make the west and the east edge equal."""
    grid = Grid((0.0, 0.0, 200.0, 200.0), 10.0)
    rng = np.random.default_rng(2)
    fields = np.stack([kernel_field(grid, rng, SquaredExponential(1.0, 30.0)) for _ in range(400)])
    correlation = (fields[:, :, 0] * fields[:, :, -1]).mean()
    # 400 draws with about 200 / 60 independent stretches of edge each: standard error 0.027.
    assert abs(correlation) < 4 * 0.027


@pytest.mark.parametrize("kernel", [SquaredExponential(1.0, 80.0), Matern52(1.0, 80.0)])
def test_finer_step_adds_finer_waves_only(kernel: Kernel) -> None:
    coarse, fine = (
        kernel_field(Grid((0.0, 0.0, 400.0, 200.0), step_m), np.random.default_rng(4), kernel)
        for step_m in (10.0, 2.5)
    )
    # Matérn 5/2 with l = 80 m has a share of 1e-5 of its variance beyond the 20 m wave: 3e-3 m sd.
    np.testing.assert_allclose(fine[::4, ::4], coarse, atol=5 * 4e-3)


def test_halving_the_step_keeps_the_nodes_of_midpoint_displacement() -> None:
    steps = (75.0, 37.5)
    coarse, fine = (
        random_dem("diamond_square", Grid((0.0, 0.0, 600.0, 600.0), s), np.random.default_rng(4)).elevation
        for s in steps
    )
    # The relief is scaled on different nodes, so the shapes agree up to height and scale.
    assert np.corrcoef(coarse.ravel(), fine[::2, ::2].ravel())[0, 1] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("hurst", [0.3, 0.6])
def test_fractional_brownian_grows_as_its_exponent_says(hurst: float) -> None:
    grid = Grid((0.0, 0.0, 512.0, 512.0), 4.0)
    lags = np.array([4, 8, 16])
    growth = np.zeros(3)
    for seed in range(12):
        z = fractional_brownian(grid, np.random.default_rng(seed), hurst=hurst).elevation
        z = z / z.std()
        growth += [((z[:, lag:] - z[:, :-lag]) ** 2).mean() for lag in lags]
    slope = np.polyfit(np.log(lags), np.log(growth), 1)[0]
    # Cut waves at both ends (two steps, three sites) bend the line by about 0.1 at these lags.
    assert slope == pytest.approx(2.0 * hurst, abs=0.12)


def test_spectral_field_reports_the_variance_that_it_carries() -> None:
    grid = Grid((0.0, 0.0, 100.0, 100.0), 5.0)
    kernel = Matern32(2.0, 10.0)
    _, variance = spectral_field(grid, np.random.default_rng(1), kernel.spectral_density, padding_m=60.0)
    # Share of a Matérn 3/2 spectrum within a circle of radius ω: 1 - (1 + ω² l² / 3)^(-3/2);
    # the square of waves that the grid holds lies between two circles.
    inner, outer = (1.0 - (1.0 + (w * 10.0) ** 2 / 3.0) ** -1.5 for w in (np.pi / 5, np.pi / 5 * 2**0.5))
    assert 2.0 * inner < variance < 2.0 * outer


def test_refusals() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="use a finer grid"):
        squared_exponential_field(SITE, rng, length_scale_m=5.0)
    with pytest.raises(InputError, match="relief"):
        squared_exponential_field(SITE, rng, relief_m=0.0)
    with pytest.raises(InputError, match="smoothness"):
        matern_field(SITE, rng, nu=0.5)
    with pytest.raises(InputError, match="Hurst"):
        fractional_brownian(SITE, rng, hurst=1.0)
    with pytest.raises(ConfigError, match="length_scale_m"):
        matern_field(SITE, rng, length_scale_m=-1.0)
    with pytest.raises(ConfigError, match="not known"):
        random_dem("alps", SITE, rng)
    for family, wrong in (
        ("gaussian_hills", {"n_hills": 0}),
        ("cosine_surface", {"order": 0}),
        ("diamond_square", {"roughness": 1.0}),
        ("slope_and_waves", {"wavelength_m": (0.0, 10.0)}),
    ):
        with pytest.raises(InputError):
            random_dem(family, SITE, rng, **wrong)
