r"""Gaussian process of a payload's quantity about a linear dependence on elevation, fitted by restricted likelihood.

With averages y of readings, what they show H of the trend (1, elevation), their correlation R for a length scale, and
their numbers of readings m,

.. math::  y = H \beta + \epsilon, \qquad \operatorname{cov} \epsilon = v \, (R + g \operatorname{diag} m^{-1})

Variance v and β follow in closed form; the length scale and the ratio g of the noise of a reading to v maximise the
restricted likelihood (Patterson and Thompson 1971). The noise is fitted too, since data sheets state that of the
laboratory.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.kernels import Matern32, Matern52, SquaredExponential
from survey.reconstruction.gp.covariance.stationary import Stationary
from survey.reconstruction.payload.averaged_readings import AveragedReadings

FAMILIES: tuple[type[Stationary], ...] = (Matern32, Matern52, SquaredExponential)
"""Covariance functions that a fit chooses from."""
_JITTER = 1e-9
_AT_ONCE = 4096
_FIRST_SHARES = (0.05, 0.2)


class PayloadHyperparameters(NamedTuple):
    """Covariance function of a quantity, and standard deviation of the noise of a reading, in its unit.

    Parameters
    ----------
    kernel : Stationary
        Its variance is in the unit squared.
    noise_sd : float
        Standard deviation of the noise of one reading.
    """

    kernel: Stationary
    noise_sd: float


class PayloadProcess:
    """Posterior of a quantity given averages of readings.

    Parameters
    ----------
    readings : AveragedReadings
        Averages, places and response of the sensor.
    elevation_m : (n,) ndarray
        Elevation at the places [m].
    hyperparameters : PayloadHyperparameters
        As `fitted` finds them, or as they are known.
    """

    def __init__(
        self,
        readings: AveragedReadings,
        elevation_m: FloatArray,
        hyperparameters: PayloadHyperparameters,
    ) -> None:
        self.readings, self.hyperparameters = readings, hyperparameters
        self._datum_m = float(elevation_m.mean())
        kernel, noise_sd = hyperparameters
        covariance = readings.covariance(kernel.covariance(readings.xy, readings.xy))
        covariance[np.diag_indices_from(covariance)] += (
            noise_sd**2 / readings.n_readings + _JITTER * kernel.variance_m2
        )
        self._factor = cho_factor(covariance, lower=True)
        columns = readings.seen(self._trend(elevation_m))
        self._solved = cho_solve(self._factor, columns)
        self.trend_covariance = np.linalg.inv(columns.T @ self._solved).astype(np.float64)
        self.trend: FloatArray = self.trend_covariance @ (self._solved.T @ readings.value)
        self._weights = cho_solve(self._factor, readings.value - columns @ self.trend)

    def at(
        self, xy: FloatArray, elevation_m: FloatArray, elevation_sd_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (M,) of the quantity at places (M, 2), noise of readings left out."""
        parts = [slice(k, k + _AT_ONCE) for k in range(0, len(xy), _AT_ONCE)]
        found = [self._at(xy[part], elevation_m[part], elevation_sd_m[part]) for part in parts]
        mean, variance = (np.concatenate(column) for column in zip(*found, strict=True))
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def _at(
        self, xy: FloatArray, elevation_m: FloatArray, elevation_sd_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        kernel = self.hyperparameters.kernel
        cross = self.readings.seen(kernel.covariance(self.readings.xy, xy))
        trend = self._trend(elevation_m)
        half = solve_triangular(self._factor[0], cross, lower=True)
        rest = trend - cross.T @ self._solved
        mean = trend @ self.trend + cross.T @ self._weights
        variance = kernel.variance_m2 - np.sum(half**2, axis=0)
        variance += np.einsum("mi,ij,mj->m", rest, self.trend_covariance, rest)
        return mean, variance + (self.trend[1] * elevation_sd_m) ** 2

    def _trend(self, elevation_m: FloatArray) -> FloatArray:
        return np.column_stack([np.ones(len(elevation_m)), elevation_m - self._datum_m])


def fitted(
    readings: AveragedReadings,
    elevation_m: FloatArray,
    noise_sd: float,
    families: Sequence[type[Stationary]] = FAMILIES,
) -> PayloadHyperparameters:
    """Fit covariance function and noise of a quantity by restricted likelihood.

    Parameters
    ----------
    readings : AveragedReadings
        Some hundred averages.
    elevation_m : (n,) ndarray
        Elevation at their places [m].
    noise_sd : float
        Stated standard deviation of a reading's noise, where the search begins.
    families : sequence of type
        Covariance functions to choose from.

    Returns
    -------
    PayloadHyperparameters
        The likeliest.
    """
    columns = readings.seen(np.column_stack([np.ones(len(elevation_m)), elevation_m - elevation_m.mean()]))
    extent_m = float(np.hypot(*np.ptp(readings.xy, axis=0)))
    spacing_m = float(np.median(np.hypot(*np.diff(readings.xy, axis=0).T)))
    spread = float(np.var(readings.value - columns @ np.linalg.lstsq(columns, readings.value, rcond=None)[0]))
    ratio = max(noise_sd**2 / max(spread, 1e-12), 1e-6)
    bounds = [(np.log(max(spacing_m, 1e-3)), np.log(5.0 * extent_m)), (np.log(1e-8), np.log(1e4))]
    found = []
    for family in families:
        for share in _FIRST_SHARES:
            search = minimize(
                _minus_log_likelihood,
                [np.log(share * extent_m), np.log(ratio)],
                args=(readings, columns, family),
                method="L-BFGS-B",
                bounds=bounds,
                options={"eps": 1e-4, "maxiter": 40},
            )
            found.append((float(search.fun), family, search.x))
    _, family, log_parameters = min(found, key=lambda one: one[0])
    length_m, ratio = np.exp(log_parameters)
    _, variance = _profiled(readings, columns, family, float(length_m), float(ratio))
    return PayloadHyperparameters(family(variance, float(length_m)), float(np.sqrt(ratio * variance)))


def _minus_log_likelihood(
    log_parameters: FloatArray, readings: AveragedReadings, columns: FloatArray, family: type[Stationary]
) -> float:
    length_m, ratio = np.exp(log_parameters)
    return _profiled(readings, columns, family, float(length_m), float(ratio))[0]


def _profiled(
    readings: AveragedReadings, columns: FloatArray, family: type[Stationary], length_m: float, ratio: float
) -> tuple[float, float]:
    """Return minus the restricted log likelihood, and the variance that maximises it."""
    correlation = family(1.0, length_m).covariance(readings.xy, readings.xy)
    covariance = readings.covariance(correlation)
    covariance[np.diag_indices_from(covariance)] += ratio / readings.n_readings + _JITTER
    lower = np.linalg.cholesky(covariance)
    white = solve_triangular(lower, np.column_stack([columns, readings.value]), lower=True)
    basis, upper = np.linalg.qr(white[:, :-1])
    rest = white[:, -1] - basis @ (basis.T @ white[:, -1])
    n_free = len(rest) - columns.shape[1]
    variance = float(rest @ rest) / n_free
    log_det = 2.0 * np.log(np.diag(lower)).sum() + 2.0 * np.log(np.abs(np.diag(upper))).sum()
    return 0.5 * (n_free * np.log(variance) + log_det), variance
