"""Predicted map error of a route, from the covariance of the terrain and the places of the samples.

`ErrorModel` gives the posterior variance of a Gaussian process at the nodes of a map, which depends on the places of
the samples and not on the heights. Maps of very many samples are predicted from the nearest samples of each node.
`predict_error` returns the standard deviation of the map of a route.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from planners.capacity import require_error_nodes
from planners.prediction.places import places, slope_length_m, spread_places
from survey import ConfigError, Dem, Grid, InputError, Route, SurveyArea
from survey.core import BoolArray, FloatArray
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
from survey.reconstruction.gp.kernels import Kernel

# Nearer samples screen those beyond.
_N_NEAREST = 120


def _variance_from_nearest(kernel: Kernel, xy: FloatArray, sigma_m: float, at: FloatArray) -> FloatArray:
    """Return the variance at places, each predicted from its 120 nearest samples, which screen those beyond.

    `kernel`: covariance of the terrain [m²]. `xy` (N, 2): easting and northing of the samples [m]. `sigma_m`:
    standard deviation of a sample [m]. `at` (M, 2): the places [m]. Returns (M,): variance [m²].
    """
    nearest = cKDTree(xy).query(at, min(_N_NEAREST, len(xy)))[1].reshape(len(at), -1)
    variance = np.empty(len(at))
    for index, (place, chosen) in enumerate(zip(at, nearest, strict=True)):
        n = len(chosen)
        process = DenseGaussianProcess.fit(
            xy[chosen], np.zeros(n), np.full(n, sigma_m), kernel, trend="constant"
        )
        variance[index] = process.predict(place[None, :])[1][0]
    return variance


_N_NODES_ALONG = 30
_LEAST_NODES = 200
_MOST_SAMPLES = 2000
_MOST_PLACES = 1_000_000
# Places in a cell, in shares of it from its centre: no two in one row or column, so that swaths as far apart as
# the cells are seen.
_IN_CELL = np.array([[-0.375, -0.125], [-0.125, 0.375], [0.125, -0.375], [0.375, 0.125]])
# Relative to the prior standard deviation: keeps the matrix positive definite, a centimetre on 25 m of relief.
_LEAST_NOISE = 1e-3


@dataclass(frozen=True)
class PredictedError:
    """Predicted error of a map, given the covariance of the terrain.

    `std`: standard deviation in the cells of a coarse grid [m]: the root mean square over the free ground of
    the cell; NaN off the free ground. `rmse_m`: expected root mean square error over the area [m]. `p95_m`,
    `worst_m`: 95th percentile and largest value of the standard deviation [m].
    """

    std: Dem
    rmse_m: float
    p95_m: float
    worst_m: float


@dataclass(frozen=True, eq=False)
class ErrorModel:
    r"""Predictor of the error of maps over one area, for many routes.

    .. math::  v(x) = k(x, x) - k(x, X) [K(X, X) + \sigma^2 I]^{-1} k(X, x) + \ldots

    at the nodes x for samples X along the route (glacier paper, Eq. 5); the dots stand
    for the unknown constant mean, which is integrated out. Nodes are spread over the area
    in no step with the swaths.

    `area`: where the map is wanted. `grid`: centres of the cells in which the standard deviation is drawn.
    `kernel`: covariance of the terrain [m²], with lengths in grid metres. `noise_m`: standard deviation of a
    sample [m]. `sample_step_m`: distance between samples, in grid metres.
    """

    area: SurveyArea
    grid: Grid
    kernel: Kernel
    noise_m: float
    sample_step_m: float

    @classmethod
    def of(
        cls,
        area: SurveyArea,
        kernel: Kernel,
        *,
        noise_m: float,
        sample_step_m: float = 10.0,
        cell_m: float | None = None,
    ) -> "ErrorModel":
        """Create the model with nodes over an area.

        `kernel`: covariance of the terrain [m²], with lengths in grid metres. `noise_m`: standard deviation
        of a sample [m].
        """
        if not (np.isfinite(noise_m) and noise_m >= 0.0):
            raise ConfigError(f"the noise of a sample is {noise_m} m; it must be 0 or greater.")
        if not (np.isfinite(sample_step_m) and sample_step_m > 0.0):
            raise ConfigError(f"the sample spacing is {sample_step_m} m; it must be greater than 0.")
        xmin, ymin, xmax, ymax = area.bounds
        cell = cell_m or max(xmax - xmin, ymax - ymin) / _N_NODES_ALONG
        require_error_nodes(((xmax - xmin) / cell) * ((ymax - ymin) / cell), cell)
        n_x, n_y = (max(int(np.ceil(side / cell - 1e-9)), 2) for side in (xmax - xmin, ymax - ymin))
        x0, y0 = xmin + 0.5 * cell, ymin + 0.5 * cell
        grid = Grid((x0, y0, x0 + (n_x - 1) * cell, y0 + (n_y - 1) * cell), cell, area.crs)
        return cls(area, grid, kernel, noise_m, sample_step_m)

    @property
    def slope_length_m(self) -> float:
        """Distance over which the terrain's slopes change [m]."""
        return slope_length_m(self.kernel)

    @cached_property
    def nodes(self) -> FloatArray:
        """Nodes (M, 2) on the free ground [m]."""
        n_cells = int(self.area.free.area / self.grid.step_m**2)
        return spread_places(self.area, max(n_cells, _LEAST_NODES))

    def variance(
        self, xy: FloatArray, noise_m: float | None = None, at: FloatArray | None = None
    ) -> FloatArray:
        """Return the predicted variance at the nodes, given samples at places.

        `xy` (N, 2): easting and northing of the samples [m]. `noise_m`: standard deviation of a sample [m];
        that of the model by default. `at` (M, 2): other places than the nodes [m]. Returns (M,): variance at
        the nodes [m²].
        """
        sigma = np.full(len(xy), max(self.noise_m if noise_m is None else noise_m, self._least_noise_m))
        gp = DenseGaussianProcess.fit(xy, np.zeros(len(xy)), sigma, self.kernel, trend="constant")
        return gp.predict(self.nodes if at is None else at)[1]

    def _variance_of(self, route: Route, most_samples: int, at: FloatArray) -> FloatArray:
        """Return the variance at places; fewer, better samples stand for all where there would be too many."""
        step = max(self.sample_step_m, route.length_m / most_samples)
        is_local = self._is_local(route, most_samples)
        if is_local:
            step = max(self.sample_step_m, 0.5 * self._apart_m(route), route.length_m / _MOST_PLACES)
        xy, noise = places(route, step), self.noise_m * float(np.sqrt(self.sample_step_m / step))
        if is_local:
            return _variance_from_nearest(self.kernel, xy, max(noise, self._least_noise_m), at)
        return self.variance(xy, noise, at)

    def _is_local(self, route: Route, most_samples: int) -> bool:
        """Return whether so few samples would lie farther apart than the swaths: then those near a place predict it."""
        return max(self.sample_step_m, route.length_m / most_samples) > self._apart_m(route)

    def _apart_m(self, route: Route) -> float:
        """Return how far lines as long as the route would be apart over the area [m]."""
        return float(self.area.free.area) / max(route.length_m, 1e-9)

    @property
    def _least_noise_m(self) -> float:
        return _LEAST_NOISE * float(np.sqrt(self.kernel.variance_m2))

    def rmse_m(self, route: Route, most_samples: int = _MOST_SAMPLES) -> float:
        """Return the expected root-mean-square error over the area [m].

        Where the route has more than `most_samples` samples, fewer stand for all: their
        noise is that of the mean of those that each replaces.

        Returns: root of the mean variance over the nodes [m].
        """
        at = self.nodes[: _LEAST_NODES if self._is_local(route, most_samples) else None]
        return float(np.sqrt(self._variance_of(route, most_samples, at).mean()))

    def error(self, route: Route) -> PredictedError:
        """Return the predicted error of a route, with its map."""
        cells, offsets = self.grid.xy[:, None], self.grid.step_m * _IN_CELL
        xy = (cells + offsets).reshape(-1, 2)
        inside = self.area.contains(xy)
        if not inside.any():
            raise InputError(
                f"no place of {self.grid.step_m:g} m cells lies on the free ground; take smaller cells."
            )
        variance = self._variance_of(route, _MOST_SAMPLES, np.vstack([self.nodes, xy[inside]]))
        of_nodes, of_cells = np.split(variance, [len(self.nodes)])
        std = np.sqrt(_means(of_cells, inside.reshape(len(cells), -1))).reshape(self.grid.shape)
        return PredictedError(
            Dem.on(self.grid, std),
            self.rmse_m(route),
            float(np.sqrt(np.percentile(of_nodes, 95.0))),
            float(np.sqrt(variance.max())),
        )


