"""Scale and tilt of the odometry, from the extent of the fixes.

`fit_scale` finds the scale of visual odometry without wheels by the least-squares similarity of the plane, and
`scale_visual_odometry` applies it. `refuse_other_wheel_scale` compares the scale of wheels with the fixes, and `tilt_note`
finds a tilted camera by the shape of the path on the map. Paths without extent, or of another shape than the fixes, give no
result.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from survey.core import FloatArray, InputError
from survey.data.sensors.records import GpsFixes
from vision_slam.attitude import rotations
from vision_slam.config import LocalizationConfig
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.scale_drift import scale_sightings

_LEAST_SPREAD_M = 20.0
_ROUNDS = 5  # each leaves an error of the lever arm over the extent of the fixes
_FIX_ERROR_M = 3.0  # error of a receiver without corrections, which the scale inherits


def scale_by_fixes(path: FloatArray, time_s: FloatArray, gps: GpsFixes) -> tuple[float, float]:
    r"""Estimate the factor that scales a path to its fixes.

    It is the factor of the similarity of the plane with the least squared misfit. With the
    path z and the fixes g as complex numbers about their means,

    .. math:: s = |Σ g \bar z| / Σ |z|²

    `path` (N, 3): positions in any unit and under any heading. `time_s` (N,): their times [s].

    >>> time_s = np.arange(50.0)
    >>> path = np.column_stack([time_s, 0.1 * time_s, np.zeros(50)])
    >>> round(scale_by_fixes(path, time_s, GpsFixes(time_s, 2.5 * path))[0], 6)
    2.5
    """
    inside = (gps.time_s >= time_s[0]) & (gps.time_s <= time_s[-1])
    x, y = (np.interp(gps.time_s[inside], time_s, path[:, axis]) for axis in (0, 1))
    z, g = x + 1j * y, gps.position[inside, 0] + 1j * gps.position[inside, 1]
    z, g = z - z.mean(), g - g.mean()
    size = float((np.abs(z) ** 2).sum())
    factor = float(np.abs((g * z.conj()).sum())) / max(size, 1e-12)
    # The errors of fixes a minute apart are correlated: the spread of the fixes counts, not their number.
    return factor, _FIX_ERROR_M / max(float(np.sqrt((np.abs(g) ** 2).mean())), 1e-12)


def fit_scale(visual: VisualOdometry, start: FloatArray, gps: GpsFixes) -> tuple[float, float]:
    """Estimate the factor that scales visual odometry to fixes of the body.

    The path of the body is that of the camera times the factor, less the lever arm in metres: the factor is
    found by fixed-point iteration.

    `start` (3,): position of the body at the first image [m].
    """
    time_s = visual.odometry.time_s
    factor, sigma = scale_by_fixes(dead_reckoning(visual.odometry, start), time_s, gps)
    for _ in range(0 if visual.lever_arm_m is None else _ROUNDS):
        of_body = dead_reckoning(scale_visual_odometry(visual, factor).odometry, start)
        change, sigma = scale_by_fixes(of_body, time_s, gps)
        factor *= change
    return factor, sigma


def scale_visual_odometry(visual: VisualOdometry, factor: float) -> VisualOdometry:
    r"""Return the motion of the body and its landmarks with all lengths multiplied by a factor.

    Where steps s and offsets of sightings x are those of a camera with the lever arm a, they become those of
    the body:

    .. math:: s_k' = f s_k + a - R_k^T R_{k+1} a, \qquad x' = f x + a
    """
    o = visual.odometry
    step, sightings = factor * o.step, scale_sightings(visual.sightings, np.full(len(o.time_s), factor))
    arm = visual.lever_arm_m
    if arm is not None:
        turn = rotations(o.attitude_rad)
        step = step + arm - np.einsum("nji,njk,k->ni", turn[:-1], turn[1:], arm)
        sightings = replace(sightings, offset=sightings.offset + arm)
    step_sigma_m = None if o.step_sigma_m is None else factor * o.step_sigma_m
    odometry = replace(o, step=step, step_sigma_m=step_sigma_m)
    return replace(visual, odometry=odometry, sightings=sightings, lever_arm_m=None)


def refuse_untracked(visual: VisualOdometry) -> None:
    """Refuse images of which not one could be tracked: without wheels their motion is unknown."""
    if not any(frame.is_visual for frame in visual.health[1:]):
        raise InputError(
            f"none of {len(visual.health)} images could be followed from the one before, and there are no wheels; "
            "they may be blank, too far apart, or of another camera than the calibration."
        )


def refuse_short_fixes(gps: GpsFixes, time_s: FloatArray) -> None:
    """Refuse fixes whose extent during the images cannot give a scale."""
    inside = (gps.time_s >= time_s[0]) & (gps.time_s <= time_s[-1])
    spread = float(np.linalg.norm(np.ptp(gps.position[inside, :2], axis=0))) if inside.any() else 0.0
    if spread < _LEAST_SPREAD_M:
        raise InputError(
            f"the fixes spread over {spread:.1f} m, and without wheels they give the scale of the images; "
            f"at least {_LEAST_SPREAD_M:.0f} m are needed, or a table wheels.csv."
        )


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

    `path` (N, 3): positions by images and wheels [m]. `time_s` (N,): their times [s].

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
    sigma = config.fix_sigma_m * len(pairs.fixes) ** 0.5 / _size(pairs.fixes[:, :2])
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

    `path` (N, 3): positions by images, in any unit and under any heading. `time_s` (N,): their times [s].
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
    height_m = config.gps_vertical_factor * config.fix_sigma_m
    least_rad = np.arctan(_SIGMAS * height_m * len(pairs.fixes) ** 0.5 / max(_size(pairs.fixes), 1e-9))
    tilt = float(abs(rise[0] - rise[1]))
    return tilt if tilt > least_rad else 0.0


def _likeness_on_map(pairs: _Pairs) -> float:
    """Return the correlation of path and fixes on the map, under the best heading and scale."""
    z, g = (part[:, 0] + 1j * part[:, 1] for part in pairs)
    return float(abs(np.vdot(z, g)) / max(_size(z) * _size(g), 1e-12))


def _size(values: NDArray[Any]) -> float:
    return float(np.linalg.norm(values))
