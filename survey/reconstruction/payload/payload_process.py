r"""Gaussian process of a payload's quantity about a linear dependence on elevation, fitted by restricted likelihood.

With averages y of readings, what they show H of the trend (1, elevation), their correlation R for a length scale, and
their numbers of readings m,

.. math::  y = H \beta + \epsilon, \qquad \operatorname{cov} \epsilon = v \, (R + g \operatorname{diag} m^{-1})

Variance v and β follow in closed form; the posterior of the length scale and of the ratio g of the noise of a reading
to v follows from the restricted likelihood (Patterson and Thompson 1971). The noise is fitted too, since data sheets
state that of the laboratory.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.reconstruction.gp.covariance.kernels import Matern32, Matern52, SquaredExponential
from survey.reconstruction.gp.covariance.stationary import Stationary
from survey.reconstruction.payload.averaged_readings import AveragedReadings

FAMILIES: tuple[type[Stationary], ...] = (Matern32, Matern52, SquaredExponential)
"""Covariance functions that a fit chooses from."""
_JITTER = 1e-9
_AT_ONCE = 4096
_FIRST_SHARES = (0.05, 0.2)
_LONGEST = 5.0
_LEAST_WEIGHT = 0.01
_DIFFERENCE = 0.1
# Readings within less than this are taken as of one place [m].
_LEAST_EXTENT_M = 1.0


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
) -> list[tuple[float, PayloadHyperparameters]]:
    """Return hyperparameters of a quantity with their posterior weights, the heaviest first.

    For each family the posterior of the logarithms of length scale and noise ratio is taken as normal about the
    maximum of the restricted likelihood, and represented by five points with equal mean and covariance; families
    are weighted by Laplace's approximation of their evidence.

    Parameters
    ----------
    readings : AveragedReadings
        Some hundred averages.
    elevation_m : (n,) ndarray
        Elevation at their places [m].
    noise_sd : float
        Stated standard deviation of a reading's noise, where the search begins.
    families : sequence of type
        Covariance functions that are considered.

    Returns
    -------
    list of (float, PayloadHyperparameters)
        Weights sum to 1; families below a hundredth are left out.
    """
    columns = readings.seen(np.column_stack([np.ones(len(elevation_m)), elevation_m - elevation_m.mean()]))
    spread = float(np.var(readings.value - columns @ np.linalg.lstsq(columns, readings.value, rcond=None)[0]))
    ratio = max(noise_sd**2 / max(spread, 1e-12), 1e-6)
    peaks = [_peak(readings, columns, family, ratio) for family in families]
    evidence = np.array([peak.log_evidence for peak in peaks])
    weights = np.exp(evidence - evidence.max())
    weights = np.where(weights < _LEAST_WEIGHT * weights.sum(), 0.0, weights)
    weights /= weights.sum()
    points = [
        (float(weight * share), _with_variance(readings, columns, peak.family, point))
        for weight, peak in zip(weights, peaks, strict=True)
        if weight > 0.0
        for share, point in peak.points()
    ]
    return sorted(points, key=lambda point: -point[0])


class _Peak(NamedTuple):
    """Maximum of the restricted likelihood of a family: logarithms of length scale and ratio, and their covariance."""

    family: type[Stationary]
    log_parameters: FloatArray
    covariance: FloatArray
    log_evidence: float

    def points(self) -> list[tuple[float, FloatArray]]:
        """Return five points with weights that have the mean and the covariance of the posterior."""
        root = np.linalg.cholesky(self.covariance) * np.sqrt(3.0)
        around = [self.log_parameters + sign * column for column in root.T for sign in (1.0, -1.0)]
        return [(1.0 / 3.0, self.log_parameters), *((1.0 / 6.0, point) for point in around)]


def _extent_m(readings: AveragedReadings) -> float:
    """Return the diagonal of the box about the readings [m]; refuse readings in one place."""
    extent_m = float(np.hypot(*np.ptp(readings.xy, axis=0)))
    if extent_m < _LEAST_EXTENT_M:
        raise InputError(
            f"the readings lie within {extent_m:.2g} m; a map needs readings along a way, log them on a drive."
        )
    return extent_m


def _peak(readings: AveragedReadings, columns: FloatArray, family: type[Stationary], ratio: float) -> _Peak:
    """Maximise the restricted likelihood of a family from two length scales."""
    extent_m = _extent_m(readings)
    spacing_m = float(np.median(np.hypot(*np.diff(readings.xy, axis=0).T)))
    bounds = [(np.log(max(spacing_m, 1e-3)), np.log(_LONGEST * extent_m)), (np.log(1e-8), np.log(1e4))]
    searches = [
        minimize(
            _minus_log_likelihood,
            [np.log(share * extent_m), np.log(ratio)],
            args=(readings, columns, family),
            method="L-BFGS-B",
            bounds=bounds,
            options={"eps": 1e-4, "maxiter": 40},
        )
        for share in _FIRST_SHARES
    ]
    best = min(searches, key=lambda search: float(search.fun))
    covariance = _covariance(lambda x: _minus_log_likelihood(x, readings, columns, family), best.x)
    log_evidence = -float(best.fun) + 0.5 * float(np.linalg.slogdet(covariance)[1])
    return _Peak(family, best.x, covariance, log_evidence)


def _covariance(function: Callable[[FloatArray], float], peak: FloatArray) -> FloatArray:
    """Return the inverse of the Hessian (2, 2) of a function at its minimum, no standard deviation above 1."""
    a, b = _DIFFERENCE * np.eye(2)
    middle = function(peak)
    second = [(function(peak + h) - 2.0 * middle + function(peak - h)) / _DIFFERENCE**2 for h in (a, b)]
    mixed = (
        function(peak + a + b) - function(peak + a - b) - function(peak - a + b) + function(peak - a - b)
    ) / (4.0 * _DIFFERENCE**2)
    values, vectors = np.linalg.eigh([[second[0], mixed], [mixed, second[1]]])
    covariance: FloatArray = (vectors / np.maximum(values, 1.0)) @ vectors.T
    return covariance


def _with_variance(
    readings: AveragedReadings, columns: FloatArray, family: type[Stationary], log_parameters: FloatArray
) -> PayloadHyperparameters:
    length_m, ratio = (float(value) for value in np.exp(log_parameters))
    _, variance = _profiled(readings, columns, family, length_m, ratio)
    return PayloadHyperparameters(family(variance, length_m), float(np.sqrt(ratio * variance)))


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
