"""Errors that landmarks share beyond those of the path: far ones that lie too high, and stretches of travel."""

import numpy as np
import pytest
from scipy import sparse

from survey import Grid, SurfacePoints
from survey.core.crs import projected_crs
from survey.data.landmarks import far_share, stretches
from survey.data.path_error import PathError
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.shared_errors import LandmarkErrors
from survey.reconstruction.joint.solution import JointSolution

CRS = projected_crs("EPSG:32608", "the test")
GRID = Grid((0.0, 0.0, 120.0, 80.0), 4.0, CRS)
KNOWN = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=30.0, mean="plane")
SIGMA_M = 0.04
FAR, NEITHER = (
    JointConfig(landmark_shared_sigma_m=0.0),
    JointConfig(landmark_shared_sigma_m=0.0, far_bias_sigma_m=0.0),
)


def hill(xy: np.ndarray) -> np.ndarray:
    return 1.5 * np.sin(xy[:, 0] / 30.0) * np.cos(xy[:, 1] / 35.0) + 0.03 * xy[:, 0]


def well_known_path() -> PathError:
    """Keyframes every 10 m along y = 40 m, whose poses err by 2 mm and 0.01°."""
    sigma = np.tile([2e-3] * 3 + [np.radians(0.01)] * 3, 12)
    return PathError(10.0 * np.arange(12), sparse.csr_array(np.diag(sigma**-2.0)), 6)


def landmarks(seed: int, *, far_bias_m: float = 0.0, shared_m: float = 0.0, n: int = 700) -> SurfacePoints:
    """Landmarks to both sides of a drive to the east, seen from 4 to 30 m, with the stated errors."""
    rng = np.random.default_rng(seed)
    keyframe = rng.uniform(0.0, 11.0, n)
    body = np.column_stack([5.0 + 10.0 * keyframe, np.full(n, 40.0), np.zeros(n)])
    body[:, 2] = hill(body)
    bearing, distance = rng.uniform(-1.2, 1.2, n), rng.uniform(4.0, 30.0, n)
    xy = body[:, :2] + distance[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    stretch = (10.0 * keyframe / 5.0).astype(int)
    z = hill(xy) + far_bias_m * far_share(distance) + SIGMA_M * rng.standard_normal(n)
    z += shared_m * rng.standard_normal(60)[stretch]
    own = np.tile(np.diag([1e-8, 1e-8, SIGMA_M**2]), (n, 1, 1))
    return SurfacePoints(
        np.column_stack([xy, z]),
        covariance=own,
        origins=body,
        range_m=distance,
        crs=CRS,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.zeros(n),
    )


def solved(points: SurfacePoints, joint: JointConfig) -> JointSolution:
    return JointTerrain(well_known_path(), None, KNOWN, joint).solved(points, GRID.bounds)


def normalised(solution: JointSolution) -> np.ndarray:
    """Errors of the map in its own standard deviations, where landmarks lie."""
    place = np.column_stack([np.tile(np.linspace(15.0, 110.0, 20), 5), np.repeat([20.0, 30, 40, 50, 60], 20)])
    sigma = np.sqrt(np.diag(solution.terrain.covariance(place)))
    result: np.ndarray = (solution.terrain.height(place) - hill(place)) / sigma
    return result


@pytest.mark.parametrize("bias_m", [0.078, -0.05, 0.0])
def test_the_height_bias_of_far_landmarks_is_found_within_its_standard_deviation(bias_m: float) -> None:
    z_scores, coverage = [], []
    for seed in range(4):
        solution = solved(landmarks(seed, far_bias_m=bias_m), FAR)
        facts = solution.diagnostics()
        sigma_m = facts["landmark_far_bias_m_sigma"]
        assert sigma_m < 0.01
        z_scores.append((facts["landmark_far_bias_m"] - bias_m) / sigma_m)
        coverage.append(np.mean(np.abs(normalised(solution)) < 1.96))
    assert np.abs(z_scores).max() < 2.5
    assert np.mean(coverage) > 0.90


def test_a_bias_that_is_no_unknown_makes_maps_claim_too_much() -> None:
    points = landmarks(1, far_bias_m=0.078)
    with_it, without = (normalised(solved(points, joint)) for joint in (FAR, NEITHER))
    assert np.mean(np.abs(without) < 1.96) < 0.6
    assert np.sqrt(np.mean(with_it**2)) < 0.5 * np.sqrt(np.mean(without**2))


def test_an_error_of_each_stretch_is_not_averaged_away_within_it() -> None:
    stated = JointConfig(landmark_shared_sigma_m=0.05)
    squares = {"stated": 0.0, "left out": 0.0}
    for seed in range(4):
        points = landmarks(seed, shared_m=0.05, n=2000)
        squares["stated"] += float(np.mean(normalised(solved(points, stated)) ** 2)) / 4.0
        squares["left out"] += float(np.mean(normalised(solved(points, FAR)) ** 2)) / 4.0
    assert 0.6 < squares["stated"] < 1.4
    assert squares["left out"] > 1.5 * squares["stated"]


def test_stretches_are_five_metres_of_travel() -> None:
    points = landmarks(3)
    assert points.keyframe is not None
    along = 10.0 * (points.keyframe - points.keyframe.min())
    number = stretches(points)
    assert number is not None
    assert max(np.ptp(along[number == k]) for k in np.unique(number)) <= 5.0
    # The ground rises and falls, so that travel is longer than the map shows.
    assert number.max() + 1 == pytest.approx(110.0 / 5.0, abs=1)


def test_points_without_keyframes_share_nothing() -> None:
    points = SurfacePoints(np.zeros((3, 3)), sigma_m=0.1, crs=CRS)
    assert stretches(points) is None
    assert LandmarkErrors.of(points, JointConfig()).rows.shape == (3, 0)
