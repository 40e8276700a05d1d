"""Check of the gyro's axes and unit against turns by images."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from vision_slam.odometry.checks.turns import ImageTurns

_AXES = "xyz"
_LEAST_TURN_RAD, _LEAST_PAIRS = np.radians(0.5), 8
# What does not count as a contradiction: scale and misalignment of the gyro, its bias.
_SCALE, _ASIDE, _BIAS_RAD_S = (0.7, 1.4), 0.3, np.radians(1.0)
# Shares of the turn by images that the gyro as stated must leave unexplained, and that another reading must explain.
_CONTRADICTED, _EXPLAINED = 0.5, 0.8
_ROUNDS, _LEAST_RESIDUAL_RAD = 5, np.radians(0.02)


class _Reading(NamedTuple):
    """Another reading of the gyro: the axis that an axis of the body is, and the factor."""

    axis: int
    factor: float


def refuse_other_gyro(turns: ImageTurns) -> None:
    r"""Refuse a gyro with an axis reversed or exchanged, or in degrees per second, that the images contradict.

    About an axis j of the body, the turns by images v and those by gyro g of good records agree as

    .. math:: v_j = a g_j + c_k g_k + c_l g_l + b t

    with the scale a within 0.7 and 1.4, misalignments |c| below 0.3 and a bias |b| below 1 degree per second. The gyro is
    refused where the best of these leaves half of the turns unexplained, and the same with another axis, sign or unit
    explains 80 %. Without eight turns of half a degree about an axis nothing is said about it.

    Parameters
    ----------
    turns : ImageTurns
        Turns by images and by gyro.

    Raises
    ------
    InputError
        With what explains the turns.

    Examples
    --------
    >>> turn = np.radians(np.outer(np.linspace(-4.0, 4.0, 12), [0.0, 0.0, 1.0]))
    >>> refuse_other_gyro(ImageTurns(np.full(12, 0.25), turn, turn))
    >>> refuse_other_gyro(ImageTurns(np.full(12, 0.25), turn, -turn))
    Traceback (most recent call last):
    ...
    survey.core.errors.InputError: in 10 turns of up to 4.0° the images turn about z as the gyro does about -z; ...
    """
    found = {axis: reading for axis in range(3) if (reading := _other_reading(turns, axis)) is not None}
    if not found:
        return
    n = sum(bool(np.abs(turn[list(found)]).max() >= _LEAST_TURN_RAD) for turn in turns.by_images)
    most_deg = float(np.degrees(np.abs(turns.by_images[:, list(found)]).max()))
    where = f"in {n} turns of up to {most_deg:.1f}°"
    factor = next((reading.factor for reading in found.values() if abs(reading.factor) != 1.0), None)
    if factor is not None:
        raise InputError(
            f"{where} the images turn by {factor:.3g} of what the gyro does; its rates must be in radians per second: "
            f"multiply them by {factor:.6g}."
        )
    ours = ", ".join(_AXES[axis] for axis in found)
    theirs = ", ".join(("-" if other.factor < 0.0 else "") + _AXES[other.axis] for other in found.values())
    raise InputError(
        f"{where} the images turn about {ours} as the gyro does about {theirs}; turn the inertial readings into the axes of "
        "the body, x forward, y left, z up, or correct T_body_camera of the camera."
    )


def _other_reading(turns: ImageTurns, axis: int) -> _Reading | None:
    """Return the reading that explains the turns about an axis where the stated one does not; None without a contradiction."""
    is_turn = np.abs(turns.by_images[:, axis]) >= _LEAST_TURN_RAD
    if is_turn.sum() < _LEAST_PAIRS:
        return None
    used = ImageTurns(*(part[is_turn] for part in turns))
    if _explained(used, axis, _Reading(axis, 1.0)) > _CONTRADICTED:
        return None
    others = [_Reading(axis, -1.0), _Reading(axis, np.pi / 180.0), _Reading(axis, 180.0 / np.pi)]
    others += [_Reading(other, sign) for other in range(3) if other != axis for sign in (1.0, -1.0)]
    shares = [_explained(used, axis, other) for other in others]
    best = int(np.argmax(shares))
    return others[best] if shares[best] >= _EXPLAINED else None


def _explained(turns: ImageTurns, axis: int, reading: _Reading) -> float:
    """Return the share of the turns by images about an axis that a reading of the gyro explains, in sums of absolute values."""
    by_images = turns.by_images[:, axis]
    design = np.column_stack([reading.factor * turns.by_gyro, turns.seconds])
    least, most = np.r_[np.full(3, -_ASIDE), -_BIAS_RAD_S], np.r_[np.full(3, _ASIDE), _BIAS_RAD_S]
    least[reading.axis], most[reading.axis] = _SCALE
    weight: FloatArray = np.ones(len(by_images))
    for _ in range(_ROUNDS):  # the least sum of absolute residuals, by weights
        found = lsq_linear(weight[:, None] * design, weight * by_images, (least, most))
        residual = np.abs(design @ found.x - by_images)
        weight = np.maximum(residual, _LEAST_RESIDUAL_RAD) ** -0.5
    return float(1.0 - residual.sum() / np.abs(by_images).sum())
