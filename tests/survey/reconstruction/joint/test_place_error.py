"""Horizontal error of the path in the joint map: what it displaces, and what the terrain cannot say about it."""

import numpy as np
import pytest

from survey import Grid, SurfacePoints
from survey.core.arrays import FloatArray
from survey.data.path_error import PathError
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.checks import RmseClaim, sampled_nodes
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.shared_errors import PlaceError
from survey.reconstruction.joint.solution import JointSolution
from tests.survey.reconstruction.joint.test_joint_map import CRS, path_error, seen_points

SITE = Grid((0.0, 0.0, 60.0, 60.0), 1.0, CRS)
LANDFORMS, BUMPS = SquaredExponential(1.0, 40.0), SquaredExponential(0.01, 2.0)
STATED = GaussianProcessConfig(fit=False, kernel=Sum(LANDFORMS, BUMPS), mean="plane")


class Ground:
    """Landforms and bumps drawn from the stated kernels, as sums of cosines."""

    def __init__(self, seed: int, n_waves: int = 400) -> None:
        rng = np.random.default_rng(seed)
        parts = (LANDFORMS, BUMPS)
        self.omega = np.vstack([rng.standard_normal((n_waves, 2)) / one.length_scale_m for one in parts])
        self.phase = rng.uniform(0.0, 2.0 * np.pi, len(self.omega))
        self.strength = np.repeat([np.sqrt(2.0 * one.variance_m2 / n_waves) for one in parts], n_waves)

    def __call__(self, xy: FloatArray) -> FloatArray:
        return np.cos(xy @ self.omega.T + self.phase) @ self.strength


def landmarks(ground: Ground, shift_m: FloatArray, seed: int) -> SurfacePoints:
    """Landmarks all over the site, 1 cm good, whose path lies `shift_m` (east, north, up) from where it is taken to be."""
    rng, n = np.random.default_rng(seed), 2400
    xy, keyframe = rng.uniform(0.0, 60.0, (n, 2)), rng.uniform(0.0, 5.0, n)
    z = ground(xy) + 0.01 * rng.standard_normal(n)
    own = np.tile(np.diag([1e-8, 1e-8, 1e-4]), (n, 1, 1))
    return SurfacePoints(
        np.column_stack([xy, z]) + shift_m,
        covariance=own + np.eye(3),
        origins=np.column_stack([xy - 4.0, z + 1.0]) + shift_m,
        crs=CRS,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.zeros(n),
    )


def solved(points: SurfacePoints, path: PathError) -> JointSolution:
    independent = JointConfig(landmark_shared_sigma_m=0.0, far_bias_sigma_m=0.0)
    return JointTerrain(path, None, STATED, independent).solved(points, SITE.bounds)


def test_bumps_do_not_tell_a_path_where_it_lies() -> None:
    path = path_error(0.7, angle_rad=1e-4)
    correction = solved(landmarks(Ground(1), np.zeros(3), 2), path).correction()
    left = np.sqrt(np.einsum("kii->ki", correction.covariance))[:, :2]
    # The path has 0.7 m. As the bumps would have it, it was known to 0.1 m.
    assert left.min() > 0.6


def test_bumps_in_a_wrong_place_have_the_error_that_the_map_states() -> None:
    claimed, real = [], []
    nodes = sampled_nodes(np.ones(SITE.shape, dtype=bool))
    for seed, angle in enumerate(np.arange(4) * 0.5 * np.pi):
        ground = Ground(seed)
        points = landmarks(ground, 0.9 * np.array([np.cos(angle), np.sin(angle), 0.0]), seed)
        solution = solved(points, path_error(0.7, angle_rad=1e-4))
        mean, std = solution.fields(SITE)
        claim = RmseClaim.of(solution.terrain.covariance(SITE.xy[nodes]), std.ravel()[nodes])
        claimed.append(claim.relative.expected_m)
        real.append(float(np.std(mean - ground(SITE.xy).reshape(SITE.shape))))
    # Without the level, which the path does not know either. As if the bumps were in their place, a quarter of it was stated.
    assert np.sqrt(np.mean(np.square(real)) / np.mean(np.square(claimed))) == pytest.approx(1.0, abs=0.2)


def test_a_path_known_to_centimetres_maps_every_bump() -> None:
    ground = Ground(3)
    mean, _ = solved(landmarks(ground, np.zeros(3), 3), path_error(0.02, angle_rad=1e-5)).fields(SITE)
    assert np.std(mean - ground(SITE.xy).reshape(SITE.shape)) < 0.03


def test_the_error_is_that_of_the_median_point() -> None:
    place = PlaceError.of(seen_points(), path_error(0.5))
    assert np.diag(place.covariance_m2) == pytest.approx([0.25, 0.25], rel=0.02)
    # 120 m by some 190 m of points.
    assert 1.5e4 < place.area_m2 < 2.6e4


def test_points_in_one_place_have_slopes_of_all_lengths() -> None:
    assert PlaceError(np.eye(2), 0.0).highest_rad_per_m == np.inf
