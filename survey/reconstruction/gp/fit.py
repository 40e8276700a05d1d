"""Fit of a Gaussian-process terrain, and its predictions: height, calibrated standard deviation, support and slope.

`TerrainFit` finds the hyperparameters, conditions the process on the residuals to the mean, propagates horizontal errors
through the slope, gives outliers less weight, and calibrates the standard deviation. `SigmaCalibration` is a
factor by the distance to the nearest point, from blocked cross-validation. `Learned` is the fitted state that predicts.
The steepness of a map has the standard deviation of the derivative along the steepest direction.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.special import chdtrc

from survey.core import (
    BoolArray,
    Bounds,
    FloatArray,
    InputError,
    IntArray,
    Progress,
    same_crs,
    same_vertical_datum,
    stream,
)
from survey.data import Dem, Grid, SurfacePoints
from survey.reconstruction.checks import PredictiveCheck, PredictiveScores
from survey.reconstruction.gp.averaged_process import AveragedProcess
from survey.reconstruction.gp.conditioning import ConditioningTask, PriorMeasurements, condition_all
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engine_choice import (
    Conditioned,
    Division,
    EngineChoice,
    EngineName,
    is_little_work,
)
from survey.reconstruction.gp.engines.regression import Process
from survey.reconstruction.gp.engines.spline_grid import first_stride, predict_on_fine_axes
from survey.reconstruction.gp.kernel_average import averaged_kernels
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters, likeliest, stated_family
from survey.reconstruction.gp.mean import ConstantMean, DemMean, Mean, with_prior_error
from survey.reconstruction.observations import (
    Observations,
    Outliers,
    Predict,
    distrusted,
    variance_through_slope,
)
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.terrain_map import CHECK, ELEVATION, UNSEEN, support_codes

# Shares of the points that are left out: in all discs, at most in one of the widest, and one by one.
_SHARE_IN_DISCS, _SHARE_IN_ONE, _SHARE_SINGLE = 0.12, 0.05, 0.04
# Most points in discs, and one by one: bounds the time on large sites.
_MOST_IN_DISCS, _MOST_SINGLE = 9000, 3000
# Without enough points to say otherwise the scale is 1, give or take 30 %.
_PRIOR_LOG_SD = 0.3
# Ranges of distance with a factor each; with fewer points left out, or kept, there is none.
_N_BINS = 3
_LEAST_HELD_OUT = 30
_N_TRIED = 6000


@dataclass(frozen=True)
class SigmaCalibration:
    """Factor on the standard deviation, by the distance to the nearest point.

    `distance_m` (K,): distances to the nearest point, ascending [m]. `scale` (K,): factor at each; constant
    beyond the ends, linear between. `held_out`: results for the points that were left out: their number, and
    their share within the 95 % interval before and after.
    """

    distance_m: FloatArray
    scale: FloatArray
    held_out: dict[str, Any]

    @classmethod
    def none(cls) -> Self:
        """Return the scale 1."""
        return cls(np.zeros(1), np.ones(1), {})

    def facts(self) -> dict[str, Any]:
        """Return the scale and what it rests on, for the record."""
        held_out = {name: value for name, value in self.held_out.items() if name != CHECK}
        return {"distance_m": self.distance_m, "scale": self.scale, **held_out}

    def at(self, distance_m: FloatArray) -> FloatArray:
        """Return the factor at distances (M,) [m]."""
        return np.interp(distance_m, self.distance_m, self.scale)

    @classmethod
    def cross_validated(
        cls, xy: FloatArray, values: FloatArray, noise_m2: FloatArray, predict: Predict, gaps_m: FloatArray
    ) -> Self:
        r"""Leave out discs of points and single points, predict them, and compare.

        Points of one swath determine one another, so leaving out one at a time shows nothing
        about the ground between swaths: discs as wide as the gaps of the survey do. Within
        each range of distance to the nearest remaining point the scale s maximises

        .. math::  \sum_i w \log N(e_i; 0, s^2 v_i + \sigma_i^2) - \frac{(\log s)^2}{2 \cdot 0.3^2}

        with the prediction error e, its variance v and the point's own variance σ². The
        weight w counts errors that lie closer together than they are far from data as one.

        `xy`, `values`, `noise_m2` (N, 2), (N,) and (N,): the points, and the variances of their errors.
        `gaps_m` (M,): distances from places on the map to the nearest point [m].

        The scale never falls below 1: points stand where the rover could see, so that they
        can prove a map too bold and not too cautious. The hyperparameters were fitted to
        all points, and the test is not blind to them. Ground unlike any that was measured
        cannot be foreseen.
        """
        out = left_out(xy, gaps_m)
        kept = ~out.points
        if (~kept).sum() < _LEAST_HELD_OUT or kept.sum() < _LEAST_HELD_OUT:
            return cls.none()
        mean, variance = predict(kept, xy[~kept])
        distance = np.asarray(cKDTree(xy[kept]).query(xy[~kept])[0])
        held_out = _HeldOut(xy[~kept], values[~kept] - mean, variance, noise_m2[~kept], distance)
        bins = held_out.bins()
        found = cls(np.array([b.distance_m for b in bins]), np.array([b.scale for b in bins]), {})
        before, after = (held_out.scores(factor) for factor in (np.ones(len(distance)), found.at(distance)))
        columns = list(zip(*bins, strict=True))
        check = PredictiveCheck("discs and single points", out.n_discs, before, after, *columns)
        facts = {
            "n_held_out": before.n,
            "coverage_95_before": before.coverage_95,
            "coverage_95_after": after.coverage_95,
            CHECK: check.facts(),
        }
        return cls(found.distance_m, found.scale, facts)


class _Bin(NamedTuple):
    """Median distance [m] of a range, independent errors in it, chance of errors as large, and scale found."""

    distance_m: float
    n_effective: float
    p_value: float
    scale: float


class _HeldOut(NamedTuple):
    """Places (M, 2), errors (M,), variances of prediction and point (M,), and distances to the nearest point (M,)."""

    xy: FloatArray
    error: FloatArray
    variance: FloatArray
    noise: FloatArray
    distance_m: FloatArray

    def scores(self, factor: FloatArray) -> PredictiveScores:
        """Return the scores with the predicted deviation times a factor (M,)."""
        return PredictiveScores.of(self.error, np.sqrt(factor**2 * self.variance + self.noise))

    def bins(self) -> list[_Bin]:
        """Return what each third of the distances says."""
        edges = np.quantile(self.distance_m, np.linspace(0.0, 1.0, _N_BINS + 1))
        index = np.clip(np.searchsorted(edges, self.distance_m, side="right") - 1, 0, _N_BINS - 1)
        return [self._bin(index == k) for k in range(_N_BINS) if (index == k).any()]

    def _bin(self, here: BoolArray) -> _Bin:
        middle = float(np.median(self.distance_m[here]))
        error, variance, noise = self.error[here], self.variance[here], self.noise[here]
        n = _n_independent(self.xy[here], middle)
        scale = max(1.0, _scale(error, variance, noise, n / here.sum()))
        p_value = float(chdtrc(n, n * float(np.mean(error**2 / (variance + noise)))))
        return _Bin(middle, float(n), p_value, scale)


class PointsLeftOut(NamedTuple):
    """Points to leave out (N,), and the number of discs among them."""

    points: BoolArray
    n_discs: int


def left_out(xy: FloatArray, gaps_m: FloatArray) -> PointsLeftOut:
    """Choose points to leave out: discs as wide as the survey's gaps, and single points; always the same ones."""
    rng = stream(0, "calibration")
    tree = cKDTree(xy)
    out = np.zeros(len(xy), dtype=bool)
    order = rng.permutation(len(xy))
    # As wide as the gaps, unless a disc would then hold much of the survey.
    fullest = tree.query(xy[order[:30]], k=[max(int(_SHARE_IN_ONE * len(xy)), 1)])[0]
    widest = min(float(np.quantile(gaps_m, 0.95)), float(np.median(fullest)))
    radii = widest * np.array([1.0, 0.6, 0.3])
    n_discs = 0
    for centre in order[:_N_TRIED]:
        if out.sum() >= min(_SHARE_IN_DISCS * len(xy), _MOST_IN_DISCS):
            break
        radius = radii[n_discs % len(radii)]
        # Discs stay a radius apart, so that each has its surroundings left.
        if not out[tree.query_ball_point(xy[centre], 2.0 * radius)].any():
            out[tree.query_ball_point(xy[centre], radius)] = True
            n_discs += 1
    free = np.flatnonzero(~out)
    out[rng.choice(free, size=min(int(_SHARE_SINGLE * len(free)), _MOST_SINGLE), replace=False)] = True
    return PointsLeftOut(out, n_discs)


