"""Path of the fixes alone, for odometry that predicts fixes worse than their neighbours do."""

from dataclasses import replace

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.recording import OdometryRecording
from survey.data.sensors.aiding import GpsFixes
from survey.data.sensors.odometry import Odometry
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import smooth
from vision_slam.rotation import rotations

_LEAST_FIXES = 5
_STEP_SIGMA_M = 0.3  # error of straight lines between fixes, per square root of a metre [m]
# Columns of the errors of fixes that were left out.
_PATH, _FIXES = slice(1, 3), slice(3, 5)


def is_worse_than_fixes(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> bool:
    """Test by cross-validation whether the smoothed path predicts fixes worse than their neighbours do.

    Every second fix is left out and predicted by the path smoothed with the others, and by linear
    interpolation between the others; then the same with the other half. The first fix and the last are predicted by
    the path beyond the others, and by the mean velocity of the nearest others. In a turn such a velocity is a bad
    prediction, which excuses no path that is worse between fixes: these are compared alone too. The path does not follow
    the slow error of the receiver, which neighbours share: what successive errors by the path have in common does not
    count, up to the assumed variance of that error.

    Parameters
    ----------
    recording : OdometryRecording
        Odometry and fixes.
    path : (N, 3) ndarray
        Dead-reckoned positions [m].
    config : LocalizationConfig
        Errors assumed of the sensors.

    Returns
    -------
    bool
        Whether the other squared horizontal errors by the path sum to more, with the first fix and the last or
        without; False for fewer than five fixes.
    """
    time_s, poses_s = recording.gps.time_s, recording.odometry.time_s
    gps = recording.gps.select((time_s >= poses_s[0]) & (time_s <= poses_s[-1]))
    if len(gps) < _LEAST_FIXES:
        return False
    halves = [_held_out(replace(recording, gps=gps), path, config, first) for first in (0, 1)]
    between = [half[(half[:, 0] > 0) & (half[:, 0] < len(gps) - 1)] for half in halves]
    return any(_sums_to_more(errors, config) for errors in (between, halves))


def _held_out(
    recording: OdometryRecording, path: FloatArray, config: LocalizationConfig, first: int
) -> FloatArray:
    """Return the number of every second fix from the first, and its errors by the path and by its neighbours (M, 5)."""
    gps, poses_s = recording.gps, recording.odometry.time_s
    held = np.zeros(len(gps), dtype=np.bool_)
    held[first::2] = True
    others = gps.select(~held)
    smoothed = smooth(replace(recording, gps=others), path, config).position
    by_path = _errors(gps, held, poses_s, smoothed)
    by_fixes = _errors(gps, held, gps.time_s, _extended(gps.time_s, others))
    return np.column_stack([np.flatnonzero(held), by_path, by_fixes])


def _sums_to_more(halves: list[FloatArray], config: LocalizationConfig) -> bool:
    """Test whether squared errors by the path, without what successive ones have in common, exceed those by fixes."""
    by_path, by_fixes = (
        sum(float((half[:, part] ** 2).sum()) for half in halves) for part in (_PATH, _FIXES)
    )
    common = sum(float((half[1:, _PATH] * half[:-1, _PATH]).sum()) for half in halves)
    slow = sum(half[:, _PATH].size * config.gps_bias_sigma_m**2 for half in halves)
    return by_path - min(max(common, 0.0), slow) > by_fixes


def along_fixes(
    recording: OdometryRecording, config: LocalizationConfig
) -> tuple[OdometryRecording, LocalizationConfig]:
    """Replace the odometry by straight lines between the fixes, with the errors of such lines.

    Roll and pitch stay; the heading is that of the lines.

    Parameters
    ----------
    recording : OdometryRecording
        Odometry and fixes.
    config : LocalizationConfig
        Errors assumed of the sensors.

    Returns
    -------
    recording : OdometryRecording
        Its path goes through the fixes.
    config : LocalizationConfig
        With the errors of straight lines between fixes.
    """
    odometry, gps = recording.odometry, recording.gps
    level = _extended(odometry.time_s, gps) - [0.0, 0.0, recording.antenna_height_m]
    steps = np.diff(level, axis=0)
    attitude = odometry.attitude_rad.copy()
    attitude[:-1, 2] = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    attitude[-1, 2] = attitude[-2, 2]
    own = np.einsum("nji,nj->ni", rotations(attitude[:-1]), steps)
    straight = Odometry(odometry.time_s, own, attitude)
    errors = config.model_copy(update={"step_sigma_m": _STEP_SIGMA_M, "start": "unknown"})
    return replace(recording, odometry=straight, start=level[0]), errors


def _extended(time_s: FloatArray, gps: GpsFixes) -> FloatArray:
    """Interpolate fixes; before the first and after the last go on at the mean velocity of a second or more."""
    place = np.column_stack([np.interp(time_s, gps.time_s, axis) for axis in gps.position.T])
    for end, other in ((0, min(2, len(gps) - 1)), (-1, max(-3, -len(gps)))):
        velocity = (gps.position[end] - gps.position[other]) / (gps.time_s[end] - gps.time_s[other])
        beyond_s = time_s - gps.time_s[end]
        is_beyond = beyond_s < 0.0 if end == 0 else beyond_s > 0.0
        place[is_beyond] += beyond_s[is_beyond, None] * velocity
    return place


def _errors(gps: GpsFixes, held: BoolArray, time_s: FloatArray, place: FloatArray) -> FloatArray:
    """Return the horizontal differences (M, 2) of the held-out fixes from a path [m]."""
    at = np.column_stack([np.interp(gps.time_s[held], time_s, axis) for axis in place[:, :2].T])
    errors: FloatArray = gps.position[held, :2] - at
    return errors
