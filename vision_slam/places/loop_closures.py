"""Loop closures from top-down ground mosaics."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.sensors.loop_closures import LoopClosures
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.places.ground_view import GroundMosaics
from vision_slam.places.overlay import Overlay, match_overlay
from vision_slam.rotation import rotations

_KEY_SPACING_M = 1.0
_LEAST_LOOP_M = 12.0
_REACH_M = 1.5
_WIDEST_M = 6.0
_SIGMAS = 3.0
_MEETING_M = 4.0
_LEAST_AGREE = 25
_N_VIEWS = 64
# These, and the least number that agree, were chosen on drives over ground that is known.
_SIGMA_M, _SIGMA_PER_FEATURE_M = 0.02, 0.42
_UP_SIGMA_M, _UP_SIGMA_PER_FEATURE_M = 0.02, 0.15


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
    matches = _best_of_meetings(list(_recognized(mosaics, path, sigma_m)), mosaics.travel_m)
    if not matches:
        return None
    rows = []
    for earlier, later, overlay in matches:
        offset = turn[earlier].T @ mosaics.level(earlier) @ overlay.shift
        tilt = turn[earlier].T @ mosaics.level(earlier)
        covariance = tilt @ np.diag(_variance(overlay.n_agree)) @ tilt.T
        rows.append((odometry.time_s[later], odometry.time_s[earlier], offset, covariance))
    rows.sort(key=lambda row: (row[0], row[1]))
    later_s, earlier_s, offsets, covariances = (np.array(column) for column in zip(*rows, strict=True))
    return LoopClosures(later_s, earlier_s, offsets, 0.5 * (covariances + covariances.transpose(0, 2, 1)))


def _recognized(
    mosaics: GroundMosaics, path: FloatArray, sigma_m: FloatArray
) -> Iterator[tuple[int, int, Overlay]]:
    """Yield earlier pose, later pose and overlay of all pairs near one another that look alike."""
    view = lru_cache(_N_VIEWS)(mosaics.around)
    for earlier, later in _near(mosaics.travel_m, path, sigma_m):
        overlay = match_overlay(view(earlier), view(later))
        if overlay is None or overlay.n_agree < _LEAST_AGREE:
            continue
        expected = (path[later] - path[earlier])[:2]
        shift_m = (mosaics.level(earlier) @ overlay.shift)[:2]
        allowed = (
            _SIGMAS * np.hypot(sigma_m[earlier], sigma_m[later]) + 2.0 * _variance(overlay.n_agree)[0] ** 0.5
        )
        if np.linalg.norm(shift_m - expected) < allowed:
            yield earlier, later, overlay


def _near(travel_m: FloatArray, path: FloatArray, sigma_m: FloatArray) -> Iterator[tuple[int, int]]:
    """Yield pairs of poses, earlier first, that may be at one place."""
    keys = _spaced(travel_m)
    for index, later in enumerate(keys.tolist()):
        before = keys[:index][travel_m[keys[:index]] < travel_m[later] - _LEAST_LOOP_M]
        apart = np.linalg.norm((path[before] - path[later])[:, :2], axis=1)
        reach = _REACH_M + _SIGMAS * np.hypot(sigma_m[before], sigma_m[later])
        for earlier in before[apart < np.minimum(reach, _WIDEST_M)].tolist():
            yield earlier, later


def _spaced(travel_m: FloatArray) -> IntArray:
    """Poses about a metre of travel apart, from the first that has ground behind it."""
    marks = np.arange(2.0, travel_m[-1], _KEY_SPACING_M)
    return np.unique(np.searchsorted(travel_m, marks))


def _best_of_meetings(
    matches: list[tuple[int, int, Overlay]], travel_m: FloatArray
) -> list[tuple[int, int, Overlay]]:
    """Select the overlay with the most inliers of each meeting: its neighbours see the same ground."""
    best: list[tuple[int, int, Overlay]] = []
    for earlier, later, overlay in sorted(matches, key=lambda pair: -pair[2].n_agree):
        apart = [
            max(abs(travel_m[earlier] - travel_m[a]), abs(travel_m[later] - travel_m[b])) for a, b, _ in best
        ]
        if not apart or min(apart) > _MEETING_M:
            best.append((earlier, later, overlay))
    return best


def _variance(n_agree: int) -> FloatArray:
    level = _SIGMA_M**2 + _SIGMA_PER_FEATURE_M**2 / n_agree
    return np.array([level, level, _UP_SIGMA_M**2 + _UP_SIGMA_PER_FEATURE_M**2 / n_agree])