def _n_independent(xy: FloatArray, correlation_m: float) -> int:
    cells = np.floor(xy / max(correlation_m, 1e-3)).astype(np.int64)
    return len(np.unique(cells, axis=0))


def _scale(error: FloatArray, variance: FloatArray, noise: FloatArray, weight: float) -> float:
    def negative(log_scale: float) -> float:
        total = np.exp(2.0 * log_scale) * variance + noise
        misfit = 0.5 * float(np.sum(np.log(total) + error**2 / total))
        return weight * misfit + 0.5 * (log_scale / _PRIOR_LOG_SD) ** 2

    return float(np.exp(minimize_scalar(negative, bounds=(-1.5, 1.5), method="bounded").x))


MOST_AT_ONCE = 4_000_000
"""Nodes that are finished at once, which bounds the memory of a large map."""


@dataclass(frozen=True)
class Learned:
    """A mean surface, the process of what differs from it, and the calibration of its standard deviation."""

    process: Process
    choice: EngineChoice
    mean: Mean
    hyperparameters: Hyperparameters
    calibration: SigmaCalibration
    outliers: Outliers
    n_beyond_reach: int = 0

    @classmethod
    def uncalibrated(cls, conditioned: Conditioned, mean: Mean, hyperparameters: Hyperparameters) -> Self:
        """Return the state before outliers are looked for and the standard deviation is calibrated."""
        none = Outliers(np.zeros(0, dtype=np.int64), np.zeros(0))
        return cls(*conditioned, mean, hyperparameters, SigmaCalibration.none(), none)

    @property
    def own_noise_m2(self) -> FloatArray:
        """Noise variances of the points (N,) [m²], without that of relief too fine to be mapped."""
        nugget_m2 = self.hyperparameters.nugget_m**2
        if isinstance(self.process, AveragedProcess):
            nugget_m2 = float(self.process.nuggets_m2[0])
        return self.process.data.noise_m2 - nugget_m2

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the most likely height (M,) [m]."""
        return self.process.predict(xy)[0] + self.mean.at(xy)

    def std(self, xy: FloatArray) -> FloatArray:
        """Return the standard deviation (M,) [m], fine relief and calibration included."""
        return self._total_std(self.process.predict(xy)[1], xy, self.nearest_m(xy))

    def nearest_m(self, xy: FloatArray) -> FloatArray:
        """Return the distance (M,) to the nearest point [m]."""
        return np.asarray(self._tree.query(xy)[0], dtype=np.float64)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.process.data.xy)

    def support(self, std: FloatArray, nearest_m: FloatArray, step_m: float = 0.0) -> npt.NDArray[np.uint8]:
        """Return the support codes of places with this standard deviation and distance to the nearest point."""
        prior = self.process.kernel.variance_m2 + self.hyperparameters.nugget_m**2
        return support_codes(
            nearest_m,
            (std / self.calibration.at(nearest_m)) ** 2 / prior,
            shortest_length_m=self.process.kernel.length_scales_m[0],
            step_m=step_m,
        )

    @property
    def solves_each_node(self) -> bool:
        """Whether every exact node costs a solve, and a spline may give the others; a stated engine stays exact."""
        return self.process.solves_each_node and not self.choice.is_stated

    def expected_s(self, grid: Grid) -> float:
        """Return the expected time to judge the points and to map the nodes of a grid [s]."""
        stride = first_stride(*grid.shape, len(self.process.data)) if self.solves_each_node else 1
        return self.process.expected_s(grid.x[::stride], grid.y[::stride])

    def on(self, grid: Grid) -> tuple[FloatArray, FloatArray, npt.NDArray[np.uint8]]:
        """Return height [m], standard deviation [m] and support code (H, W) on the nodes of a grid."""
        if self.solves_each_node:
            mean, std = predict_on_fine_axes(self.process, grid.x, grid.y, self.hyperparameters.nugget_m)
        else:
            mean, std = self.process.predict_on_axes(grid.x, grid.y)
        support = np.empty(grid.shape, dtype=np.uint8)
        rows_at_once = max(MOST_AT_ONCE // grid.shape[1], 1)
        for first in range(0, grid.shape[0], rows_at_once):
            rows = slice(first, first + rows_at_once)
            nodes = np.stack(np.meshgrid(grid.x, grid.y[rows]), axis=-1).reshape(-1, 2)
            places = _Places(nodes, mean[rows].ravel(), std[rows].ravel() ** 2)
            finished = self._finish(places, grid.step_m)
            mean[rows], std[rows], support[rows] = (values.reshape(-1, grid.shape[1]) for values in finished)
        return mean, std, support

    def _finish(
        self, places: "_Places", step_m: float
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.uint8]]:
        """Return height, standard deviation and support code (M,); NaN and unseen where the mean is not defined."""
        covered = self.mean.covers(places.xy)
        nearest = self.nearest_m(places.xy)
        std = self._total_std(places.variance, places.xy, nearest)
        support = self.support(std, nearest, step_m)
        if covered.all():
            return places.residual + self.mean.at(places.xy), std, support
        height = np.full(len(covered), np.nan)
        height[covered] = places.residual[covered] + self.mean.at(places.xy[covered])
        return height, np.where(covered, std, np.nan), np.where(covered, support, UNSEEN).astype(np.uint8)

    def slope(self, xy: FloatArray) -> FloatArray:
        """Return the slope (M, 2) of the most likely surface [m/m]."""
        return self.process.gradient(xy) + self.mean.gradient(xy)

    def updated(self, xy: FloatArray, z: FloatArray, variance: FloatArray) -> Self:
        """Return the posterior with more points, at the same hyperparameters and calibration."""
        noise = np.sqrt(variance + self.hyperparameters.nugget_m**2)
        return replace(self, process=self.process.update(xy, z - self.mean.at(xy), noise))

    def record(self) -> dict[str, Any]:
        """Return family, parameters and likelihood, for the record."""
        return {
            "family": self.hyperparameters.family,
            **self.process.kernel.parameters(),
            "nugget_m": self.hyperparameters.nugget_m,
            "log_marginal_likelihood": self.process.log_marginal_likelihood,
        }

    def diagnostics(self) -> dict[str, Any]:
        """Return what was found out about the points and the engine, for the record."""
        check = self.calibration.held_out.get(CHECK)
        return {
            **({} if check is None else {CHECK: check}),
            **self.process.facts(),
            "n_points": len(self.process.data),
            "n_points_beyond_reach": self.n_beyond_reach,
            "outliers": self.outliers.facts(),
            "calibration": self.calibration.facts(),
            "engine": {**self.process.record(), **self.choice.record()},
        }

    def _total_std(self, variance: FloatArray, xy: FloatArray, nearest_m: FloatArray) -> FloatArray:
        """Return the standard deviation of the ground: that of the process and of the nugget, calibrated."""
        total = self.process.surface_variance(variance, xy) + self.hyperparameters.nugget_m**2
        return np.sqrt(total) * self.calibration.at(nearest_m)


class _Places(NamedTuple):
    """Places (M, 2) [m], and mean (M,) [m] and variance (M,) [m²] of the process there."""

    xy: FloatArray
    residual: FloatArray
    variance: FloatArray


_DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))


def steepness_on_axes(
    process: Process, x: FloatArray, y: FloatArray, mean_slope: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return steepness and its standard deviation (H, W) [m/m], with the slope (H * W, 2) of the mean surface.

    The standard deviation is that of the derivative along the steepest direction,
    σ² = eᵀ cov(∇f) e.
    """
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    slope = process.gradient(nodes) + mean_slope
    steepness = np.hypot(*slope.T)
    e_x, e_y = slope.T / np.maximum(steepness, 1e-12)
    along_x, along_y, diagonal = (process.derivative_variance_on_axes(x, y, np.array(e)) for e in _DIRECTIONS)
    variance = e_x**2 * along_x + e_y**2 * along_y + e_x * e_y * (diagonal - along_x - along_y)
    shape = (len(y), len(x))
    return steepness.reshape(shape), np.sqrt(np.maximum(variance, 0.0)).reshape(shape)