def _means(values: FloatArray, inside: BoolArray) -> FloatArray:
    """Return the mean of each cell's values (of all True elements in order), NaN in cells without one."""
    n, total = inside.sum(axis=1), np.zeros(len(inside))
    np.add.at(total, np.nonzero(inside)[0], values)
    means: FloatArray = np.divide(total, n, out=np.full(len(n), np.nan), where=n > 0)
    return means


def predict_error(
    route: Route,
    area: SurveyArea,
    kernel: Kernel,
    *,
    noise_m: float,
    sample_step_m: float = 10.0,
    cell_m: float | None = None,
) -> PredictedError:
    """Predict the standard deviation and the error of the map that a route will give.

    Parameters
    ----------
    route : Route
        What is driven; samples are taken along swaths and transits.
    area : SurveyArea
        Where the map is wanted.
    kernel : survey.reconstruction.gp.kernels.Kernel
        Covariance of what is not yet known of the terrain [m²].
    noise_m : float
        Standard deviation of a sample [m].
    sample_step_m : float
        Distance between samples [m].
    cell_m : float, optional
        Distance between the nodes of the predicted map [m]; a thirtieth of the longer
        side by default.

    Returns
    -------
    PredictedError
        The map of the standard deviation with its summary.

    Raises
    ------
    InputError
        A route in another CRS than the area; cells too large for the area.
    ConfigError
        A negative noise, a sample spacing that is not greater than 0.

    Notes
    -----
    The prediction is as good as the covariance: relief that is rougher than the kernel says
    is not included, nor are errors of the rover's position. Heights of a prior do not enter.

    Examples
    --------
    >>> import planners
    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> route = planners.plan(area, None, planners.LawnmowerConfig(swaths=6))
    >>> error = predict_error(route, area, SquaredExponential(30.0, 150.0), noise_m=0.1)
    >>> error.std.shape, 0.0 < error.rmse_m < 1.0
    ((30, 30), True)
    """
    area.require_crs(route.crs, "the route")
    model = ErrorModel.of(area, kernel, noise_m=noise_m, sample_step_m=sample_step_m, cell_m=cell_m)
    return model.error(route)
