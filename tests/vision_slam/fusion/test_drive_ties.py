"""Fusion of several paths by the places that they share."""

import numpy as np
import pytest
from pyproj import CRS
from scipy import sparse

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.path_error import PathError
from survey.data.sensors.odometry import DriveTies
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.joint.drives import PathCorrection, SeveralDrives
from vision_slam.fusion.pose_constraints import tie_drives

CRS_ = CRS("EPSG:32608")
N = 6
TIMES = 10.0 * np.arange(N)
OFF = np.array([0.9, -0.6, 0.4])


def common_error(sigma_m: float) -> PathError:
    """All poses of a path share one error of the position; headings are exact."""
    information = np.diag(np.tile([1e-9] * 3 + [1e8] * 3, N))
    for axis in range(3):
        information[axis, axis] += sigma_m**-2
        for k in range(N - 1):
            a, b = 6 * k + axis, 6 * (k + 1) + axis
            information[np.ix_([a, b], [a, b])] += 1e8 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return PathError(TIMES, sparse.csr_array(information), 6)


def drive(off: FloatArray, sigma_m: float, northing_m: float) -> tuple[SurfacePoints, PathError, Trajectory]:
    """A drive to the east whose estimated path is off, with two landmarks beside it."""
    real = np.column_stack([TIMES, np.full(N, northing_m), np.zeros(N)])
    error = common_error(sigma_m)
    body = real[[1, 3]] + off
    own = np.tile(1e-4 * np.eye(3), (2, 1, 1))
    points = SurfacePoints(
        body + [0.0, 3.0, -0.7],
        covariance=own + sigma_m**2 * np.eye(3),
        origins=body + [0.0, 0.0, 0.7],
        crs=CRS_,
        own_covariance=own,
        keyframe=np.array([1.0, 3.0]),
        heading_rad=np.zeros(2),
        body=body,
    )
    covariance = np.tile(sigma_m**2 * np.eye(3), (N, 1, 1))
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (N, 1))
    return points, error, Trajectory(TIMES, real + off, quaternion, covariance, CRS_, error=error)


def joined() -> tuple[SeveralDrives, list[Trajectory]]:
    """A sure drive, and an unsure one that is off."""
    parts = [drive(np.zeros(3), 0.05, 0.0), drive(OFF, 2.0, 4.0)]
    return SeveralDrives.of([(points, error) for points, error, _ in parts]), [path for _, _, path in parts]


def ties(wrong_m: float = 0.0) -> DriveTies:
    """Three ties at poses 1, 2 and 4; the last one may be wrong."""
    offset = np.tile([0.0, 4.0, 0.0], (3, 1))
    offset[2, 0] += wrong_m
    moments = TIMES[[1, 2, 4]]
    return DriveTies(moments, np.zeros(3), np.ones(3), moments, offset, np.tile(1e-3 * np.eye(3), (3, 1, 1)))


def test_an_unsure_drive_is_moved_onto_a_sure_one() -> None:
    drives, paths = joined()
    tied = tie_drives(drives, paths, ties())
    np.testing.assert_allclose(tied.points.xyz[2:], drives.points.xyz[2:] - OFF, atol=0.02)
    np.testing.assert_allclose(tied.points.body[2:], drives.points.body[2:] - OFF, atol=0.02)
    np.testing.assert_allclose(tied.points.xyz[:2], drives.points.xyz[:2], atol=0.02)
    deviations = np.sqrt(np.einsum("nii->ni", tied.points.covariance))
    assert (deviations[2:] < 0.1).all()
    assert (deviations[2:] > 0.04).all()


def test_the_corrected_path_has_the_shift_of_the_ties_and_of_the_map() -> None:
    drives, paths = joined()
    tied = tie_drives(drives, paths, ties())
    further = np.full((2 * N, 3), 0.1)
    _, second = tied.corrections(PathCorrection(np.arange(2.0 * N), further, np.zeros((2 * N, 3, 3))))
    np.testing.assert_allclose(second.shift, np.tile(OFF + 0.1, (N, 1)), atol=0.02)


def test_a_tie_that_contradicts_the_others_is_left_out() -> None:
    drives, paths = joined()
    right, wrong = tie_drives(drives, paths, ties()), tie_drives(drives, paths, ties(wrong_m=2.0))
    np.testing.assert_allclose(wrong.points.xyz, right.points.xyz, atol=0.02)


def test_ties_of_drives_that_are_not_there_are_refused() -> None:
    drives, paths = joined()
    with pytest.raises(InputError, match="there are 1 drives"):
        tie_drives(drives, paths[:1], ties())
    with pytest.raises(InputError, match="errors of their paths"):
        tie_drives(drives._replace(path=None), paths, ties())
