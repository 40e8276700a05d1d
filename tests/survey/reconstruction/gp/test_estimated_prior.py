"""Errors of a prior that a map is built around, on a hill with priors of known errors."""

import numpy as np
import pytest

from survey import Dem, Grid, SurfacePoints
from survey.core.crs import projected_crs
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.mean import estimated_prior
from survey.reconstruction.prior import PRODUCTS, SatelliteErrors

CRS = projected_crs("EPSG:32608", "the test")
GRID = Grid((20.0, 20.0, 580.0, 580.0), 20.0, CRS)
MATERN = GaussianProcessConfig(family="matern-3/2", calibrate=False)


def hill(xy: np.ndarray) -> np.ndarray:
    return 9.0 * np.sin(xy[:, 0] / 120.0) * np.cos(xy[:, 1] / 100.0) + 0.03 * xy[:, 0]


def prior_of(offset_m: float = 0.0, shift_m: tuple[float, float] = (0.0, 0.0), white_m: float = 0.3) -> Dem:
    cells = Grid((-60.0, -60.0, 660.0, 660.0), 40.0, CRS)
    noise = white_m * np.random.default_rng(2).standard_normal(len(cells.xy))
    return Dem.on(cells, (hill(cells.xy - shift_m) + offset_m + noise).reshape(cells.shape))


def swath_points(n: int = 140) -> SurfacePoints:
    """Points of 5 cm on two swaths."""
    rng = np.random.default_rng(3)
    x = np.repeat([150.0, 450.0], n // 2) + rng.uniform(-12.0, 12.0, n)
    xy = np.column_stack([x, rng.uniform(0.0, 600.0, n)])
    return SurfacePoints(
        np.column_stack([xy, hill(xy) + 0.05 * rng.standard_normal(n)]), sigma_m=np.full(n, 0.05), crs=CRS
    )


def rmse_of(prior: Dem | None, product: str) -> float:
    joint = JointConfig(satellite=SatelliteErrors(product=product))
    found = reconstruct(swath_points(), GRID, prior, config=MATERN, joint=joint)
    return float(np.sqrt(np.mean((found.mean.elevation.ravel() - hill(GRID.xy)) ** 2)))


def test_a_bias_of_the_prior_does_not_reach_the_map():
    biased, exact = prior_of(-0.6), prior_of()
    assert rmse_of(biased, "unknown") < 1.05 * rmse_of(exact, "unknown")
    # As an exact mean the same prior moves the gaps by half a metre.
    assert rmse_of(biased, "unknown") < 0.8 * rmse_of(biased, "unbiased")
    assert rmse_of(biased, "unknown") < rmse_of(None, "unknown")


def test_ellipsoidal_heights_taken_for_those_above_the_geoid_are_reported():
    joint = JointConfig(satellite=SatelliteErrors(product="copernicus-30"))
    found = reconstruct(swath_points(), GRID, prior_of(40.0), config=MATERN, joint=joint)
    (conflict,) = found.diagnostics["prior_conflicts"]
    assert "m above the points" in conflict
    assert "check its vertical datum" in conflict
    assert found.diagnostics["satellite_offset_m"] == pytest.approx(40.0, abs=0.5)
    error = found.mean.elevation.ravel() - hill(GRID.xy)
    assert abs(error.mean()) < 0.3


def test_offset_and_shift_are_estimated_with_their_standard_deviations():
    found = estimated_prior(prior_of(0.5, (8.0, -6.0), 0.1), swath_points(), PRODUCTS["unknown"]).facts
    for name, real in (("offset_m", 0.5), ("shift_east_m", 8.0), ("shift_north_m", -6.0)):
        sigma = found[f"satellite_{name}_sigma"]
        assert abs(found[f"satellite_{name}"] - real) < 3.0 * sigma
        assert sigma < 3.0
    assert found["prior_conflicts"] == []


def test_a_prior_with_few_measured_cells_stays_as_it_is():
    prior = prior_of()
    points = swath_points().select(np.arange(3))
    assert estimated_prior(prior, points, PRODUCTS["unknown"]).dem is prior
