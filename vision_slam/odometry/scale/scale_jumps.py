"""Detection and repair of stretches on which the scale of the images' map has jumped: wheels count less travel there."""

from dataclasses import replace

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.data.sensors.aiding import Wheels
from survey.data.sensors.sightings import Sightings
from vision_slam.odometry.health import FrameHealth

# Least travel over which lengths by images and by wheels are compared [m], and least number of steps.
_WINDOW_M, _WINDOW_STEPS = 1.0, 4
# A length by images counts as too large where its logarithm exceeds that by wheels by more than this.
_TOO_LONG = 0.15
# Wheels that contradict more of the drive than this are wrong themselves.
_MOST_OF_DRIVE = 0.2
# So many landmarks within so many heights of the camera show how large the map is.
_NEAR, _LEAST_NEAR = 4.0, 4
# At least this share of the excess must show in the depth of the ground; an excess above the other needs no ground.
_CONFIRMED, _CERTAIN = 0.5, 0.25
# Wheels spin when a rover sets off, for so many metres of its map.
_SETTING_OFF_M = 1.5
# Readings of the wheels may be so many image intervals apart.
_INTERVALS = 2.0
# Corners that were followed since before a jump end within this travel after it [m].
_TRACKS_M = 1.0


def travel_between(wheels: Wheels, time_s: FloatArray) -> FloatArray:
    """Return the travel by wheels between times of images (N - 1,) [m]; NaN where readings are too far apart, or none."""
    counted = np.interp(time_s, wheels.time_s, 0.5 * (wheels.left_m + wheels.right_m), np.nan, np.nan)
    after = np.clip(np.searchsorted(wheels.time_s, time_s), 1, len(wheels.time_s) - 1)
    apart_s = wheels.time_s[after] - wheels.time_s[after - 1]
    counted[apart_s > _INTERVALS * float(np.median(np.diff(time_s)))] = np.nan
    return np.diff(counted)


def bridge_scale_jumps(
    steps: FloatArray,
    rolled_m: FloatArray,
    sightings: Sightings,
    health: tuple[FrameHealth, ...],
    height_m: float,
) -> tuple[FloatArray, Sightings, tuple[FrameHealth, ...]]:
    """Give steps on which the scale has jumped the travel by wheels, and leave out the landmarks seen there.

    Parameters
    ----------
    steps : (N - 1, 3) ndarray
        Steps between poses [m].
    rolled_m : (N - 1,) ndarray
        Travel by wheels [m], NaN where they did not measure.
    sightings : Sightings
        Landmarks relative to the poses.
    health : tuple of FrameHealth
        Health of the N images.
    height_m : float
        Height of the camera above the ground [m].

    Returns
    -------
    steps : (N - 1, 3) ndarray
        Steps with the corrected lengths.
    sightings : Sightings
        Landmarks that no jump has touched.
    health : tuple of FrameHealth
        Images whose step was corrected count as not visual: their steps rest on the wheels.
    """
    length = np.linalg.norm(steps, axis=1)
    factor = scale_jumps(length, rolled_m, sightings, height_m)
    if (factor == 1.0).all():
        return steps, sightings, health
    seen = sightings.select(~_beside_jumps(factor, length)[sightings.pose])
    bridged = tuple(
        replace(frame, is_visual=frame.is_visual and by == 1.0)
        for frame, by in zip(health, [1.0, *factor.tolist()], strict=True)
    )
    return steps * factor[:, None], seen, bridged


