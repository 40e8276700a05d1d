r"""Map of a quantity that a science payload measured on the way: Gaussian process with elevation as covariate.

Readings are averaged over blocks of the way. A sensor of time constant τ follows its surroundings x by
``ds/dt = (x - s) / τ``. Over a block of duration Δ in which x is constant its mean reading and its state at the end are

.. math::  \bar y = w x + (1 - w) s_0, \quad s_1 = (1 - e) x + e s_0, \quad
           e = e^{-\Delta / \tau}, \quad w = 1 - (1 - e) \tau / \Delta

With averages y of readings, the response H of the sensor to the trend (1, elevation), their correlation R for a length
scale, and their numbers of readings m,

.. math::  y = H \beta + \epsilon, \qquad \operatorname{cov} \epsilon = v \, (R + g \operatorname{diag} m^{-1})

Variance v and β follow in closed form; the posterior of the length scale and of the ratio g of the noise of a reading
to v follows from the restricted likelihood (Patterson and Thompson 1971). The noise is fitted too, since data sheets
state that of the laboratory. `map_payload` predicts the quantity on a terrain map, as a mixture over this posterior.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from survey.core import FloatArray, InputError, same_crs
from survey.data import Dem, Grid, Trajectory
from survey.data.sensors.payload import PayloadLog
from survey.io.raster.netcdf import deviation_attributes, write_netcdf
from survey.reconstruction.gp.kernels import Matern32, Matern52, SquaredExponential, Stationary
from survey.reconstruction.terrain_map import Reconstruction, support_codes


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

    `duration_s` (n,): durations of the blocks [s]. `lag_s`: time constant of the sensor [s]. Returns (n, n):
    lower triangular; its rows sum to 1.

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


FAMILIES: tuple[type[Stationary], ...] = (Matern32, Matern52, SquaredExponential)
"""Covariance functions that a fit chooses from."""
# Added to the diagonal, as a share of the variance: readings of one place leave the covariance singular.
_JITTER = 1e-9
_AT_ONCE = 4096
_FIRST_SHARES = (0.05, 0.2)
_LONGEST = 5.0
_LEAST_WEIGHT = 0.01
# Step of the second differences at the maximum of the likelihood.
_DIFFERENCE = 0.1
# Readings within less than this are taken as of one place [m].
_LEAST_EXTENT_M = 1.0


class PayloadHyperparameters(NamedTuple):
    """Covariance function of a quantity, and standard deviation of the noise of a reading, in its unit.

    `kernel`: its variance is in the unit squared. `noise_sd`: standard deviation of the noise of one reading.
    """

    kernel: Stationary
    noise_sd: float


class PayloadProcess:
    """Posterior of a quantity given averages of readings.

    `readings`: averages, places and response of the sensor. `elevation_m` (n,): elevation at the places [m].
    `hyperparameters`: as `fit_hyperparameters` finds them, or as they are known.
    """

    def __init__(
        self, readings: AveragedReadings, elevation_m: FloatArray, hyperparameters: PayloadHyperparameters
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


def fit_hyperparameters(
    readings: AveragedReadings,
    elevation_m: FloatArray,
    noise_sd: float,
    families: Sequence[type[Stationary]] = FAMILIES,
) -> list[tuple[float, PayloadHyperparameters]]:
    """Return hyperparameters of a quantity with their posterior weights, the heaviest first.

    For each family the posterior of the logarithms of length scale and noise ratio is taken as normal about the
    maximum of the restricted likelihood, and represented by five points with equal mean and covariance; families
    are weighted by Laplace's approximation of their evidence.

    `elevation_m` (n,): elevation at their places [m].
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


MOST_NODES = 20_000
"""Nodes of a payload's map; the grid is coarser than that of the terrain where needed."""
_N_FITTED, _N_MAPPED = 400, 1000


