"""Checks of scale and tilt: the path by images and wheels against the extent of the fixes."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.sensors.aiding import GpsFixes
from vision_slam.config import LocalizationConfig

_LEAST_FIXES = 4
_MOST_FACTOR = 1.5  # of the wheels' scale: worn tracks and slip make less
_SAME_SHAPE = 0.95  # correlation of path and fixes
_SIGMAS = 5.0
_BENDS = 0.02  # of the squared extent along the path, across it
# What a correlation on the map lacks to 1 where a tilt is looked for, also over what it lacks in space.
_OTHER_SHAPE, _CLEARLY = 0.02, 5.0
_TILTED_RAD, _UPRIGHT_RAD = np.radians(20.0), np.radians(60.0)


class _Pairs(NamedTuple):
    """Positions of the path and of the fixes at the same times (N, 3), each about its mean [m]."""

    path: FloatArray
    fixes: FloatArray


def refuse_other_wheel_scale(
    path: FloatArray, time_s: FloatArray, gps: GpsFixes, config: LocalizationConfig
) -> None:
    """Refuse wheels whose distances differ from those of the fixes by more than a factor of 1.5.

    The path must have the shape of the fixes, under any heading; else nothing is said.

    Parameters
    ----------
    path : (N, 3) ndarray
        Positions by images and wheels [m].
    time_s : (N,) ndarray
        Their times [s].
    gps : GpsFixes
        Fixes.
    config : LocalizationConfig
        Errors assumed of the fixes.

    Raises
    ------
    InputError
        With the factor.

    Examples
    --------
    >>> time_s = np.arange(50.0)
    >>> path = np.column_stack([time_s, 0.1 * time_s, np.zeros(50)])
    >>> refuse_other_wheel_scale(path, time_s, GpsFixes(time_s, path), LocalizationConfig())
    >>> refuse_other_wheel_scale(2.0 * path, time_s, GpsFixes(time_s, path), LocalizationConfig())
    Traceback (most recent call last):
    ...
    survey.core.errors.InputError: the path by wheels and images is 2.00 times as long as that of the fixes, ...
    """
    pairs = _paired(path, time_s, gps)
    if pairs is None:
        return
    if _likeness_on_map(pairs) < _SAME_SHAPE:
        return
    factor = _size(pairs.path[:, :2]) / _size(pairs.fixes[:, :2])
    sigma = _claimed_m(config) * len(pairs.fixes) ** 0.5 / _size(pairs.fixes[:, :2])
    if abs(np.log(factor)) > max(np.log(_MOST_FACTOR), _SIGMAS * sigma):
        raise InputError(
            f"the path by wheels and images is {factor:.2f} times as long as that of the fixes, where 1 was expected; check "
            "whether left_m and right_m are metres rolled, of the radius of the wheels and not of its double, and the unit "
            "of the fixes."
        )


def tilt_note(path: FloatArray, time_s: FloatArray, gps: GpsFixes, config: LocalizationConfig) -> str | None:
    """Return a note where path and fixes agree only under a tilt of more than 20 degrees; refuse one of 60.

    A path that does not bend shows only by how much it rises; one that bends shows its tilt to every side, by its shape on the
    map alone.

    Parameters
    ----------
    path : (N, 3) ndarray
        Positions by images, in any unit and under any heading.
    time_s : (N,) ndarray
        Their times [s].
    gps : GpsFixes
        Fixes.
    config : LocalizationConfig
        Errors assumed of the fixes.

    Returns
    -------
    str or None
        One sentence.

    Raises
    ------
    InputError
        A tilt of 60 degrees and more, under which the horizontal scale of the path means nothing.
    """
    pairs = _paired(path, time_s, gps)
    if pairs is None:
        return None
    tilt_rad = _tilt_rad(pairs, config)
    if tilt_rad < _TILTED_RAD:
        return None
    note = (
        f"the path by images has the shape of the fixes where it is tilted by {np.degrees(tilt_rad):.0f}°: the camera was "
        "not mounted, or not held at the first image, as T_body_camera says"
    )
    if tilt_rad >= _UPRIGHT_RAD:
        raise InputError(f"{note}; correct T_body_camera (--camera).")
    return f"{note}; correct it"


def _claimed_m(config: LocalizationConfig) -> float:
    """Return the horizontal standard deviation that is assumed of a fix [m]."""
    return float(np.hypot(config.gps_bias_sigma_m, config.gps_white_sigma_m))


def _paired(path: FloatArray, time_s: FloatArray, gps: GpsFixes) -> _Pairs | None:
    """Return path and fixes within its time, each about its mean; None for fewer than four fixes."""
    inside = (gps.time_s >= time_s[0]) & (gps.time_s <= time_s[-1])
    if inside.sum() < _LEAST_FIXES:
        return None
    at = np.column_stack([np.interp(gps.time_s[inside], time_s, axis) for axis in path.T])
    fixes = gps.position[inside]
    return _Pairs(at - at.mean(axis=0), fixes - fixes.mean(axis=0))


def _tilt_rad(pairs: _Pairs, config: LocalizationConfig) -> float:
    """Return the tilt that takes the path to the fixes; 0 where they agree without one, or have other shapes.

    Where the shape on the map contradicts the fixes and the one in space does not, the rotation of Kabsch has the tilt.
    Else it is the difference in rise of both main directions, where the heights of the fixes are sure of it.
    """
    left, sizes, right = np.linalg.svd(pairs.fixes.T @ pairs.path)
    in_space = float(sizes.sum() / max(_size(pairs.path) * _size(pairs.fixes), 1e-12))
    if in_space < _SAME_SHAPE:
        return 0.0
    if (
        1.0 - _likeness_on_map(pairs) > max(_OTHER_SHAPE, _CLEARLY * (1.0 - in_space))
        and sizes[1] > _BENDS * sizes[0]
    ):
        rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        return float(np.arccos(np.clip(rotation[2, 2], -1.0, 1.0)))
    rise = np.arcsin(np.clip([left[2, 0], right[0, 2]], -1.0, 1.0))
    height_m = config.gps_vertical_factor * _claimed_m(config)
    least_rad = np.arctan(_SIGMAS * height_m * len(pairs.fixes) ** 0.5 / max(_size(pairs.fixes), 1e-9))
    tilt = float(abs(rise[0] - rise[1]))
    return tilt if tilt > least_rad else 0.0


def _likeness_on_map(pairs: _Pairs) -> float:
    """Return the correlation of path and fixes on the map, under the best heading and scale."""
    z, g = (part[:, 0] + 1j * part[:, 1] for part in pairs)
    return float(abs(np.vdot(z, g)) / max(_size(z) * _size(g), 1e-12))


def _size(values: NDArray[Any]) -> float:
    return float(np.linalg.norm(values))
