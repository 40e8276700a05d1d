"""Predicted error of the map that a route will give, from the places of its samples and of the prior's cells.

`ErrorModel` predicts the distribution of the map's root mean square error, and its standard deviation from place to place,
for many routes over one area. `ErrorModel.from_prior` takes the covariances of the terrain from a coarse prior and counts
the prior's cells as measurements, as the map will; `ErrorModel.of` takes a known covariance. Every plan, comparison and
guarantee uses this one prediction. `predict_error` is the function for one route and a known covariance.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np
from threadpoolctl import ThreadpoolController

from planners.capacity import require_error_nodes
from planners.config import settings_factor
from planners.prediction.assumptions import MapAssumptions, SampleErrors
from planners.prediction.error_distribution import FITTED_KERNEL_INFLATION, ErrorDistribution, MapPredictor
from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel, posterior_in_grid
from planners.prediction.places import places
from planners.prediction.prior_cells import PriorCells
from survey import Dem, Grid, InputError, Route, SurveyArea
from survey.core import BoolArray, FloatArray
from survey.reconstruction.gp.kernels import Kernel

_N_NODES_ALONG = 30
# Places whose variance is computed together, and places that routes are compared at.
_BLOCK, _N_COMPARED = 3000, 60
# Places in a cell, in shares of it from its centre: no two in one row or column, so that swaths as far apart as
# the cells are seen.
_IN_CELL = np.array([[-0.375, -0.125], [-0.125, 0.375], [0.125, -0.375], [0.375, 0.125]])
# Relative to the standard deviation of the terrain: keeps the matrix positive definite, a centimetre on 25 m of relief.
_LEAST_NOISE = 1e-3


@dataclass(frozen=True)
class PredictedError:
    """Predicted error of a map.

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

    .. math::  v(x) = k(x, x) - k(x, X) [K(X, X) + R]^{-1} k(X, x) + \ldots

    at places x for samples X along the route and means over the cells of a prior, with their errors R (glacier paper,
    Eq. 5); the dots stand for the unknown constant mean, which is integrated out.

    Parameters
    ----------
    area : SurveyArea
        Where the map is wanted.
    grid : Grid
        Centres of the cells in which the standard deviation is drawn.
    posterior : planners.prediction.kernel_posterior.KernelPosterior
        Covariances that the terrain may have, with lengths in grid metres.
    errors : planners.prediction.assumptions.SampleErrors
        Errors of samples, in grid metres.
    predictor : planners.prediction.error_distribution.MapPredictor
        Part of the prediction that depends on the places of samples and cells.

    Notes
    -----
    Errors of position that grow along the path are not included. The roughness of ground below the cells of a prior is known
    to a factor of about 1.5 only, which the distribution states.

    Examples
    --------
    >>> import planners
    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> model = ErrorModel.of(area, SquaredExponential(30.0, 150.0), noise_m=0.1)
    >>> routes = [planners.plan(area, None, planners.LawnmowerConfig(swaths=n)) for n in (4, 8)]
    >>> few, many = (model.rmse_m(route) for route in routes)
    >>> many < few
    True
    """

    area: SurveyArea
    grid: Grid
    posterior: KernelPosterior
    errors: SampleErrors
    predictor: MapPredictor

    @classmethod
    def of(
        cls,
        area: SurveyArea,
        kernel: Kernel,
        *,
        noise_m: float,
        sample_step_m: float = 10.0,
        cell_m: float | None = None,
    ) -> Self:
        """Create the model of terrain of a known covariance, mapped without a prior.

        Parameters
        ----------
        area : SurveyArea
            Where the map is wanted.
        kernel : survey.reconstruction.gp.kernels.Kernel
            Covariance of the terrain [m²], with lengths in grid metres.
        noise_m : float
            Standard deviation of a sample [m].
        sample_step_m : float
            Distance between samples, in grid metres.
        cell_m : float, optional
            Width of the cells in which the standard deviation is drawn [m].

        Returns
        -------
        ErrorModel
            Without an error that samples share.
        """
        errors = SampleErrors(noise_m=noise_m, sample_step_m=sample_step_m, shared_m=0.0)
        noise_m = max(noise_m, _LEAST_NOISE * float(np.sqrt(kernel.variance_m2)))
        posterior = KernelPosterior((WeightedKernel.given(kernel, noise_m),))
        return cls(area, _grid(area, cell_m), posterior, errors, MapPredictor(area, sample_step_m))

    @classmethod
    def from_prior(
        cls,
        area: SurveyArea,
        prior: Dem,
        assumed: MapAssumptions | None = None,
        *,
        cell_m: float | None = None,
    ) -> "ErrorModel":
        """Create the model of terrain that a prior shows coarsely, mapped with that prior.

        Parameters
        ----------
        area : SurveyArea
            Where the map is wanted.
        prior : Dem
            Coarse elevations.
        assumed : MapAssumptions, optional
            Errors of samples and prior, and the class of surface; lengths are metres on the ground.
        cell_m : float, optional
            Width of the cells in which the standard deviation is drawn [m].

        Returns
        -------
        ErrorModel
            With the covariances that the prior makes likely.

        Raises
        ------
        InputError
            Fewer than 9 known cells on the area.
        """
        errors = (assumed or MapAssumptions()).in_grid_metres(settings_factor(area))
        model = model_in_grid(area, prior, errors)
        return model if cell_m is None else model.with_cells(cell_m)

    @property
    def slope_length_m(self) -> float:
        """Distance over which the terrain's slopes change [m]."""
        return self.posterior.slope_length_m

    @property
    def nodes(self) -> FloatArray:
        """Places (M, 2) on the free ground where the map is judged [m]."""
        return self.predictor.nodes

    def with_cells(self, cell_m: float) -> Self:
        """Return the model that draws the standard deviation in cells of another width.

        Parameters
        ----------
        cell_m : float
            Width of a cell [m].

        Returns
        -------
        ErrorModel
            With another grid.
        """
        return replace(self, grid=_grid(self.area, cell_m))

    def over(self, area: SurveyArea, prior: Dem) -> Self:
        """Return the model of another area, with the same covariances and the cells of the prior there.

        Parameters
        ----------
        area : SurveyArea
            Where the map is wanted.
        prior : Dem
            Coarse elevations.

        Returns
        -------
        ErrorModel
            Of the other area.
        """
        cells = None
        if self.predictor.cells is not None:
            cells = PriorCells.of(prior, area, self.predictor.cells.sigma_m)
        predictor = replace(self.predictor, area=area, cells=cells)
        return replace(self, area=area, grid=_grid(area, None), predictor=predictor)

    def for_comparisons(self) -> Self:
        """Return the model with the likeliest covariance alone and at fewer places, which ranks routes many times faster.

        Returns
        -------
        ErrorModel
            Itself where no prior is used.
        """
        if self.predictor.cells is None:
            return self
        posterior = KernelPosterior.of([self.posterior.likeliest])
        return replace(self, posterior=posterior, predictor=replace(self.predictor, n_nodes=_N_COMPARED))

    def distribution(self, route: Route, most_samples: int | None = None) -> ErrorDistribution:
        """Return the distribution of the root mean square error of the map over the area.

        Parameters
        ----------
        route : Route
            What is driven; samples are taken along swaths and transits.
        most_samples : int, optional
            Of more samples every k-th stands for its neighbours, but no two are farther apart than the swaths.

        Returns
        -------
        planners.prediction.error_distribution.ErrorDistribution
            Its expected value, quantiles, and the probability of a limit.
        """
        return self.beside_level(route, most_samples).with_shared(self.errors.shared_m)

    def beside_level(self, route: Route, most_samples: int | None = None) -> ErrorDistribution:
        """Return the distribution of the root mean square error of the map without the error that all samples share.

        Parameters
        ----------
        route : Route
            What is driven; samples are taken along swaths and transits.
        most_samples : int, optional
            Of more samples every k-th stands for its neighbours, but no two are farther apart than the swaths.

        Returns
        -------
        planners.prediction.error_distribution.ErrorDistribution
            As of a map whose level is known.
        """
        xy, posterior = self._samples(route, most_samples)
        # Matrices of some hundred rows: spinning threads would only slow them down.
        with _libraries().limit(limits=1):
            return self.predictor.distribution(xy, posterior)

    @property
    def level_m(self) -> float | None:
        """Standard deviation of the level of a map that the prior alone holds [m]; None without a prior."""
        return None if self.predictor.cells is None else self.predictor.cells.level_m

    def rmse_m(self, route: Route, most_samples: int | None = None) -> float:
        """Return the expected root mean square error over the area.

        Parameters
        ----------
        route : Route
            What is driven; samples are taken along swaths and transits.
        most_samples : int, optional
            Of more samples every k-th stands for its neighbours, but no two are farther apart than the swaths.

        Returns
        -------
        float
            Expected error [m].
        """
        return self.distribution(route, most_samples).rmse_m

    def variance(self, xy: FloatArray, noise_factor: float = 1.0, at: FloatArray | None = None) -> FloatArray:
        """Return the predicted variance at the nodes, given samples at places.

        Parameters
        ----------
        xy : (N, 2) array
            Easting and northing of the samples [m].
        noise_factor : float
            Factor of the errors of samples, where fewer stand for all.
        at : (M, 2) array, optional
            Other places than the nodes [m].

        Returns
        -------
        (M,) array
            Variance [m²].
        """
        posterior = self.posterior.with_noise_times(noise_factor)
        with _libraries().limit(limits=1):
            if at is None:
                return self.predictor.variance(xy, posterior)
            blocks = [at[start : start + _BLOCK] for start in range(0, len(at), _BLOCK)]
            return np.concatenate([self.predictor.variance(xy, posterior, block) for block in blocks])

    def error(self, route: Route, most_samples: int | None = None) -> PredictedError:
        """Return the predicted error of a route, with its map.

        The map is scaled to the expected error over the area, of which it shows where it is large.

        Parameters
        ----------
        route : Route
            What is driven; samples are taken along swaths and transits.
        most_samples : int, optional
            Of more samples every k-th stands for its neighbours, but no two are farther apart than the swaths.

        Returns
        -------
        PredictedError
            The map of the standard deviation with its summary.

        Raises
        ------
        InputError
            Cells too large for the area.
        """
        cells, offsets = self.grid.xy[:, None], self.grid.step_m * _IN_CELL
        places_in = (cells + offsets).reshape(-1, 2)
        inside = self.area.contains(places_in)
        if not inside.any():
            raise InputError(
                f"no place of {self.grid.step_m:g} m cells lies on the free ground; take smaller cells."
            )
        xy, posterior = self._samples(route, most_samples)
        model = replace(self, posterior=posterior)
        of_nodes, of_cells = model.variance(xy), model.variance(xy, at=places_in[inside])
        rmse_m = self.rmse_m(route, most_samples)
        scale_m2 = rmse_m**2 / float(of_nodes.mean())
        std = np.sqrt(scale_m2 * _means(of_cells, inside.reshape(len(cells), -1))).reshape(self.grid.shape)
        return PredictedError(
            Dem.on(self.grid, std),
            rmse_m,
            float(np.sqrt(scale_m2 * np.percentile(of_nodes, 95.0))),
            float(np.sqrt(scale_m2 * max(of_nodes.max(), of_cells.max()))),
        )

    def _samples(self, route: Route, most_samples: int | None) -> tuple[FloatArray, KernelPosterior]:
        """Return the places of samples (N, 2) [m], and the covariances with the errors of these samples."""
        xy = places(route, self.errors.sample_step_m)
        apart = float(self.area.free.area) / max(len(xy) * self.errors.sample_step_m**2, 1e-9)
        every = 1 if most_samples is None else int(min(np.ceil(len(xy) / most_samples), apart))
        if every <= 1:
            return xy, self.posterior
        return xy[::every], self.posterior.with_noise_times(float(1.0 / np.sqrt(every)))