def map_payload(
    logs: Sequence[PayloadLog],
    trajectories: Sequence[Trajectory | None],
    terrain: Dem,
    grid: Grid,
    *,
    terrain_std: Dem | None = None,
    hyperparameters: PayloadHyperparameters | None = None,
) -> Reconstruction:
    """Map a quantity from the readings of one or several drives.

    The quantity is a linear function of elevation and a Gaussian process of a length scale of its own. Covariance
    function, length scale, variance and noise are fitted to the readings by restricted likelihood; a sensor's lag
    is part of the model of its readings.

    `terrain_std`: standard deviation of that elevation [m]. Returns: mean and standard deviation in the unit
    of the quantity; NaN where the terrain has no height.

    The field is taken as constant during the drive, the offset of a sensor as known, and places as exact: their
    errors must be small beside the length scale. Averages over blocks of the way (at most 1,000 in all) replace
    single readings, so that structure finer than a block is noise.
    """
    same_crs(terrain.crs, grid.crs, "the terrain and the grid")
    names = {(log.quantity.name, log.quantity.unit) for log in logs}
    if len(names) != 1:
        raise InputError(f"the logs hold {len(names)} quantities; map one at a time.")
    placed = [_on_terrain(log.placed(path), terrain) for log, path in zip(logs, trajectories, strict=True)]
    few = AveragedReadings.of(placed, _N_FITTED)
    weighted = (
        fit_hyperparameters(few, terrain.at(few.xy), placed[0].quantity.noise_sd)
        if hyperparameters is None
        else [(1.0, hyperparameters)]
    )
    readings = AveragedReadings.of(placed, _N_MAPPED)
    processes = [(w, PayloadProcess(readings, terrain.at(readings.xy), found)) for w, found in weighted]
    elevation = terrain.at(grid.xy)
    sigma_m = np.zeros(len(elevation)) if terrain_std is None else np.nan_to_num(terrain_std.at(grid.xy))
    mean, std = mixture_of_parts(
        [w for w, _ in processes], [process.at(grid.xy, elevation, sigma_m) for _, process in processes]
    )
    datum, n_readings = terrain.vertical_datum, sum(len(log) for log in placed)
    return Reconstruction(
        Dem.on(grid, mean.reshape(grid.shape), datum),
        Dem.on(grid, std.reshape(grid.shape), datum),
        _support(processes[0][1], std, grid),
        "gp",
        _facts(processes[0][1]) | {"n_hyperparameters": len(processes)},
        quantity=f"{placed[0].quantity.name}_{placed[0].quantity.unit}",
        diagnostics={"n_readings": n_readings},
    )


def mixture_of_parts(
    weights: Sequence[float], parts: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of a mixture of distributions with means and standard deviations.

    >>> one = np.ones(1)
    >>> mean, std = mixture_of_parts([0.5, 0.5], [(0.0 * one, one), (2.0 * one, one)])
    >>> float(mean[0]), round(float(std[0]), 3)
    (1.0, 1.414)
    """
    means, stds = (np.stack(column) for column in zip(*parts, strict=True))
    mean = np.tensordot(weights, means, 1)
    variance = np.tensordot(weights, stds**2 + (means - mean) ** 2, 1)
    return mean, np.sqrt(variance)


def payload_grid(grid: Grid) -> Grid:
    """Return a grid over the same ground with at most `MOST_NODES` nodes."""
    factor = int(np.ceil(np.sqrt(np.prod(grid.shape) / MOST_NODES)))
    return grid if factor <= 1 else Grid.over(grid.bounds, factor * grid.step_m, grid.crs)


def write_payload(mapped: Reconstruction, log: PayloadLog, folder: Path) -> None:
    """Write a map as GeoTIFF with its facts, and as NetCDF with the unit and the standard name of the quantity."""
    mapped.write(folder)
    quantity, mean = log.quantity, mapped.mean
    named = {} if quantity.standard_name is None else {"standard_name": quantity.standard_name}
    about = {"long_name": quantity.name.replace("_", " "), "units": quantity.unit, **named}
    variables = {
        quantity.name: (mean.elevation, {**about, "ancillary_variables": "standard_deviation"}),
        "standard_deviation": (mapped.std.elevation, deviation_attributes(about)),
    }
    write_netcdf(folder / f"{quantity.name}.nc", variables, mean.transform, mean.crs, mean.vertical_datum)


def _on_terrain(log: PayloadLog, terrain: Dem) -> PayloadLog:
    """Return the readings at places with a height."""
    assert log.xy is not None
    known = np.isfinite(terrain.at(log.xy))
    if known.all():
        return log
    if known.sum() < 10:
        raise InputError(
            f"{int(known.sum())} of {len(log)} readings of {log.quantity.name} lie on the terrain; give a terrain of the "
            "same place and CRS."
        )
    times = None if log.time_s is None else log.time_s[known]
    return PayloadLog(log.quantity, log.value[known], times, log.xy[known])


def _support(process: PayloadProcess, std: FloatArray, grid: Grid) -> Any:
    """Return the support codes of the nodes."""
    kernel = process.hyperparameters.kernel
    nearest = np.asarray(cKDTree(process.readings.xy).query(grid.xy)[0]).reshape(grid.shape)
    return support_codes(
        nearest,
        (std**2 / kernel.variance_m2).reshape(grid.shape),
        shortest_length_m=kernel.length_scales_m[0],
        step_m=grid.step_m,
    )


def _facts(process: PayloadProcess) -> dict[str, Any]:
    """Return the likeliest hyperparameters and the dependence on elevation with them."""
    kernel, noise_sd = process.hyperparameters
    return {
        "family": kernel.family,
        "length_scale_m": kernel.length_scales_m[0],
        "standard_deviation": float(np.sqrt(kernel.variance_m2)),
        "noise_sd": noise_sd,
        "per_km_of_elevation": 1e3 * float(process.trend[1]),
        "per_km_of_elevation_sigma": 1e3 * float(np.sqrt(process.trend_covariance[1, 1])),
    }
