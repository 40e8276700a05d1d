"""Loop closures from top-down ground mosaics, within a drive and between drives.

Poses that may be at one place, within three standard deviations of the paths, are compared by their ground views (`recognized`), and
the best overlay of each meeting is kept (`best_of_meetings`). `detect_loop_closures` does this for one path, `detect_drive_ties` for
the paths of two drives. Ground whose texture repeats within the uncertainty of the path gives false matches, which the gate of
the smoother must reject.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from survey import Camera, InputError, Recording, Trajectory
from survey.core import FloatArray, IntArray
from survey.data.frames import Frames
from survey.data.sensors.odometry import DriveTies, LoopClosures
from vision_slam.attitude import rotations
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.places.ground_view import GroundMosaics, Overlay, match_overlay

KEY_SPACING_M = 1.0
SIGMAS = 3.0
# Views this near to one another are compared even where the paths are exact; mosaics 6 m wide share no ground beyond that.
_REACH_M, _WIDEST_M = 1.5, 6.0
_MEETING_M = (
    4.0  # overlays nearer to one another along both paths are of one meeting, of which the best is kept
)
_LEAST_AGREE = 25
_N_VIEWS = 64
# These, and the least number that agree, were chosen on drives over ground that is known.
_SIGMA_M, _SIGMA_PER_FEATURE_M = 0.02, 0.42
_UP_SIGMA_M, _UP_SIGMA_PER_FEATURE_M = 0.02, 0.15


class SeenPath(NamedTuple):
    """Path with the ground around it: mosaics, positions (N, 3) [m] and their horizontal standard deviation (N,) [m]."""

    mosaics: GroundMosaics
    position: FloatArray
    sigma_m: FloatArray


class Meeting(NamedTuple):
    """Two poses that saw the same ground, and how the second view lies on the first."""

    first: int
    second: int
    overlay: Overlay


def spaced_poses(travel_m: FloatArray) -> IntArray:
    """Return poses about a metre of travel apart, from the first that has ground behind it."""
    marks = np.arange(2.0, travel_m[-1], KEY_SPACING_M)
    return np.unique(np.searchsorted(travel_m, marks))


def reach_m(first_sigma_m: FloatArray, second_sigma_m: FloatArray) -> FloatArray:
    """Return the distance within which two poses may see the same ground [m]."""
    return np.minimum(_REACH_M + SIGMAS * np.hypot(first_sigma_m, second_sigma_m), _WIDEST_M)


def recognized(first: SeenPath, second: SeenPath, pairs: Iterable[tuple[int, int]]) -> Iterator[Meeting]:
    """Yield the pairs of poses whose ground looks alike, with a shift that the paths allow."""
    views = [lru_cache(_N_VIEWS)(path.mosaics.around) for path in (first, second)]
    around = views if first is not second else [views[0]] * 2
    for one, other in pairs:
        overlay = match_overlay(around[0](one), around[1](other))
        if overlay is None or overlay.n_agree < _LEAST_AGREE:
            continue
        expected = (second.position[other] - first.position[one])[:2]
        shift_m = (first.mosaics.level(one) @ overlay.shift)[:2]
        sigma_m = np.hypot(first.sigma_m[one], second.sigma_m[other])
        allowed = SIGMAS * sigma_m + 2.0 * overlay_variance(overlay)[0] ** 0.5
        if np.linalg.norm(shift_m - expected) < allowed:
            yield Meeting(one, other, overlay)


def best_of_meetings(
    found: Iterable[Meeting], first_travel_m: FloatArray, second_travel_m: FloatArray
) -> list[Meeting]:
    """Select the overlay with the most inliers of each meeting: its neighbours see the same ground."""
    best: list[Meeting] = []
    for pair in sorted(found, key=lambda pair: -pair.overlay.n_agree):
        apart = [
            max(
                abs(first_travel_m[pair.first] - first_travel_m[other.first]),
                abs(second_travel_m[pair.second] - second_travel_m[other.second]),
            )
            for other in best
        ]
        if not apart or min(apart) > _MEETING_M:
            best.append(pair)
    return best


def overlay_variance(overlay: Overlay) -> FloatArray:
    """Return the variance (3,) [m²] of the shift of an overlay, from the number of features that agree."""
    level = _SIGMA_M**2 + _SIGMA_PER_FEATURE_M**2 / overlay.n_agree
    return np.array([level, level, _UP_SIGMA_M**2 + _UP_SIGMA_PER_FEATURE_M**2 / overlay.n_agree])


_LEAST_LOOP_M = 12.0  # of travel between the two views: shorter ones are tracked by odometry


def detect_loop_closures(recording: Recording, path: FloatArray, sigma_m: FloatArray) -> LoopClosures | None:
    r"""Detect places of a drive that images saw before, under any heading.

    Poses a metre apart that a path, within three of its standard deviations, puts near an
    earlier part of itself are compared by what the ground around them looks like from
    above; of each meeting the overlay counts on which most features agree, if these are 25
    and the shift is one that the path allows. Its standard deviation follows from their
    number n,

    .. math:: \sigma^2 = \sigma_0^2 + \sigma_1^2 / n

    with 2 cm and 42 cm on the level, 2 cm and 15 cm in height, from drives over ground
    that is known. Ground whose texture repeats itself within the path's own uncertainty
    deceives it: the smoother's gate has the last word.

    `path` (N, 3): estimated position of each pose [m]. `sigma_m` (N,): horizontal standard deviation of each
    position [m]. Returns: None where no place was recognized.
    """
    odometry, sightings = recording.odometry, recording.sightings
    if recording.frames is None or recording.camera is None or odometry is None or sightings is None:
        raise InputError(
            "places are recognized on images with their odometry and sightings; one of them lacks."
        )
    turn = rotations(odometry.attitude_rad)
    reckoned = dead_reckoning(odometry, np.zeros(3))
    mosaics = GroundMosaics(recording.frames, recording.camera, reckoned, odometry, sightings)
    seen = SeenPath(mosaics, path, sigma_m)
    travel_m = mosaics.travel_m
    matches = best_of_meetings(recognized(seen, seen, _nearby_poses(seen)), travel_m, travel_m)
    if not matches:
        return None
    rows = []
    for earlier, later, overlay in matches:
        offset = turn[earlier].T @ mosaics.level(earlier) @ overlay.shift
        tilt = turn[earlier].T @ mosaics.level(earlier)
        covariance = tilt @ np.diag(overlay_variance(overlay)) @ tilt.T
        rows.append((odometry.time_s[later], odometry.time_s[earlier], offset, covariance))
    rows.sort(key=lambda row: (row[0], row[1]))
    later_s, earlier_s, offsets, covariances = (np.array(column) for column in zip(*rows, strict=True))
    return LoopClosures(later_s, earlier_s, offsets, 0.5 * (covariances + covariances.transpose(0, 2, 1)))


def _nearby_poses(path: SeenPath) -> Iterator[tuple[int, int]]:
    """Yield pairs of poses, earlier first, that may be at one place."""
    travel_m = path.mosaics.travel_m
    keys = spaced_poses(travel_m)
    for index, later in enumerate(keys.tolist()):
        before = keys[:index][travel_m[keys[:index]] < travel_m[later] - _LEAST_LOOP_M]
        apart = np.linalg.norm((path.position[before] - path.position[later])[:, :2], axis=1)
        reach = reach_m(path.sigma_m[before], path.sigma_m[later])
        for earlier in before[apart < reach].tolist():
            yield earlier, later


_EVERY_POSE = 2  # of the first drive's poses a metre apart: a view reaches 3 m to each side


class SeenDrive(NamedTuple):
    """Images of a drive and what was estimated from them.

    `frames`: images. `camera`: that took them. `visual`: their odometry and landmarks, in metres and for the
    body. `trajectory`: estimated path, at the times of the odometry.
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

    Returns: None where no two drives saw a common place.

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
    found = recognized(first, second, _nearby_poses_of_drives(first, second))
    times = [drive.visual.odometry.time_s for drive in drives]
    for meeting in best_of_meetings(found, first.mosaics.travel_m, second.mosaics.travel_m):
        offset, covariance = _in_world(first, meeting)
        yield float(times[a][meeting.first]), a, b, float(times[b][meeting.second]), offset, covariance


def _in_world(first: SeenPath, meeting: Meeting) -> tuple[FloatArray, FloatArray]:
    """Return the offset of the second body (3,) in the axes of the world, and its covariance (3, 3)."""
    level = first.mosaics.level(meeting.first)
    covariance = level @ np.diag(overlay_variance(meeting.overlay)) @ level.T
    return level @ meeting.overlay.shift, 0.5 * (covariance + covariance.T)


def _nearby_poses_of_drives(first: SeenPath, second: SeenPath) -> Iterator[tuple[int, int]]:
    """Yield pairs of poses of two drives that may be at one place."""
    one, other = spaced_poses(first.mosaics.travel_m)[::_EVERY_POSE], spaced_poses(second.mosaics.travel_m)
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