def model_in_grid(area: SurveyArea, prior: Dem, errors: MapAssumptions) -> ErrorModel:
    """Return the model of terrain that a prior shows coarsely, for assumptions whose lengths are grid metres."""
    cells = PriorCells.of(prior, area, errors.prior_sigma_m)
    predictor = MapPredictor(area, errors.sample_step_m, FITTED_KERNEL_INFLATION, cells)
    with _libraries().limit(limits=1):
        posterior = posterior_in_grid(area, prior, errors)
    return ErrorModel(area, _grid(area, None), posterior, errors, predictor)


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries that have threads, found once: the search takes as long as a small prediction.

    BLAS of NumPy and SciPy are loaded by the imports of this module; libraries that are loaded later are not limited.
    """
    return ThreadpoolController()


def _grid(area: SurveyArea, cell_m: float | None) -> Grid:
    """Return the centres of cells over an area, a thirtieth of its longer side by default."""
    xmin, ymin, xmax, ymax = area.bounds
    cell = cell_m or max(xmax - xmin, ymax - ymin) / _N_NODES_ALONG
    require_error_nodes(((xmax - xmin) / cell) * ((ymax - ymin) / cell), cell)
    n_x, n_y = (max(int(np.ceil(side / cell - 1e-9)), 2) for side in (xmax - xmin, ymax - ymin))
    x0, y0 = xmin + 0.5 * cell, ymin + 0.5 * cell
    return Grid((x0, y0, x0 + (n_x - 1) * cell, y0 + (n_y - 1) * cell), cell, area.crs)


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
