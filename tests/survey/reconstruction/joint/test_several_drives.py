"""One joint map of several rovers: own path errors, own cameras, shared terrain."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from survey import Grid, InputError, SurfacePoints
from survey.core.crs import projected_crs
from survey.data.landmarks import stretches
from survey.data.path_error import PathError
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.drives import SeveralDrives, joined_points
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.shared_errors import LandmarkErrors

CRS = projected_crs("EPSG:32608", "the test")
GRID = Grid((0.0, 0.0, 120.0, 80.0), 8.0, CRS)
KNOWN = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=30.0, mean="plane")
N_KEYFRAMES = 12


def hill(xy: np.ndarray) -> np.ndarray:
    return 1.5 * np.sin(xy[:, 0] / 30.0) * np.cos(xy[:, 1] / 35.0)


def constant_error(sigma_m: float) -> PathError:
    """All keyframes of a path share one error of height; nothing else errs."""
    size = 6 * N_KEYFRAMES
    information = np.diag(np.tile([1e8, 1e8, 1e-9, 1e8, 1e8, 1e8], N_KEYFRAMES))
    up = np.arange(N_KEYFRAMES) * 6 + 2
    information[up[0], up[0]] += sigma_m**-2
    for a, b in itertools.pairwise(up):
        information[np.ix_([a, b], [a, b])] += 1e8 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    assert information.shape == (size, size)
    return PathError(10.0 * np.arange(N_KEYFRAMES), sparse.csr_array(information), 6)


def drive(northing_m: float, lift_m: float, seed: int, n: int = 200) -> SurfacePoints:
    """Landmarks within 25 m of a drive to the east, 3 cm good, all lifted by the error of the path."""
    rng = np.random.default_rng(seed)
    keyframe = rng.uniform(0.0, N_KEYFRAMES - 1.0, n)
    body = np.column_stack([5.0 + 10.0 * keyframe, np.full(n, northing_m), np.full(n, lift_m)])
    xy = body[:, :2] + rng.uniform(-25.0, 25.0, (n, 2))
    own = np.tile(np.diag([1e-8, 1e-8, 0.03**2]), (n, 1, 1))
    return SurfacePoints(
        np.column_stack([xy, hill(xy) + lift_m + 0.03 * rng.standard_normal(n)]),
        covariance=own,
        origins=body,
        crs=CRS,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.zeros(n),
    )


def test_the_path_errors_of_two_rovers_are_estimated_apart():
    sure, unsure = constant_error(0.02), constant_error(1.0)
    drives = SeveralDrives.of([(drive(25.0, 0.0, 1), sure), (drive(55.0, 0.8, 2), unsure)])
    assert drives.path is not None
    mapped = JointTerrain(drives.path, None, KNOWN).map(drives.points, GRID)
    first, second = drives.corrections(mapped.correction)
    assert abs(first.shift[:, 2].mean()) < 0.05
    assert second.shift[:, 2].mean() == pytest.approx(0.8, abs=0.1)
    np.testing.assert_array_equal(second.time_s, unsure.time_s)
    error = mapped.reconstruction.mean.elevation.ravel() - hill(GRID.xy)
    assert np.sqrt(np.mean(error**2)) < 0.15


def test_one_drive_is_mapped_as_it_was_alone():
    points, error = drive(40.0, 0.0, 3), constant_error(0.1)
    drives = SeveralDrives.of([(points, error)])
    assert drives.points is points
    assert drives.path is error


def test_rovers_share_neither_a_stretch_of_travel_nor_the_bowing_of_a_camera():
    parts = [drive(40.0, 0.0, 4), drive(40.0, 0.0, 5)]
    points = joined_points(parts, [0, N_KEYFRAMES])
    number = np.repeat([0, 1], 200)
    stretch = stretches(points, number)
    assert stretch is not None
    assert not set(stretch[:200]) & set(stretch[200:])
    shared = LandmarkErrors.of(points, JointConfig(bow_sigma_deg=0.1), number)
    assert shared.names[:4] == tuple(f"drive_{k}_bow_{way}_rad" for k in (1, 2) for way in ("ahead", "aside"))
    dense = shared.rows.toarray()
    assert not dense[200:, :2].any()
    assert not dense[:200, 2:4].any()


def test_drives_that_do_not_go_together_are_refused():
    points = drive(40.0, 0.0, 6)
    elsewhere = replace(points, crs=projected_crs("EPSG:32609", "the test"))
    with pytest.raises(InputError, match="the landmarks of the first rover"):
        joined_points([points, elsewhere], [0, N_KEYFRAMES])
    bare = SurfacePoints(points.xyz, sigma_m=0.1, crs=CRS)
    with pytest.raises(InputError, match="1 of 2 rovers"):
        joined_points([points, bare], [0, N_KEYFRAMES])


def test_drives_without_a_path_error_are_joined_as_independent_points():
    drives = SeveralDrives.of([(drive(25.0, 0.0, 1), None), (drive(55.0, 0.0, 2), None)])
    assert drives.path is None
    assert drives.points.keyframe is not None
    assert drives.points.keyframe[200:].min() > drives.points.keyframe[:200].max()
