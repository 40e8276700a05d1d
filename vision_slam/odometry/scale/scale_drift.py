"""Scale drift correction over the complete drive, from wheels and camera height."""

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.data.sensors.sightings import Sightings

# Relative errors over one metre: of scale drift, of the scale by wheels, and of that by the height of the camera.
_CREEP, _ROLLED, _GROUND = 0.01, 0.015, 0.02
# Relative errors that stay: of the wheels, and of the height that the ground makes the camera have.
_WHEELS_SIGMA, _HEIGHT_SIGMA = 0.03, 0.005
_ANY, _MOST = 1.0, 0.06
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

    Parameters
    ----------
    poses : (K, 4, 4) ndarray
        Body poses of the keyframes.
    rolled_m : (K - 1,) ndarray
        Travel by wheels from each to the next [m], NaN where they did not measure.
    ground : (K,) ndarray
        `camera_height_ratio`, NaN where unknown.

    Examples
    --------
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
    straight = np.flatnonzero(is_measured & ~_turns(poses, seen))
    step = sparse.eye_array(n, format="csr")
    design = sparse.vstack(
        [
            _rows(step[1:] - step[:-1], 0.0, 0.0),
            _rows(-step[straight], 1.0, 0.0),
            _rows(-step[stands], 0.0, 1.0),
            _rows(step[:1], 0.0, 0.0),
            sparse.eye_array(2, n + 2, k=n),
        ]
    )
    ratio = np.log(rolled[straight] / seen[straight])
    value = np.concatenate([np.zeros(n - 1), ratio, ground[1:][stands], np.zeros(3)])
    creep = _CREEP * np.sqrt(0.5 * (seen[1:] + seen[:-1]))
    noise = [_ROLLED / np.sqrt(seen[straight]), _GROUND / np.sqrt(seen[stands])]
    sigma = np.concatenate([creep, *noise, [_ANY, _WHEELS_SIGMA, _HEIGHT_SIGMA]])
    may_lie = np.arange(len(value)) >= n - 1
    may_lie[-3:] = False
    found = _most_likely(design, value, sigma, may_lie)
    too_large = found[:n] - found[n] + np.clip(found[n], -_MOST, _MOST)
    factor: FloatArray = np.exp(-np.r_[too_large, too_large[-1]])
    return factor


def camera_height_ratio(
    poses: FloatArray, sightings: Sightings, seen_from: IntArray, height_m: float
) -> FloatArray:
    """Return log(h / h_k) at each keyframe (K,), with h_k the height of the camera above the ground under the body.

    Ahead of it the ground may lie anywhere, but there the body rests on it: on what stands out,
    above four fifths of the landmarks that are half as far around as the camera is high. NaN
    where those are fewer than four.

    Parameters
    ----------
    poses : (K, 4, 4) ndarray
        Body poses of the keyframes.
    sightings : Sightings
        Landmarks.
    seen_from : (N,) ndarray
        The keyframe that each of them is relative to.
    height_m : float
        The height h at which the camera is mounted [m].
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


def _rows(steps: Any, wheels: float, rides: float) -> Any:
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


def _turns(poses: FloatArray, seen: FloatArray) -> BoolArray:
    """Return whether the body turns on the way to the next keyframe (K - 1,)."""
    travel = np.r_[0.0, np.cumsum(seen)]
    heading = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    ahead, behind = (np.interp(travel + far, travel, heading) for far in (_TURN_WITHIN_M, -_TURN_WITHIN_M))
    turns = np.abs(ahead - behind) > _TURNS_RAD_M * 2.0 * _TURN_WITHIN_M
    either: BoolArray = turns[1:] | turns[:-1]
    return either
