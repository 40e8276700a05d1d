"""Terrain as a Gaussian process about a mean: from points to a map that states its own uncertainty."""

from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

import numpy as np

from survey.arrays import FloatArray
from survey.dem import Dem
from survey.errors import InputError
from survey.geodesy import same_crs, same_vertical_datum
from survey.grid import Grid
from survey.reconstruction.base import ELEVATION, Reconstruction
from survey.reconstruction.config import GaussianProcessConfig
from survey.reconstruction.dense_gp import DenseGaussianProcess, likeliest_dense
from survey.reconstruction.kernels import Kernel
from survey.reconstruction.mean import ConstantMean, DemMean, Mean, PlaneMean
from survey.reconstruction.observations import Observations
from survey.reconstruction.support import support_codes
from survey.reconstruction.trend import Engine, Trend
from survey.surface_points import SurfacePoints

Prior = Dem | Mean | None


@dataclass(frozen=True)
class GaussianProcessTerrain:
    """A terrain model: a mean surface, and a Gaussian process for what differs from it.

    Parameters
    ----------
    config : GaussianProcessConfig
        What to assume and what to fit.
    prior : Dem or Mean, optional
        The expected surface; without it a constant or a plane by generalised least squares.
    engine : {"gp", "dense"}
        The fast engine or the dense one.
    quantity : str
        What is mapped, with its unit.
    """

    config: GaussianProcessConfig = field(default_factory=GaussianProcessConfig)
    prior: Prior = None
    engine: Literal["gp", "dense"] = "gp"
    quantity: str = ELEVATION
    _state: Any = field(default=None, repr=False)

    def fit(self, points: SurfacePoints) -> Self:
        """Learn from points, and return the model."""
        data = Observations.of(points, self.quantity)
        mean = _mean_of(self.prior, self.config, data, points)
        residual = data.z - mean.at(data.xy)
        kernel = self._kernel(data, residual, mean)
        noise = data.variance + (self.config.nugget_m or 0.0) ** 2
        engine = DenseGaussianProcess(kernel).fit(data.xy, residual, noise)
        return replace(self, _state=_Posterior.of(engine, kernel, mean, data.xy, residual, noise=noise))

    def _kernel(self, data: Observations, residual: FloatArray, mean: Mean) -> Kernel:
        if not self.config.fit:
            return self.config.kernel()
        start = self.config.model_copy(
            update={
                "variance_m2": self.config.variance_m2 or float(np.var(residual)) + 1e-6,
                "length_scale_m": self.config.length_scale_m or 30.0,
            }
        ).kernel()
        centred = residual - (residual.mean() if mean.n_trend else 0.0)
        n = min(len(data), 800)
        pick = np.linspace(0, len(data) - 1, n).astype(int)
        extent = float(np.ptp(data.xy, axis=0).max())
        return likeliest_dense(
            start, data.xy[pick], centred[pick], data.variance[pick], bounds_m=(0.01 * extent, 3 * extent)
        )[0]

    def grid(self, grid: Grid) -> Reconstruction:
        """Return the map on the nodes of a grid."""
        state: _Posterior = self._state
        xy = grid.xy
        mean, variance, ratio = state.predict(xy)
        support = support_codes(
            xy, state.xy, ratio, shortest_length_m=state.kernel.length_scales_m[0], step_m=grid.step_m
        )
        names = dict(zip(state.kernel.parameter_names, state.kernel.log_parameters.tolist(), strict=True))
        return Reconstruction(
            Dem.on(grid, mean.reshape(grid.shape)),
            Dem.on(grid, np.sqrt(variance).reshape(grid.shape)),
            support.reshape(grid.shape),
            self.engine,
            {"log_marginal_likelihood": state.engine.log_marginal_likelihood, **names},
            quantity=self.quantity,
        )


@dataclass(frozen=True)
class _Posterior:
    engine: Engine
    kernel: Kernel
    mean: Mean
    trend: Trend | None
    xy: FloatArray

    @classmethod
    def of(
        cls,
        engine: Engine,
        kernel: Kernel,
        mean: Mean,
        xy: FloatArray,
        residual: FloatArray,
        *,
        noise: FloatArray,
    ) -> Self:
        if not mean.n_trend:
            return cls(engine, kernel, mean, None, xy)
        terms = mean.trend(xy)
        trend = Trend.fitted(engine, noise, terms, xy, residual)
        return cls(engine.for_residual(residual - terms @ trend.coefficients), kernel, mean, trend, xy)

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        mean, variance = self.engine.predict(xy)
        ratio = variance / self.kernel.variance_m2
        mean = mean + self.mean.at(xy)
        if self.trend is not None:
            terms = self.mean.trend(xy)
            gap = self.trend.unexplained(terms, xy)
            mean = mean + terms @ self.trend.coefficients
            variance = variance + np.einsum("ij,jk,ik->i", gap, self.trend.covariance, gap)
        return mean, variance, ratio


def _mean_of(prior: Prior, config: GaussianProcessConfig, data: Observations, points: SurfacePoints) -> Mean:
    if isinstance(prior, Dem):
        same_crs(prior.crs, points.crs, "the prior and the points")
        same_vertical_datum(prior.vertical_datum, points.vertical_datum, "the prior and the points")
        return DemMean(prior, config.prior_interpolation)
    if prior is not None:
        return prior
    if config.mean == "constant":
        return ConstantMean()
    if data.on_one_line():
        raise InputError("the points lie on one line and determine no plane; take mean = constant.")
    centre = data.xy.mean(axis=0)
    return PlaneMean((float(centre[0]), float(centre[1])), float(np.ptp(data.xy, axis=0).max()))
