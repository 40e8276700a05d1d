"""Fit of a Gaussian-process terrain: hyperparameters, conditioned process, outliers, calibration."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from survey.core.arrays import BoolArray, Bounds, FloatArray, IntArray, Progress
from survey.core.crs.agreement import same_crs
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.base import ELEVATION
from survey.reconstruction.gp.calibration import SigmaCalibration
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engines.base import Process
from survey.reconstruction.gp.errors_in_variables import variance_through_slope
from survey.reconstruction.gp.learned import Learned
from survey.reconstruction.gp.mean import ConstantMean, DemMean, Mean
from survey.reconstruction.gp.process import EngineName, conditioned
from survey.reconstruction.gp.satellite import with_prior_error
from survey.reconstruction.gp.selection.families import likeliest
from survey.reconstruction.gp.selection.kernel_fit import Hyperparameters, stated_family
from survey.reconstruction.observations import Observations
from survey.reconstruction.outliers import Outliers, distrusted

_N_LEAST = 3
# Places on the site from which the widths of its gaps are taken.
_N_GAPS = 41


@dataclass(frozen=True)
class TerrainFit:
    """Assumptions of a fit: settings, expected surface, engine, quantity, site, and a progress callback."""

    config: GaussianProcessConfig
    prior: Dem | Mean | None
    engine: EngineName
    quantity: str
    bounds: Bounds | None
    progress: Progress | None

    def near(self, points: SurfacePoints) -> BoolArray:
        """Return which points (N,) can matter to the site, and refuse fewer than three."""
        if self.bounds is None:
            near = np.ones(len(points), dtype=bool)
        else:
            xmin, ymin, xmax, ymax = self.bounds
            reach = float(np.hypot(xmax - xmin, ymax - ymin))
            x, y = points.xy.T
            near = (x >= xmin - reach) & (x <= xmax + reach) & (y >= ymin - reach) & (y <= ymax + reach)
        if near.sum() < _N_LEAST:
            raise InputError(
                f"{int(near.sum())} of {len(points)} points lie on or near the site; a map needs at least {_N_LEAST}, "
                "check that points and grid are in the same place and CRS."
            )
        return near

    def learned(
        self, points: SurfacePoints, numbers: IntArray, announce: Callable[[Learned, float], None]
    ) -> Learned:
        """Return the state of a model of points, each with its number among those that were given.

        The first process, and the time that all of them will take [s], go to `announce`.
        """
        data = Observations.of(points, self.quantity)
        mean = self._mean(points)
        began = time.perf_counter()
        process, found = self._learn(data, mean, data.variance)
        n_times = 1 + self._has_slope_errors(points) + self.config.robust
        announce(Learned.uncalibrated(process, mean, found), n_times * (time.perf_counter() - began))
        variance = self.through_slope(points, process, mean, data.variance)
        if variance is not data.variance:
            process, found = self._learn(data, mean, variance)
        z_scores = _z_scores(process)
        treatment = "retained"
        if self.config.robust:
            variance, treatment = distrusted(variance, z_scores), "retained with less weight"
            process, found = self._learn(data, mean, variance)
        outliers = Outliers.among(z_scores, numbers, treatment)
        return Learned(process, mean, found, self._calibration(data, mean, variance, found), outliers)

    def _mean(self, points: SurfacePoints) -> Mean:
        if isinstance(self.prior, Dem):
            same_crs(self.prior.crs, points.crs, "the prior and the points")
            same_vertical_datum(self.prior.vertical_datum, points.vertical_datum, "the prior and the points")
            return DemMean(self.prior, self.config.prior_interpolation)
        return self.prior or ConstantMean(0.0)

    def _learn(self, data: Observations, mean: Mean, variance: FloatArray) -> tuple[Process, Hyperparameters]:
        """Return the conditioned process and its hyperparameters."""
        residual = data.z - mean.at(data.xy)
        found = self._hyperparameters(data, residual, variance)
        return self._conditioned(data.xy, residual, variance, found), found

    def _hyperparameters(
        self, data: Observations, residual: FloatArray, variance: FloatArray
    ) -> Hyperparameters:
        if self.config.fit:
            found = likeliest(data.xy, self._detrended(data.xy, residual), variance, self.config)
        else:
            family = stated_family(self.config)
            found = Hyperparameters(family, self.config.stated_kernel(), self.config.nugget_m or 0.0, 0.0)
        if isinstance(self.prior, Dem) and self.config.prior_sigma_m:
            return with_prior_error(found, self.prior.step_m, self.config.prior_sigma_m)
        return found

    def _detrended(self, xy: FloatArray, residual: FloatArray) -> FloatArray:
        """Subtract a plane where one is part of the mean, so that it is not taken for a length scale."""
        if self.prior is not None or self.config.mean == "constant":
            return residual
        columns = np.column_stack([np.ones(len(xy)), xy - xy.mean(axis=0)])
        detrended: FloatArray = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
        return detrended

    def _conditioned(
        self,
        xy: FloatArray,
        residual: FloatArray,
        variance: FloatArray,
        found: Hyperparameters,
        bounds: Bounds | None = None,
    ) -> Process:
        if (
            self.prior is None
            and self.config.mean == "plane"
            and Observations(xy, residual, variance).on_one_line()
        ):
            raise InputError("the points lie on one line and determine no plane; take mean = constant.")
        return conditioned(
            self.engine,
            found.kernel,
            xy,
            residual,
            np.sqrt(variance + found.nugget_m**2),
            bounds=bounds or self.bounds,
            trend=self.config.trend(has_prior=self.prior is not None),
            config=self.config,
            progress=self.progress,
        )

    def _has_slope_errors(self, points: SurfacePoints) -> bool:
        """Return whether points carry x-y uncertainty to the height."""
        wanted = self.config.horizontal_errors == "slope" and self.quantity == ELEVATION
        return wanted and points.covariance is not None

    def through_slope(
        self, points: SurfacePoints, process: Process, mean: Mean, variance: FloatArray
    ) -> FloatArray:
        """Return the variance of heights (N,) [m²], that of east and north through the slope included where it is wanted."""
        if points.covariance is None or not self._has_slope_errors(points):
            return variance
        slope = process.gradient(points.xy) + mean.gradient(points.xy)
        return variance_through_slope(points.covariance, slope)

    def _calibration(
        self, data: Observations, mean: Mean, variance: FloatArray, found: Hyperparameters
    ) -> SigmaCalibration:
        wanted = self.config.fit if self.config.calibrate is None else self.config.calibrate
        if not wanted:
            return SigmaCalibration.none()
        residual = data.z - mean.at(data.xy)
        # Points beyond the grid are held out too.
        west_south, east_north = data.xy.min(axis=0), data.xy.max(axis=0)
        if self.bounds is not None:
            west_south = np.minimum(west_south, self.bounds[:2])
            east_north = np.maximum(east_north, self.bounds[2:])
        (xmin, ymin), (xmax, ymax) = west_south.tolist(), east_north.tolist()

        def predict(kept: BoolArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
            process = self._conditioned(
                data.xy[kept], residual[kept], variance[kept], found, bounds=(xmin, ymin, xmax, ymax)
            )
            height, spread = process.predict(xy)
            return height, process.surface_variance(spread, xy) + found.nugget_m**2

        return SigmaCalibration.cross_validated(data.xy, residual, variance, predict, self._gaps_m(data.xy))

    def _gaps_m(self, xy: FloatArray) -> FloatArray:
        """Return the distances from places all over the site to the nearest point [m]."""
        from scipy.spatial import cKDTree

        low, high = (self.bounds[:2], self.bounds[2:]) if self.bounds else (xy.min(axis=0), xy.max(axis=0))
        axes = [np.linspace(a, b, _N_GAPS) for a, b in zip(low, high, strict=True)]
        nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        return np.asarray(cKDTree(xy).query(nodes)[0])


def _z_scores(process: Process) -> FloatArray:
    mean, variance = process.leave_one_out()
    scores: FloatArray = (process.data.values - mean) / np.sqrt(variance)
    return scores
