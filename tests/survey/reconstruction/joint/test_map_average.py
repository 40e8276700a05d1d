"""Maps averaged over kernels, and kernels whose plane is not known."""

from dataclasses import replace

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.solution import JointSolution, MapAverage
from survey.reconstruction.prior_likelihood import Innovations, misfit_log_likelihood
from tests.survey.reconstruction.joint.test_joint_map import CRS, KNOWN, path_error

GRID = Grid((5.0, 5.0, 75.0, 75.0), 10.0, CRS)


class Flat:
    """A map of one height and one standard deviation."""

    def __init__(self, height_m: float, sigma_m: float) -> None:
        self._fields = np.full(GRID.shape, height_m), np.full(GRID.shape, sigma_m)

    def fields(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        return self._fields


def test_the_average_has_the_variance_of_its_parts_and_of_their_means() -> None:
    parts = Flat(1.0, 0.3), Flat(3.0, 0.5)
    average = MapAverage(Flat(1.5, 0.4), parts, np.array([0.25, 0.75]))
    mean, std = average.applied(GRID, np.full(GRID.shape, 1.6), np.full(GRID.shape, 0.8))
    np.testing.assert_allclose(mean, 1.6 + 2.5 - 1.5)
    variance = 0.25 * 0.3**2 + 0.75 * 0.5**2 + 0.25 * 0.75 * 2.0**2
    np.testing.assert_allclose(std, 0.8 * np.sqrt(variance) / 0.4)


def test_cells_that_a_kernel_predicts_make_it_more_probable() -> None:
    centre, covariance = np.zeros((2, 2)), 0.04 * np.eye(2)
    near, far = (Innovations(centre, np.full(2, value), covariance) for value in (0.1, 0.5))
    gain = misfit_log_likelihood(near) - misfit_log_likelihood(far)
    assert gain == pytest.approx((0.5**2 - 0.1**2) / 0.04)


def swath_of(kernel: SquaredExponential, seed: int, n: int = 160) -> tuple[SurfacePoints, FloatArray]:
    """Landmarks beside a line of 80 m through drawn terrain, 3 cm good, and the terrain's heights on the grid."""
    rng = np.random.default_rng(seed)
    keyframe = rng.uniform(0.0, 5.0, n)
    xy = np.column_stack([16.0 * keyframe, 40.0 + rng.uniform(-8.0, 8.0, n)])
    every = np.vstack([xy, GRID.xy])
    root = np.linalg.cholesky(kernel.covariance(every, every) + 1e-8 * np.eye(len(every)))
    z = root @ rng.standard_normal(len(every))
    body = np.column_stack([16.0 * keyframe, np.full(n, 40.0), z[:n]])
    own = np.tile(np.diag([1e-6, 1e-6, 0.03**2]), (n, 1, 1))
    points = SurfacePoints(
        np.column_stack([xy, z[:n] + 0.03 * rng.standard_normal(n)]),
        covariance=own,
        origins=body,
        body=body,
        crs=CRS,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.zeros(n),
    )
    return points, z[n:].reshape(GRID.shape)


@pytest.fixture(scope="module")
def solution() -> JointSolution:
    """Joint estimate beside a single swath, with kernels that are fitted."""
    points, _ = swath_of(SquaredExponential(1.0, 40.0), seed=5)
    return JointTerrain(path_error(0.01)).solved(points, GRID.bounds)


def test_maps_with_other_kernels_retain_nothing_of_the_path(solution: JointSolution) -> None:
    assert solution.average is not None
    n_shared = len(solution.posterior.shared)
    for terrain in solution.average.others:
        sizes = {np.shape(value)[0] for value in vars(terrain).values() if np.ndim(value)}
        assert n_shared not in sizes


def test_the_map_beside_a_single_swath_claims_what_an_unknown_kernel_leaves_open(
    solution: JointSolution,
) -> None:
    plain = replace(solution, average=None).on(GRID).reconstruction.std.elevation
    averaged = solution.on(GRID).reconstruction.std.elevation
    assert averaged[0].mean() > 1.05 * plain[0].mean()  # 35 m from the swath
    assert averaged[3].mean() < 0.05  # on it


def test_a_stated_kernel_is_not_averaged() -> None:
    points, _ = swath_of(SquaredExponential(1.0, 40.0), seed=5)
    assert JointTerrain(path_error(0.01), config=KNOWN).solved(points, GRID.bounds).average is None


def test_relief_that_a_plane_takes_with_it_is_not_absent() -> None:
    variance = [
        JointTerrain(path_error(0.01), config=GaussianProcessConfig(family="squared-exponential"))
        .from_points(swath_of(SquaredExponential(1.0, 40.0), seed)[0], GRID.bounds)
        .candidates[0]
        .kernel.variance_m2
        for seed in range(6)
    ]
    assert np.exp(np.mean(np.log(variance))) > 0.5
