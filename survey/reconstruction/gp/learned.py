"""Fitted state of a Gaussian-process terrain: mean, conditioned process, calibration, outliers."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.reconstruction.base import CHECK, UNSEEN
from survey.reconstruction.gp.calibration import SigmaCalibration
from survey.reconstruction.gp.engines.base import Process
from survey.reconstruction.gp.mean import Mean
from survey.reconstruction.gp.selection.kernel_fit import Hyperparameters
from survey.reconstruction.outliers import Outliers
from survey.reconstruction.support import support_codes

MOST_AT_ONCE = 4_000_000
"""Nodes that are finished at once, which bounds the memory of a large map."""


@dataclass(frozen=True)
class Learned:
    """A mean surface, the process of what differs from it, and the calibration of its standard deviation."""

    process: Process
    mean: Mean
    found: Hyperparameters
    calibration: SigmaCalibration
    outliers: Outliers
    n_beyond_reach: int = 0

    @classmethod
    def uncalibrated(cls, process: Process, mean: Mean, found: Hyperparameters) -> Self:
        """Return the state before outliers are looked for and the standard deviation is calibrated."""
        none = Outliers(np.zeros(0, dtype=np.int64), np.zeros(0))
        return cls(process, mean, found, SigmaCalibration.none(), none)

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the most likely height (M,) [m]."""
        return self.process.predict(xy)[0] + self.mean.at(xy)

    def std(self, xy: FloatArray) -> FloatArray:
        """Return the standard deviation (M,) [m], fine relief and calibration included."""
        return self._total_std(self.process.predict(xy)[1], xy, self.nearest_m(xy))

    def nearest_m(self, xy: FloatArray) -> FloatArray:
        """Return the distance (M,) to the nearest point [m]."""
        return np.asarray(cKDTree(self.process.data.xy).query(xy)[0], dtype=np.float64)

    def support(self, std: FloatArray, nearest_m: FloatArray, step_m: float = 0.0) -> npt.NDArray[np.uint8]:
        """Return the support codes of places with this standard deviation and distance to the nearest point."""
        prior = self.process.kernel.variance_m2 + self.found.nugget_m**2
        return support_codes(
            nearest_m,
            (std / self.calibration.at(nearest_m)) ** 2 / prior,
            shortest_length_m=self.process.kernel.length_scales_m[0],
            step_m=step_m,
        )

    def on(self, grid: Grid) -> tuple[FloatArray, FloatArray, npt.NDArray[np.uint8]]:
        """Return height [m], standard deviation [m] and support code (H, W) on the nodes of a grid."""
        mean, std = self.process.predict_on_axes(grid.x, grid.y)
        support = np.empty(grid.shape, dtype=np.uint8)
        rows_at_once = max(MOST_AT_ONCE // grid.shape[1], 1)
        for first in range(0, grid.shape[0], rows_at_once):
            rows = slice(first, first + rows_at_once)
            nodes = np.stack(np.meshgrid(grid.x, grid.y[rows]), axis=-1).reshape(-1, 2)
            places = _Places(nodes, mean[rows].ravel(), std[rows].ravel() ** 2)
            found = self._finished(places, grid.step_m)
            mean[rows], std[rows], support[rows] = (values.reshape(-1, grid.shape[1]) for values in found)
        return mean, std, support

    def _finished(
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
        noise = np.sqrt(variance + self.found.nugget_m**2)
        return replace(self, process=self.process.update(xy, z - self.mean.at(xy), noise))

    def hyperparameters(self) -> dict[str, Any]:
        """Return family, parameters and likelihood, for the record."""
        return {
            "family": self.found.family,
            **self.process.kernel.parameters(),
            "nugget_m": self.found.nugget_m,
            "log_marginal_likelihood": self.process.log_marginal_likelihood,
        }

    def diagnostics(self) -> dict[str, Any]:
        """Return what was found out about the points and the engine, for the record."""
        check = self.calibration.held_out.get(CHECK)
        return {
            **({} if check is None else {CHECK: check}),
            "n_points": len(self.process.data),
            "n_points_beyond_reach": self.n_beyond_reach,
            "outliers": self.outliers.facts(),
            "calibration": self.calibration.facts(),
            "engine": self.process.record(),
        }

    def _total_std(self, variance: FloatArray, xy: FloatArray, nearest_m: FloatArray) -> FloatArray:
        """Return the standard deviation of the ground: that of the process and of the nugget, calibrated."""
        total = self.process.surface_variance(variance, xy) + self.found.nugget_m**2
        return np.sqrt(total) * self.calibration.at(nearest_m)


class _Places(NamedTuple):
    """Places (M, 2) [m], and mean (M,) [m] and variance (M,) [m²] of the process there."""

    xy: FloatArray
    residual: FloatArray
    variance: FloatArray