_N_LEAST = 3
# Places on the site from which the widths of its gaps are taken.
_N_GAPS = 41


@dataclass(frozen=True)
class TerrainFit:
    """Assumptions of a fit: settings, expected surface, engine, quantity, site, and a progress callback.

    `errors`: error model of a prior whose cells are measurements; without it the prior is the mean. `n_nodes`: number of
    nodes of the map, None where it is not known. `division`: engine that is known to be needed since one solve will not do.
    """

    config: GaussianProcessConfig
    prior: Dem | Mean | None
    engine: EngineName
    quantity: str
    bounds: Bounds | None
    progress: Progress | None
    errors: PriorErrors | None = None
    n_nodes: int | None = None
    division: Division | None = None

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

    def learn(
        self, points: SurfacePoints, numbers: IntArray, announce: Callable[[Learned, float], None]
    ) -> Learned:
        """Return the state of a model of points, each with its number among those that were given.

        The first process, and the time that all of them will take [s], go to `announce`.
        """
        data = Observations.of(points, self.quantity)
        mean = self._mean(points)
        began = time.perf_counter()
        conditioned, found = self._learn(data, mean, data.variance)
        n_times = 1 + self._has_slope_errors(points) + self.config.robust
        announce(Learned.uncalibrated(conditioned, mean, found), n_times * (time.perf_counter() - began))
        again = replace(self, division=conditioned.choice.division)
        # The slope that carries horizontal errors to the height is known only once there is a surface.
        variance = self.through_slope(points, conditioned.process, mean, data.variance)
        if variance is not data.variance:
            conditioned, found = again._learn(data, mean, variance)
        z_scores = _z_scores(conditioned.process)
        treatment = "retained"
        if self.config.robust:
            variance, treatment = distrusted(variance, z_scores), "retained with less weight"
            conditioned, found = again._learn(data, mean, variance)
        outliers = Outliers.among(z_scores, numbers, treatment)
        return Learned(*conditioned, mean, found, again._calibration(data, mean, variance, found), outliers)

    def _mean(self, points: SurfacePoints) -> Mean:
        if isinstance(self.prior, Dem):
            same_crs(self.prior.crs, points.crs, "the prior and the points")
            same_vertical_datum(self.prior.vertical_datum, points.vertical_datum, "the prior and the points")
            if self.errors is None:
                return DemMean(self.prior, self.config.prior_interpolation)
            return ConstantMean(0.0)
        return self.prior or ConstantMean(0.0)

    def _learn(
        self, data: Observations, mean: Mean, variance: FloatArray
    ) -> tuple[Conditioned, Hyperparameters]:
        """Return the conditioned process and its hyperparameters."""
        residual = data.z - mean.at(data.xy)
        found = self._hyperparameters(data, residual, variance)
        conditioned = self._condition(data.xy, residual, variance, found)
        if isinstance(conditioned.process, AveragedProcess):
            found = replace(found, nugget_m=conditioned.process.nugget_m)
        return conditioned, found

    def _hyperparameters(
        self, data: Observations, residual: FloatArray, variance: FloatArray
    ) -> Hyperparameters:
        if self.config.fit and self.config.family == "auto" and self.config.kernel is None:
            return averaged_kernels(
                data.xy,
                residual,
                variance,
                has_plane=self._has_plane,
                nugget_m=self.config.nugget_m,
                has_patches=self.engine == "dense" or is_little_work(len(data.xy), self.n_nodes),
            )
        if self.config.fit:
            return likeliest(data.xy, self._detrend(data.xy, residual), variance, self.config)
        family = stated_family(self.config)
        found = Hyperparameters(family, self.config.stated_kernel(), self.config.nugget_m or 0.0, 0.0)
        if isinstance(self.prior, Dem) and self.config.prior_sigma_m:
            kernel = with_prior_error(found.kernel, self.prior.step_m, self.config.prior_sigma_m)
            return replace(found, kernel=kernel)
        return found

    @property
    def _has_mean(self) -> bool:
        """Whether the prior is the mean of the process; its cells are not when their errors are stated."""
        return self.prior is not None and self.errors is None

    @property
    def _has_plane(self) -> bool:
        return not self._has_mean and self.config.mean == "plane"

    def _detrend(self, xy: FloatArray, residual: FloatArray) -> FloatArray:
        """Subtract a plane where one is part of the mean, so that it is not taken for a length scale."""
        if not self._has_plane:
            return residual
        columns = np.column_stack([np.ones(len(xy)), xy - xy.mean(axis=0)])
        detrended: FloatArray = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
        return detrended

    def _condition(
        self,
        xy: FloatArray,
        residual: FloatArray,
        variance: FloatArray,
        found: Hyperparameters,
        bounds: Bounds | None = None,
    ) -> Conditioned:
        if self._has_plane and Observations(xy, residual, variance).on_one_line():
            raise InputError("the points lie on one line and determine no plane; take mean = constant.")
        return condition_all(
            ConditioningTask(
                self.engine,
                self.config,
                bounds or self.bounds,
                self.config.trend(has_prior=self._has_mean),
                self._measurements,
                self.n_nodes,
                self.progress,
                self.division,
            ),
            found,
            xy,
            residual,
            variance,
        )

    @property
    def _measurements(self) -> PriorMeasurements | None:
        if self.errors is None or not isinstance(self.prior, Dem):
            return None
        return PriorMeasurements(self.prior, self.errors)

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
            process, _ = self._condition(
                data.xy[kept], residual[kept], variance[kept], found, bounds=(xmin, ymin, xmax, ymax)
            )
            height, spread = process.predict(xy)
            return height, process.surface_variance(spread, xy) + found.nugget_m**2

        return SigmaCalibration.cross_validated(data.xy, residual, variance, predict, self._gaps_m(data.xy))

    def _gaps_m(self, xy: FloatArray) -> FloatArray:
        """Return the distances from places all over the site to the nearest point [m]."""
        low, high = (self.bounds[:2], self.bounds[2:]) if self.bounds else (xy.min(axis=0), xy.max(axis=0))
        axes = [np.linspace(a, b, _N_GAPS) for a, b in zip(low, high, strict=True)]
        nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        return np.asarray(cKDTree(xy).query(nodes)[0])


def _z_scores(process: Process) -> FloatArray:
    mean, variance = process.leave_one_out()
    scores: FloatArray = (process.data.values - mean) / np.sqrt(variance)
    return scores
