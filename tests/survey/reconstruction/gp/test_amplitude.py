"""Points that show nothing but their own noise do not determine the variance of the terrain."""

import numpy as np
import pytest

from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.reconstruction.gp.marginal_likelihood import KernelFit, with_undetermined_variance
from survey.reconstruction.methods.gaussian_process import with_claim
from survey.reconstruction.terrain_map import CLAIM

CRS = "EPSG:32608"
SITE = Grid((0.0, 0.0, 200.0, 200.0), 20.0, CRS)
PRIOR = Dem.on(Grid((-60.0, -60.0, 260.0, 260.0), 40.0, CRS), np.zeros((9, 9)))


def relative_claim_and_error(seed: int) -> tuple[float, float]:
    """Map 30 points with noise of 0.1 m over a prior that has no error, and return claimed and true relative error."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(0.0, 200.0, (30, 2)), 0.1 * rng.normal(size=30)])
    points = SurfacePoints(xyz, sigma_m=0.1, crs=CRS)
    model = GaussianProcessTerrain(GaussianProcessConfig(prior_level="estimated"), PRIOR).fit(points)
    assert model.learned_ is not None
    found = with_claim(model.grid(SITE), model.learned_, None)
    return found.diagnostics[CLAIM]["relative"]["expected_m"], float(found.mean.elevation.std())


def test_a_map_of_noise_over_a_prior_claims_a_relative_error_of_the_size_of_its_own() -> None:
    claims, errors = np.array([relative_claim_and_error(seed) for seed in range(5)]).T
    assert claims.min() > 0.01  # the noise of 30 points hides relief of about 0.1 m / sqrt(30)
    assert np.sqrt(np.mean(errors**2)) < 1.5 * np.sqrt(np.mean(claims**2))


def test_a_variance_that_points_determine_is_the_likeliest_one() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.0, 200.0, (80, 2))
    search = KernelFit.of(xy, 2.0 * np.sin(xy[:, 0] / 30.0), np.full(80, 0.01), None)
    found = search.fit("squared-exponential", GaussianProcessConfig())
    assert with_undetermined_variance(search, found) == found


@pytest.mark.parametrize("n_points", [5, 200])
def test_an_undetermined_variance_shrinks_with_the_number_of_points(n_points: int) -> None:
    rng = np.random.default_rng(7)
    xy, noise = rng.uniform(0.0, 200.0, (n_points, 2)), np.full(n_points, 0.01)
    search = KernelFit.of(xy, np.zeros(n_points), noise, 0.0)
    found = with_undetermined_variance(search, search.fit("squared-exponential", GaussianProcessConfig()))
    assert isinstance(found.kernel, SquaredExponential)
    amplitude_m = np.sqrt(found.kernel.variance_m2)
    assert 0.1 / np.sqrt(n_points) < 2.0 * amplitude_m < 8.0 * 0.1 / np.sqrt(n_points)
