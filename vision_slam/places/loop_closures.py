"""Loop closures from top-down ground mosaics."""

from collections.abc import Iterator

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.sensors.loop_closures import LoopClosures
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.places.ground_view import GroundMosaics
from vision_slam.places.meetings import (
    SeenPath,
    best_of_meetings,
    overlay_variance,
    reach_m,
    recognized,
    spaced_poses,
)
from vision_slam.rotation import rotations

_LEAST_LOOP_M = 12.0


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

    Parameters
    ----------
    recording : Recording
        With frames, camera, and the odometry and sightings that they gave.
    path : (N, 3) array_like
        Estimated position of each pose [m].
    sigma_m : (N,) array_like
        Horizontal standard deviation of each position [m].

    Returns
    -------
    LoopClosures or None
        None where no place was recognized.

    Raises
    ------
    InputError
        The recording lacks frames, odometry or sightings.
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
    matches = best_of_meetings(recognized(seen, seen, _near(seen)), travel_m, travel_m)
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


def _near(path: SeenPath) -> Iterator[tuple[int, int]]:
    """Yield pairs of poses, earlier first, that may be at one place."""
    travel_m = path.mosaics.travel_m
    keys = spaced_poses(travel_m)
    for index, later in enumerate(keys.tolist()):
        before = keys[:index][travel_m[keys[:index]] < travel_m[later] - _LEAST_LOOP_M]
        apart = np.linalg.norm((path.position[before] - path.position[later])[:, :2], axis=1)
        reach = reach_m(path.sigma_m[before], path.sigma_m[later])
        for earlier in before[apart < reach].tolist():
            yield earlier, later