def scale_jumps(
    step_m: FloatArray, rolled_m: FloatArray, sightings: Sightings, height_m: float
) -> FloatArray:
    r"""Return the factors (N - 1,) that correct steps on which the scale of the images' map has jumped; 1 elsewhere.

    Wheels that slip or skid count more than the body moves, not less. So where the travel by images L exceeds that by
    wheels R over a metre,

    .. math::  \log(L / R) - \operatorname{median} \log(L / R) > 0.15 ,

    either the map is too large or the body slides with its wheels at rest. The ground decides: a map that is k times too
    large puts it (k - 1) heights of the camera below the body. Where fewer than four landmarks show the ground, a slide of
    more than 28 % is taken for a jump. Maps that are too small are not found: wheels that slip look the same.

    Parameters
    ----------
    step_m : (N - 1,) ndarray
        Travel by images between poses [m].
    rolled_m : (N - 1,) ndarray
        Travel by wheels [m], NaN where they did not measure.
    sightings : Sightings
        Landmarks relative to the poses.
    height_m : float
        Height of the camera above the ground [m].

    Examples
    --------
    >>> step = np.full(100, 0.25)
    >>> step[45:55] *= 2.0
    >>> none = Sightings(np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    >>> scale_jumps(step, np.full(100, 0.25), none, 0.7)[[20, 50, 80]]
    array([1. , 0.5, 1. ])
    """
    factor, before_m = np.ones(len(step_m)), np.cumsum(step_m) - step_m
    excess = _excess(step_m, np.abs(rolled_m))
    too_long = excess > _TOO_LONG
    if step_m[too_long].sum() > _MOST_OF_DRIVE * step_m.sum():
        return factor
    for steps in _runs(too_long):
        if not _ground_confirms(sightings, steps, float(np.median(excess[steps])), height_m):
            continue
        factor[steps] = np.exp(-excess[steps])
        if before_m[steps[0]] < _SETTING_OFF_M:  # wheels that spin gave the map its size
            factor[: steps[0]] = factor[steps].min()
    return factor


def _beside_jumps(factor: FloatArray, step_m: FloatArray) -> BoolArray:
    """Return the poses (N,) whose landmarks may have been triangulated across a jump."""
    travel = np.r_[0.0, np.cumsum(step_m)]
    torn = np.flatnonzero(factor < 1.0)
    if not len(torn):
        return np.zeros(len(travel), dtype=bool)
    place = np.searchsorted(travel[torn], travel)
    before = travel[torn][np.maximum(place - 1, 0)]
    after = travel[torn + 1][np.minimum(place, len(torn) - 1)]
    beside: BoolArray = (np.abs(travel - before) <= _TRACKS_M) | (np.abs(after - travel) <= _TRACKS_M)
    return beside


def _excess(step_m: FloatArray, rolled_m: FloatArray) -> FloatArray:
    """Return log(L / R) (N - 1,) over some travel about each step, less its median; 0 where wheels did not measure."""
    travel, known = np.r_[0.0, np.cumsum(step_m)], np.isfinite(rolled_m)
    rolled = np.r_[0.0, np.cumsum(np.where(known, rolled_m, step_m))]
    middle, window_m = (
        0.5 * (travel[1:] + travel[:-1]),
        max(_WINDOW_M, _WINDOW_STEPS * float(np.median(step_m))),
    )
    ends = [np.clip(middle + side * 0.5 * window_m, 0.0, travel[-1]) for side in (-1.0, 1.0)]
    by_images = ends[1] - ends[0]
    by_wheels = np.interp(ends[1], travel, rolled) - np.interp(ends[0], travel, rolled)
    measured = known & (by_images > 0.0) & (by_wheels > 0.0)
    ratio = np.zeros(len(step_m))
    ratio[measured] = np.log(by_images[measured] / by_wheels[measured])
    return np.where(measured, ratio - (np.median(ratio[measured]) if measured.any() else 0.0), 0.0)


def _runs(chosen: BoolArray) -> list[IntArray]:
    """Return the indices of each run of chosen steps."""
    index = np.flatnonzero(chosen)
    return np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(index) else []


def _ground_confirms(sightings: Sightings, steps: IntArray, excess: float, height_m: float) -> bool:
    """Return whether the ground near the poses of a run lies as deep as a map that is too large puts it.

    Where too little of it was seen, a large excess is enough.
    """
    seen = (sightings.pose >= steps[0]) & (sightings.pose <= steps[-1] + 1)
    near = seen & (np.hypot(*sightings.offset[:, :2].T) < _NEAR * height_m * np.exp(excess))
    if near.sum() < _LEAST_NEAR:
        return excess > _CERTAIN
    depth = -float(np.median(sightings.offset[near, 2]))
    return depth > _CONFIRMED * height_m * float(np.expm1(excess))
