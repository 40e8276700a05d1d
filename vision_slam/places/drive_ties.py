"""Ties between drives: places that the images of two drives saw from above."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames
from survey.data.sensors.drive_ties import DriveTies
from survey.data.trajectory import Trajectory
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.places.ground_view import GroundMosaics
from vision_slam.places.meetings import (
    Meeting,
    SeenPath,
    best_of_meetings,
    overlay_variance,
    reach_m,
    recognized,
    spaced_poses,
)

_EVERY = 2  # of the first drive's poses a metre apart: a view reaches 3 m to each side


class SeenDrive(NamedTuple):
    """Images of a drive and what was estimated from them.

    Parameters
    ----------
    frames : Frames
        Images.
    camera : Camera
        That took them.
    visual : VisualOdometry
        Their odometry and landmarks, in metres and for the body.
    trajectory : Trajectory
        Estimated path, at the times of the odometry.
    """

    frames: Frames
    camera: Camera
    visual: VisualOdometry
    trajectory: Trajectory


def detect_drive_ties(drives: Sequence[SeenDrive]) -> DriveTies | None:
    """Detect places that two drives saw from above, under any heading.

    Poses of two drives whose paths may be at one place, within three standard deviations, are compared by what the
    ground around them looks like from above, as `detect_loop_closures` does within a drive; of each meeting the
    overlay counts on which most features agree.

    Parameters
    ----------
    drives : sequence of SeenDrive
        Two or more drives over the same ground, in one CRS.

    Returns
    -------
    DriveTies or None
        None where no two drives saw a common place.

    Raises
    ------
    InputError
        The odometry of a drive has lengths without a scale, or times that its path lacks.

    Notes
    -----
    The light must come from about the same side on all drives. Views reach 3 m to each side, so that drives whose
    paths stay farther apart have no ties; the map ties them by the ground that both saw.
    """
    paths = [_seen_path(drive) for drive in drives]
    rows = [row for a, b in combinations(range(len(drives)), 2) for row in _ties_of(drives, paths, a, b)]
    if not rows:
        return None
    rows.sort(key=lambda row: row[:4])
    time_s, first, second, second_s, offset, covariance = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    return DriveTies(time_s, first, second, second_s, offset, covariance)


def _seen_path(drive: SeenDrive) -> SeenPath:
    """Return the mosaics of a drive along its estimated path."""
    odometry, path = drive.visual.odometry, drive.trajectory
    if drive.visual.lever_arm_m is not None:
        raise InputError(
            "ties between drives need lengths in metres; localize with wheels, or leave the ties out."
        )
    index = np.searchsorted(path.time_s, odometry.time_s).clip(max=len(path) - 1)
    if (np.abs(path.time_s[index] - odometry.time_s) > 1e-6).any():
        raise InputError("the path lacks times of the images' odometry; localize the drive again.")
    position = path.position[index]
    attitude = np.unwrap(Rotation.from_quat(path.quaternion[index]).as_euler("xyz"), axis=0)
    placed = replace(odometry, attitude_rad=attitude)
    mosaics = GroundMosaics(drive.frames, drive.camera, position, placed, drive.visual.sightings)
    sigma_m = np.sqrt(np.linalg.eigvalsh(path.covariance[index][:, :2, :2])[:, -1])
    return SeenPath(mosaics, position, sigma_m)


_Row = tuple[float, int, int, float, FloatArray, FloatArray]


def _ties_of(drives: Sequence[SeenDrive], paths: Sequence[SeenPath], a: int, b: int) -> Iterator[_Row]:
    """Yield the ties of two drives."""
    first, second = paths[a], paths[b]
    found = recognized(first, second, _near(first, second))
    times = [drive.visual.odometry.time_s for drive in drives]
    for meeting in best_of_meetings(found, first.mosaics.travel_m, second.mosaics.travel_m):
        offset, covariance = _in_world(first, meeting)
        yield float(times[a][meeting.first]), a, b, float(times[b][meeting.second]), offset, covariance


def _in_world(first: SeenPath, meeting: Meeting) -> tuple[FloatArray, FloatArray]:
    """Return the offset of the second body (3,) in the axes of the world, and its covariance (3, 3)."""
    level = first.mosaics.level(meeting.first)
    covariance = level @ np.diag(overlay_variance(meeting.overlay)) @ level.T
    return level @ meeting.overlay.shift, 0.5 * (covariance + covariance.T)


def _near(first: SeenPath, second: SeenPath) -> Iterator[tuple[int, int]]:
    """Yield pairs of poses of two drives that may be at one place."""
    one, other = spaced_poses(first.mosaics.travel_m)[::_EVERY], spaced_poses(second.mosaics.travel_m)
    widest_m = float(reach_m(first.sigma_m.max(), second.sigma_m.max()))
    near: Any = cKDTree(first.position[one, :2]).query_ball_point(
        second.position[other, :2], widest_m, return_sorted=True
    )
    for pose, candidates in zip(other.tolist(), near, strict=True):
        for index in candidates:
            earlier = int(one[index])
            apart_m = np.linalg.norm((first.position[earlier] - second.position[pose])[:2])
            if apart_m < reach_m(first.sigma_m[earlier], second.sigma_m[pose]):
                yield earlier, pose
