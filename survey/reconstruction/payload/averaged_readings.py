r"""Averages of a payload's readings over blocks of the way, and what a lagging sensor shows of the quantity there.

A sensor of time constant τ follows its surroundings x by ``ds/dt = (x - s) / τ``. Over a block of duration Δ in which
x is constant its mean reading and its state at the end are

.. math::  \bar y = w x + (1 - w) s_0, \quad s_1 = (1 - e) x + e s_0, \quad
           e = e^{-\Delta / \tau}, \quad w = 1 - (1 - e) \tau / \Delta
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from survey.core.arrays import FloatArray
from survey.data.sensors.payload import PayloadLog


class AveragedReadings(NamedTuple):
    """Averages of readings over blocks: ``value`` (n,), the blocks' places ``xy`` (n, 2), numbers of readings ``n_readings`` (n,).

    ``response`` (n, n) takes the quantity at the places to the averages; None for sensors that do not lag.
    """

    value: FloatArray
    xy: FloatArray
    n_readings: FloatArray
    response: FloatArray | None

    @classmethod
    def of(cls, logs: Sequence[PayloadLog], most: int) -> "AveragedReadings":
        """Average the readings of drives, each with places, over blocks of as many readings as `most` blocks need."""
        size = int(np.ceil(sum(len(log) for log in logs) / most))
        parts = [_averaged(log, size) for log in logs]
        responses = [part.response for part in parts if part.response is not None]
        return cls(
            np.concatenate([part.value for part in parts]),
            np.vstack([part.xy for part in parts]),
            np.concatenate([part.n_readings for part in parts]),
            block_diag(*responses) if responses else None,
        )

    def seen(self, columns: FloatArray) -> FloatArray:
        """Return what the averages show of functions at the places (n, ...)."""
        return columns if self.response is None else self.response @ columns

    def covariance(self, of_places: FloatArray) -> FloatArray:
        """Return the covariance (n, n) of the averages from that of the quantity at the places."""
        if self.response is None:
            return of_places
        covariance: FloatArray = self.response @ of_places @ self.response.T
        return covariance


def _averaged(log: PayloadLog, size: int) -> AveragedReadings:
    """Average the readings of one drive over blocks of `size` readings; a shorter rest joins the last block."""
    first = np.arange(0, max(len(log) - size + 1, 1), size)
    n_readings = np.diff(np.r_[first, len(log)]).astype(np.float64)
    assert log.xy is not None
    xy = np.add.reduceat(log.xy, first, axis=0) / n_readings[:, None]
    response = None
    if log.quantity.lag_s > 0.0 and log.time_s is not None:
        period_s = float(np.median(np.diff(log.time_s)))
        ends = np.r_[log.time_s[first[1:]], log.time_s[-1] + period_s]
        response = lag_response(np.diff(np.r_[log.time_s[0], ends]), log.quantity.lag_s)
    return AveragedReadings(np.add.reduceat(log.value, first) / n_readings, xy, n_readings, response)


def lag_response(duration_s: FloatArray, lag_s: float) -> FloatArray:
    """Return the matrix (n, n) that takes a quantity in blocks to the mean readings of a lagging sensor.

    The sensor is settled at the begin.

    Parameters
    ----------
    duration_s : (n,) ndarray
        Durations of the blocks [s].
    lag_s : float
        Time constant of the sensor [s].

    Returns
    -------
    (n, n) ndarray
        Lower triangular; its rows sum to 1.

    Examples
    --------
    >>> lag_response(np.array([5.0, 5.0]), 5.0).round(3).tolist()
    [[1.0, 0.0], [0.632, 0.368]]
    """
    n = len(duration_s)
    response, state = np.zeros((n, n)), np.zeros(n)
    state[0] = 1.0
    for k, duration in enumerate(duration_s):
        left = np.exp(-duration / lag_s)
        weight = 1.0 - (1.0 - left) * lag_s / duration
        response[k] = (1.0 - weight) * state
        response[k, k] += weight
        state *= left
        state[k] += 1.0 - left
    return response
