"""Kalman smoother of the speed along a path, with variances of maximum likelihood."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import BoolArray, FloatArray

# Variance of the change of speed over a typical interval, over that of the error of a speed.
_RATIOS = np.geomspace(1e-4, 1e2, 31)
_LEAST_RUN = 10  # steps; fewer do not show how even the motion is
_MOST_NOISE = 0.03  # of the speed; images are better than that, so that the clock is wrong


class _Fit(NamedTuple):
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

    Parameters
    ----------
    step : (N, 3) ndarray
        Steps in any unit.
    seconds : (N,) ndarray
        Their durations [s].
    is_moving : (N,) ndarray of bool
        Whether images measured a motion.

    Returns
    -------
    (N, 3) ndarray
        Steps with smoothed lengths.

    Examples
    --------
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
        fits = [_fit(speed, ratio * interval / interval.mean()) for ratio in _RATIOS]
        best = max(fits, key=lambda fit: fit.log_likelihood)
        if best.variance < (_MOST_NOISE * speed.mean()) ** 2 and (best.speed > 0.0).all():
            smoothed[first:last] *= (best.speed / speed)[:, None]
    return smoothed


def _fit(speed: FloatArray, walk: FloatArray) -> _Fit:
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
    return _Fit(-0.5 * ((n - 1) * np.log(noise) + log_det), noise, smooth)
