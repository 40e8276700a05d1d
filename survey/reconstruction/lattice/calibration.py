"""Calibration of a lattice's standard deviation on blocks of points that are left out."""

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from survey.core.arrays import BoolArray, FloatArray
from survey.core.streams import stream
from survey.reconstruction.base import SIGMAS_95
from survey.reconstruction.observations import Predict

_BLOCK_IN_STEPS, _THIN_IN_STEPS = 4.0, 2.0
_N_FOLDS, _SHARE = 3, 1.0 / 6.0
_N_LEAST = 40
# Without enough blocks to say otherwise both factors are 1, give or take a factor of 1.6.
_PRIOR_LOG_SD = 0.5
_LOG_BOUNDS = ((0.0, 3.0), (-2.5, 2.5))


class LatticeCalibration(NamedTuple):
    """Factors on the surface's standard deviation and on the points' errors."""

    surface: float = 1.0
    points: float = 1.0
    n_held_out: int = 0
    coverage_95_before: float = float("nan")
    coverage_95_after: float = float("nan")

    def facts(self) -> dict[str, Any]:
        """Return the factors and what they rest on, for the record."""
        return {name: value for name, value in self._asdict().items() if value == value}  # noqa: PLR0124  (NaN)


def calibrated(
    points: FloatArray, noise_m2: FloatArray, step_m: float, predict: Predict
) -> LatticeCalibration:
    r"""Leave out blocks of four steps, a sixth of them at a time, predict their points, and compare.

    The factors a and c on the standard deviations of surface and points maximise

    .. math::  \sum_i \log N(e_i; 0, a^2 v_i + c^2 \sigma_i^2) - \frac{\log^2 a + \log^2 c}{2 \cdot 0.5^2}

    over one point per cell of two steps, so that every place counts alike: with the
    prediction error e, its variance v and the point's own variance σ².

    Parameters
    ----------
    points : (N, 4) ndarray
        Easting, northing, height [m], and weight.
    noise_m2 : (N,) ndarray
        Variances of the points' errors [m²].
    step_m : float
        Distance between the nodes [m].
    predict : callable
        Maps from some of the points.

    Notes
    -----
    The surface's factor never falls below 1: points stand where the sensor could see, so that
    they can prove a map too bold and not too cautious.
    """
    errors = [_fold(points, noise_m2, step_m, predict, k) for k in range(_N_FOLDS)]
    return likeliest_factors(*(np.concatenate(column) for column in zip(*errors, strict=True)))


def likeliest_factors(error: FloatArray, variance: FloatArray, noise: FloatArray) -> LatticeCalibration:
    """Return the factors of `calibrated` by predictions; both are 1 with fewer than 40 of them.

    Parameters
    ----------
    error : (N,) ndarray
        Prediction errors [m].
    variance, noise : (N,) ndarray
        Variances of the surface and of the measurements [m²].
    """
    if len(error) < _N_LEAST:
        return LatticeCalibration()

    def negative(logs: FloatArray) -> float:
        total = np.exp(2.0 * logs[0]) * variance + np.exp(2.0 * logs[1]) * noise
        misfit = 0.5 * float(np.sum(np.log(total) + error**2 / total))
        return misfit + 0.5 * float(np.sum(logs**2)) / _PRIOR_LOG_SD**2

    a, c = np.exp(minimize(negative, np.zeros(2), method="L-BFGS-B", bounds=_LOG_BOUNDS).x)
    before, after = variance + noise, a**2 * variance + c**2 * noise
    return LatticeCalibration(
        float(a), float(c), len(error), _coverage(error, before), _coverage(error, after)
    )


def _fold(
    points: FloatArray, noise_m2: FloatArray, step_m: float, predict: Predict, k: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return errors, variances of the surface and variances of the points that were left out in one fold."""
    out = left_out_blocks(points[:, :2], _BLOCK_IN_STEPS * step_m, _SHARE, k)
    if out.all() or not out.any():
        nothing = np.zeros(0)
        return nothing, nothing, nothing
    cells = np.floor(points[out, :2] / (_THIN_IN_STEPS * step_m)).astype(np.int64)
    asked = np.flatnonzero(out)[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    mean, variance = predict(~out, points[asked, :2])
    known = np.isfinite(mean)
    error: FloatArray = points[asked, 2] - mean
    return error[known], variance[known], noise_m2[asked][known]


def left_out_blocks(xy: FloatArray, side_m: float, share: float, number: int) -> BoolArray:
    """Return which points (N,) lie in blocks that are left out; always the same ones for one number."""
    blocks, index = np.unique(np.floor(xy / side_m).astype(np.int64), axis=0, return_inverse=True)
    chosen = stream(number, "lattice", "blocks left out").random(len(blocks)) < share
    out: BoolArray = chosen[index.ravel()]
    return out


def _coverage(error: FloatArray, variance: FloatArray) -> float:
    return float(np.mean(np.abs(error) <= SIGMAS_95 * np.sqrt(variance)))
