"""Sideways errors count as far as the ground slopes."""

import numpy as np
import pytest

from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig, GaussianProcessTerrain
from survey.reconstruction.observations import variance_through_slope


def test_flat_ground_leaves_the_marginal_variance() -> None:
    covariance = np.diag([4.0, 9.0, 0.25])[None]
    assert variance_through_slope(covariance, np.zeros((1, 2)))[0] == 0.25


def test_the_variance_is_that_of_the_plane_through_the_errors() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((3, 3))
    covariance, slope = root @ root.T, np.array([0.3, -0.7])
    errors = rng.multivariate_normal(np.zeros(3), covariance, 200_000)
    above = errors[:, 2] - errors[:, :2] @ slope
    # Four standard errors of the variance of 200,000 draws.
    expected = pytest.approx(above.var(), rel=4 * np.sqrt(2 / 200_000))
    assert variance_through_slope(covariance[None], slope[None])[0] == expected


def test_a_singular_covariance_along_the_surface_stays_positive() -> None:
    along = np.array([1.0, 0.0, 0.5])
    assert variance_through_slope(np.outer(along, along)[None], np.array([[0.5, 0.0]]))[0] > 0.0


def test_steep_ground_is_known_less_well_than_flat_ground_from_points_that_err_sideways() -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.0, 100.0, (150, 2))
    # Flat in the west, a slope of one half in the east.
    z = 0.5 * np.maximum(xy[:, 0] - 50.0, 0.0)
    covariance = np.tile(np.diag([1.0, 1.0, 0.01]), (150, 1, 1))
    points = SurfacePoints(np.column_stack([xy, z]), covariance=covariance, crs="EPSG:32608")
    places = np.array([[25.0, 50.0], [75.0, 50.0]])

    def std(treatment: str) -> np.ndarray:
        config = GaussianProcessConfig(
            fit=False, variance_m2=100.0, length_scale_m=40.0, horizontal_errors=treatment
        )
        return GaussianProcessTerrain(config).fit(points).predict(places, "std")

    assert std("slope")[1] > 2.0 * std("slope")[0]
    assert std("marginal")[1] == pytest.approx(std("marginal")[0], rel=0.5)
