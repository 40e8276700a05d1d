"""Scale and speed of a finished drive: scale drift, scale jumps, smoothing of the steps.

`scale_corrections` estimates the scale drift from wheels and from the height of the camera above the ground, by least
squares with Cauchy's loss. `bridge_scale_jumps` finds stretches on which the scale has jumped, and takes the travel of the
wheels there. `smoothed_steps` is a Kalman smoother of the speed, with variances of maximum likelihood.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from survey.core import BoolArray, FloatArray, IntArray
from survey.data.sensors.odometry import Sightings
from survey.data.sensors.records import Wheels
from vision_slam.odometry.health import FrameHealth

# Relative errors over one metre: of scale drift, of the scale by wheels, and of that by the height of the camera.
_DRIFT_SIGMA, _ROLLED_SIGMA, _GROUND_SIGMA = 0.01, 0.015, 0.02
# Relative errors that stay: of the wheels, and of the height that the ground makes the camera have.
_WHEELS_SIGMA, _HEIGHT_SIGMA = 0.03, 0.005
# The first scale is unknown. A scale error of the wheels beyond this is that of the mounting of the camera.
_FIRST_SIGMA, _MOST_WHEEL_SCALE = 1.0, 0.06
_DOUBTED, _ROUNDS = 3.0, 8
_LEAST_ROLLED_M, _LEAST_TRAVEL_M, _LEAST_STOOD_M = 0.02, 1e-3, 10.0
# The ground that a body stands on, in heights of its camera; what keyframes saw that are further off has drifted.
_BENEATH, _LEAST_POINTS, _JUST_SEEN = 0.5, 4, 40
# Tracks rest on what stands out: on drives over ground that is known, a fifth of it lay higher than they.
_RESTS_ON = 0.8
# Over 2 m: a rover that turns skids, and its wheels count more than the travel.
_TURNS_RAD_M, _TURN_WITHIN_M = 0.03, 1.0


def scale_corrections(poses: FloatArray, rolled_m: FloatArray, ground: FloatArray) -> FloatArray:
    r"""Return the factors (K,) that correct the scale drift of the lengths between keyframes.

    With L_k the length of step k by images, R_k that by wheels, and g_k the `camera_height_ratio`
    at its end, the logarithms m_k by which the map is too large, w by which wheels count too
    much, and b by which the camera is mounted lower than is said, follow

    .. math::
        \log(R_k / L_k) = w − m_k, \qquad g_k = b − m_k, \qquad m_{k+1} − m_k = 0

    each give or take its own error. The most likely ones, by least squares with Cauchy's loss
    for wheels and ground, are what a Kalman smoother finds, forward and then backward. The
    factor is exp(−m_k).

    Wheels are used on straight stretches; where they spin, the loss removes them. A scale error
    of the wheels above 6 % is attributed to the mounting of the camera. Without wheels, or with
    less than 10 m of ground, the factors are 1.

    `poses` (K, 4, 4): body poses of the keyframes. `rolled_m` (K - 1,): travel by wheels from each to the
    next [m], NaN where they did not measure. `ground` (K,): `camera_height_ratio`, NaN where unknown.

    >>> poses = np.tile(np.eye(4), (101, 1, 1))
    >>> poses[:, 0, 3] = 0.2 * np.arange(101)
    >>> print(scale_corrections(poses, np.full(100, 0.206), np.full(101, 0.01)).round(3)[[0, 50, 100]])
    [1.011 1.011 1.011]
    """
    seen = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).clip(min=_LEAST_TRAVEL_M)
    rolled, n = np.abs(rolled_m), len(seen)
    is_measured, stands = rolled > _LEAST_ROLLED_M, np.flatnonzero(np.isfinite(ground[1:]))
    if not is_measured.any() or seen[stands].sum() < _LEAST_STOOD_M:
        return np.ones(len(poses))
    straight = np.flatnonzero(is_measured & ~_is_turning(poses, seen))
    step = sparse.eye_array(n, format="csr")
    design = sparse.vstack(
        [
            _scale_rows(step[1:] - step[:-1], 0.0, 0.0),
            _scale_rows(-step[straight], 1.0, 0.0),
            _scale_rows(-step[stands], 0.0, 1.0),
            _scale_rows(step[:1], 0.0, 0.0),
            sparse.eye_array(2, n + 2, k=n),
        ]
    )
    ratio = np.log(rolled[straight] / seen[straight])
    value = np.concatenate([np.zeros(n - 1), ratio, ground[1:][stands], np.zeros(3)])
    creep = _DRIFT_SIGMA * np.sqrt(0.5 * (seen[1:] + seen[:-1]))
    noise = [_ROLLED_SIGMA / np.sqrt(seen[straight]), _GROUND_SIGMA / np.sqrt(seen[stands])]
    sigma = np.concatenate([creep, *noise, [_FIRST_SIGMA, _WHEELS_SIGMA, _HEIGHT_SIGMA]])
    may_lie = np.arange(len(value)) >= n - 1
    may_lie[-3:] = False
    found = _most_likely(design, value, sigma, may_lie)
    too_large = found[:n] - found[n] + np.clip(found[n], -_MOST_WHEEL_SCALE, _MOST_WHEEL_SCALE)
    factor: FloatArray = np.exp(-np.r_[too_large, too_large[-1]])
    return factor


def camera_height_ratio(
    poses: FloatArray, sightings: Sightings, seen_from: IntArray, height_m: float
) -> FloatArray:
    """Return log(h / h_k) at each keyframe (K,), with h_k the height of the camera above the ground under the body.

    Ahead of it the ground may lie anywhere, but there the body rests on it: on what stands out,
    above four fifths of the landmarks that are half as far around as the camera is high. NaN
    where those are fewer than four.

    `poses` (K, 4, 4): body poses of the keyframes. `seen_from` (N,): the keyframe that each of them is
    relative to. `height_m`: the height h at which the camera is mounted [m].
    """
    world = poses[seen_from, :3, 3] + np.einsum("nij,nj->ni", poses[seen_from, :3, :3], sightings.offset)
    ratios, reach_m = np.full(len(poses), np.nan), _BENEATH * height_m
    if not len(world) or reach_m <= 0.0:
        return ratios
    for k, near in enumerate(cKDTree(world).query_ball_point(poses[:, :3, 3], np.sqrt(3.0) * reach_m)):
        index = np.array(near, dtype=np.int64)
        index = index[np.abs(seen_from[index] - k) <= _JUST_SEEN]
        body = (world[index] - poses[k, :3, 3]) @ poses[k, :3, :3]
        below = body[(np.abs(body) <= reach_m).all(axis=1), 2]
        if len(below) >= _LEAST_POINTS:
            ratios[k] = np.log(height_m / (height_m - np.quantile(below, _RESTS_ON)))
    return ratios


def scale_sightings(sightings: Sightings, factor: FloatArray) -> Sightings:
    """Return sightings whose lengths are `factor` (N,) times as large, pose by pose."""
    by = factor[sightings.pose]
    covariance = by[:, None, None] ** 2 * sightings.covariance
    return Sightings(sightings.pose, by[:, None] * sightings.offset, covariance, by * sightings.range_m)


def _scale_rows(steps: Any, wheels: float, rides: float) -> Any:
    """Rows of equations with some coefficients of the steps, and the same ones each of the two errors that stay."""
    return sparse.hstack([steps, sparse.csr_array(np.tile([wheels, rides], (steps.shape[0], 1)))])


def _most_likely(design: Any, value: FloatArray, sigma: FloatArray, may_lie: BoolArray) -> FloatArray:
    """Solve by least squares, reweighted so that what is off by much counts little where it may lie."""
    weight, found = np.ones(len(value)), np.zeros(design.shape[1])
    for _ in range(_ROUNDS):
        weighted = sparse.csr_array(design.T.multiply(weight / sigma**2))
        found = spsolve((weighted @ design).tocsc(), weighted @ value)
        off = (value - design @ found) / sigma
        weight = np.where(may_lie, 1.0 / (1.0 + (off / _DOUBTED) ** 2), 1.0)
    return found


def _is_turning(poses: FloatArray, seen: FloatArray) -> BoolArray:
    """Return whether the body turns on the way to the next keyframe (K - 1,)."""
    travel = np.r_[0.0, np.cumsum(seen)]
    heading = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    ahead, behind = (np.interp(travel + far, travel, heading) for far in (_TURN_WITHIN_M, -_TURN_WITHIN_M))
    turns = np.abs(ahead - behind) > _TURNS_RAD_M * 2.0 * _TURN_WITHIN_M
    either: BoolArray = turns[1:] | turns[:-1]
    return either


# Least travel over which lengths by images and by wheels are compared [m], and least number of steps.
_WINDOW_M, _WINDOW_STEPS = 1.0, 4
# A length by images counts as too large where its logarithm exceeds that by wheels by more than this.
_TOO_LONG = 0.15
# Wheels that contradict more of the drive than this are wrong themselves.
_MOST_OF_DRIVE = 0.2
# So many landmarks within so many heights of the camera show how large the map is.
_NEAR_HEIGHTS, _LEAST_NEAR = 4.0, 4
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

    `steps` (N - 1, 3): steps between poses [m]. `rolled_m` (N - 1,): travel by wheels [m], NaN where they did
    not measure. `height_m`: height of the camera above the ground [m]. Returns `steps` (N - 1, 3): steps with
    the corrected lengths.
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

    `step_m` (N - 1,): travel by images between poses [m]. `rolled_m` (N - 1,): travel by wheels [m], NaN
    where they did not measure. `height_m`: height of the camera above the ground [m].

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
    near = seen & (np.hypot(*sightings.offset[:, :2].T) < _NEAR_HEIGHTS * height_m * np.exp(excess))
    if near.sum() < _LEAST_NEAR:
        return excess > _CERTAIN
    depth = -float(np.median(sightings.offset[near, 2]))
    return depth > _CONFIRMED * height_m * float(np.expm1(excess))


# Variance of the change of speed over a typical interval, over that of the error of a speed.
_VARIANCE_RATIOS = np.geomspace(1e-4, 1e2, 31)
_LEAST_RUN = 10  # steps; fewer do not show how even the motion is
_MOST_NOISE = 0.03  # of the speed; images are better than that, so that the clock is wrong


class _SpeedFit(NamedTuple):
    """Log likelihood of a ratio, variance of the errors, and the smoothed speeds (N,)."""

    log_likelihood: float
    variance: float
    speed: FloatArray


def smoothed_steps(step: FloatArray, seconds: FloatArray, is_moving: BoolArray) -> FloatArray:
    r"""Return steps whose lengths follow an even motion as far as their own scatter suggests it.

    Within runs of moving steps the speeds y are those of a random walk v with independent errors,

    .. math:: y_k = v_k + e_k, \qquad v_{k+1} = v_k + w_k, \qquad w_k ∼ N(0, λ σ_e^2 Δt_k / \overline{Δt})

    with the ratio λ of maximum likelihood: a vehicle at constant speed is smoothed, stick-slip of a rover is
    not. Directions stay. Runs of fewer than ten steps stay as they are, as do those whose errors exceed 3 % of
    the speed.

    `step` (N, 3): steps in any unit. `seconds` (N,): their durations [s]. `is_moving` (N,) bool: whether
    images measured a motion. Returns (N, 3): steps with smoothed lengths.

    >>> step = np.zeros((40, 3))
    >>> step[:, 0] = 1.0 + 0.01 * np.random.default_rng(3).standard_normal(40)
    >>> even = smoothed_steps(step, np.full(40, 0.1), np.ones(40, dtype=bool))
    >>> bool(np.std(even[:, 0]) < 0.3 * np.std(step[:, 0]))
    True
    """
    length = np.linalg.norm(step, axis=1)
    smoothed = step.copy()
    edges = np.flatnonzero(np.diff(np.r_[False, is_moving & (length > 0.0), False].astype(int)))
    for first, last in edges.reshape(-1, 2).tolist():
        if last - first < _LEAST_RUN:
            continue
        speed, interval = length[first:last] / seconds[first:last], seconds[first:last]
        fits = [_fit_speed(speed, ratio * interval / interval.mean()) for ratio in _VARIANCE_RATIOS]
        best = max(fits, key=lambda fit: fit.log_likelihood)
        if best.variance < (_MOST_NOISE * speed.mean()) ** 2 and (best.speed > 0.0).all():
            smoothed[first:last] *= (best.speed / speed)[:, None]
    return smoothed


def _fit_speed(speed: FloatArray, walk: FloatArray) -> _SpeedFit:
    """Filter and smooth speeds (N,) whose change has the variance `walk` (N,) in units of that of their errors."""
    n = len(speed)
    mean, variance = np.empty(n), np.empty(n)
    mean[0], variance[0] = speed[0], 1.0
    squares, log_det = 0.0, 0.0
    for k in range(1, n):
        predicted = variance[k - 1] + walk[k]
        off, total = speed[k] - mean[k - 1], predicted + 1.0
        mean[k], variance[k] = mean[k - 1] + predicted / total * off, predicted / total
        squares += off**2 / total
        log_det += np.log(total)
    noise = max(squares / (n - 1), 1e-300)
    smooth = mean.copy()
    for k in range(n - 2, -1, -1):
        gain = variance[k] / (variance[k] + walk[k + 1])
        smooth[k] += gain * (smooth[k + 1] - mean[k])
    return _SpeedFit(-0.5 * ((n - 1) * np.log(noise) + log_det), noise, smooth)
