"""Lengths, once the whole drive has told the scale of the wheels: images hand theirs on, and it creeps."""

from dataclasses import dataclass

import numpy as np

from survey.arrays import BoolArray, FloatArray
from survey.sensors import Sightings

_WITHIN_M = 10.0
_LEAST_M = 2.0
# Over 2 m: a rover that turns skids, and its wheels count what nobody drove.
_TURNS_RAD_M, _TURN_WITHIN_M = 0.03, 1.0
# Wheels that differ by more from the images than usual, by the drive's median, slip a little there.
_SLIPS = 0.08


@dataclass(frozen=True)
class Told:
    """What wheels told of the travel to a keyframe [m], None where they did not, and the scale that they were given then."""

    travel_m: float | None
    scale: float


def by_wheels(poses: FloatArray, told: list[Told]) -> FloatArray:
    r"""Return what the lengths about each keyframe (K,) are to be multiplied by.

    The map of a window has the size of the one before it, and follows the wheels within
    some tens of metres; and the scale s of the wheels becomes known on the way. With the
    last of it, S, a keyframe at x along the way has

    .. math:: c(x) = Σ R_k S / s_k \,/\, Σ L_k

    over the steps k within 10 m that do not turn, with R the wheels' travel and L that by
    images. Elsewhere it is that of the nearest that has one, without any wheels 1.

    Parameters
    ----------
    poses : (K, 4, 4) ndarray
        Body poses of the keyframes.
    told : list of K - 1 Told
        The wheels' travel from each to the next.

    Examples
    --------
    >>> poses = np.tile(np.eye(4), (101, 1, 1))
    >>> poses[:, 0, 3] = 0.2 * np.arange(101)
    >>> print(by_wheels(poses, [Told(0.25, 1.0)] * 100).round(6)[[0, 50, 100]])
    [1.25 1.25 1.25]
    """
    seen = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    rolled = np.array([np.nan if step.travel_m is None else abs(step.travel_m) for step in told])
    if not np.isfinite(rolled).any():
        return np.ones(len(poses))
    last = told[int(np.flatnonzero(np.isfinite(rolled))[-1])]
    rolled *= last.scale / np.array([step.scale for step in told])
    travel: FloatArray = np.r_[0.0, np.cumsum(seen)]
    counts = np.isfinite(rolled) & (seen > 0.0) & ~_turns(poses, travel)
    ratio = np.log(np.where(counts, rolled, 1.0).clip(1e-6) / np.where(counts, seen, 1.0))
    counts &= np.abs(ratio - np.median(ratio[counts] if counts.any() else 0.0)) < _SLIPS
    about_seen = _within(travel, np.where(counts, seen, 0.0), _WITHIN_M)
    about_rolled = _within(travel, np.where(counts, rolled, 0.0), _WITHIN_M)
    known = about_seen > _LEAST_M
    if not known.any():
        return np.ones(len(poses))
    factor: FloatArray = np.interp(travel, travel[known], about_rolled[known] / about_seen[known])
    return factor


def resized(sightings: Sightings, factor: FloatArray) -> Sightings:
    """Return sightings whose lengths are `factor` (N,) times as large, pose by pose."""
    by = factor[sightings.pose]
    covariance = by[:, None, None] ** 2 * sightings.covariance
    return Sightings(sightings.pose, by[:, None] * sightings.offset, covariance, by * sightings.range_m)


def _turns(poses: FloatArray, travel: FloatArray) -> BoolArray:
    """Whether the body turns on the way to the next keyframe (K - 1,)."""
    heading = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    about = np.abs(_within(travel, np.diff(heading), _TURN_WITHIN_M))
    return np.maximum(about[1:], about[:-1]) > _TURNS_RAD_M * 2.0 * _TURN_WITHIN_M


def _within(travel: FloatArray, values: FloatArray, reach_m: float) -> FloatArray:
    """Sum what belongs to steps (K - 1,) over those within reach of each keyframe (K,)."""
    total = np.r_[0.0, np.cumsum(values)]
    # Keyframes that stand share their place; the sum over the place is that of all of them.
    first = np.searchsorted(travel, travel - reach_m)
    last = np.searchsorted(travel, travel + reach_m, side="right") - 1
    sums: FloatArray = total[last] - total[first]
    return sums
