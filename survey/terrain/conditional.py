"""Conditional simulation of terrain: random surfaces that agree with the cells of a coarse prior."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.gp.kernels import Kernel
from survey.terrain.random_fields import kernel_field

_MOST_CELLS = 1600
_MOST_PLACES = 2500


@dataclass(frozen=True, eq=False)
class CoarseCells:
    r"""What the cells of a coarse DEM say of a stationary field: their covariance with it and among them.

    A cell shows the mean of the field over its square, with an error of its own. Means are taken over
    n × n places, three by three where there are few cells:

    .. math::  Q_{ij} = \frac{1}{n^4} \sum_{p \in i, q \in j} k(p, q) + \sigma^2 \delta_{ij}

    (block kriging, Journel and Huijbregts 1978).

    Parameters
    ----------
    prior : Dem
        Coarse elevations; cells without a height are left out.
    sigma_m : float
        Standard deviation of a cell's error, independent from cell to cell [m].
    """

    prior: Dem
    sigma_m: float

    def __post_init__(self) -> None:
        n = int(np.isfinite(self.prior.elevation).sum())
        if not 9 <= n <= _MOST_CELLS:
            raise InputError(
                f"the prior has {n} known cells on the area; 9 to {_MOST_CELLS} are needed to estimate how the terrain varies, "
                "take a coarser or a finer prior."
            )

    @cached_property
    def height_m(self) -> FloatArray:
        """Heights (C,) of the known cells [m]."""
        height: FloatArray = self.prior.elevation[np.isfinite(self.prior.elevation)]
        return height

    @cached_property
    def places(self) -> FloatArray:
        """Places (C, P, 2) within each cell that its mean is taken over [m]."""
        n = int(np.clip(np.sqrt(_MOST_PLACES / len(self.height_m)), 1, 3))
        share = (np.arange(n) + 0.5) / n - 0.5
        east, north = np.meshgrid(share, share)
        offsets = self.prior.step_m * np.column_stack([east.ravel(), north.ravel()])
        centres = self.prior.xy[np.isfinite(self.prior.elevation).ravel()]
        return np.asarray(centres[:, None, :] + offsets[None, :, :], dtype=np.float64)

    def covariance(self, kernel: Kernel) -> FloatArray:
        """Return the covariance (C, C) of the cells' means, without their errors [m²].

        On a regular grid it depends on how many rows and columns two cells are apart, and on no more.
        """
        rows, columns = np.nonzero(np.isfinite(self.prior.elevation))
        apart, weight = self._within
        down = np.arange(np.ptp(rows) + 1)
        right = np.arange(-np.ptp(columns), np.ptp(columns) + 1)
        steps = self.prior.step_m * np.stack(np.meshgrid(right, -down), axis=-1)
        means = kernel.covariance_of_lag(steps[:, :, None, :] + apart) @ weight
        d_row = rows[:, None] - rows
        d_column = np.where(d_row < 0, -1, 1) * (columns[:, None] - columns)
        covariance: FloatArray = means[np.abs(d_row), d_column + np.ptp(columns)]
        return covariance

    @cached_property
    def _within(self) -> tuple[FloatArray, FloatArray]:
        """Lags (K, 2) [m] between the places of one cell and those of another at the same spot, and their shares (K,)."""
        offsets = self.places[0] - self.places[0].mean(axis=0)
        lags = (offsets[:, None] - offsets).reshape(-1, 2)
        distinct, counts = np.unique(np.round(lags, 9), axis=0, return_counts=True)
        return distinct, counts / len(lags)

    def covariance_with(self, kernel: Kernel, xy: FloatArray) -> FloatArray:
        """Return the covariance (C, M) of the cells' means with the field at places (M, 2) [m²]."""
        n, per_cell, _ = self.places.shape
        fine = kernel.covariance(self.places.reshape(-1, 2), xy)
        means: FloatArray = fine.reshape(n, per_cell, -1).mean(axis=1)
        return means

    def seen_in(self, field: Dem) -> FloatArray:
        """Return the mean (C,) of a fine field over each cell [m]."""
        n, per_cell, _ = self.places.shape
        means: FloatArray = field.at(self.places.reshape(-1, 2)).reshape(n, per_cell).mean(axis=1)
        return means


@dataclass(frozen=True, eq=False)
class ConditionalTerrain:
    """Draws terrain with a covariance that agrees with coarse cells.

    A free draw of the field is corrected by kriging the difference between what the cells show and what
    they would have shown of the draw (Journel and Huijbregts 1978, conditioning by kriging).

    Parameters
    ----------
    cells : CoarseCells
        Mean elevations of coarse cells [m], as measured.
    kernel : Kernel
        Covariance of the terrain about an unknown constant [m²].
    grid : Grid
        Nodes of the terrain, on the cells' ground.

    Examples
    --------
    >>> from survey.reconstruction.gp.kernels import Matern52
    >>> coarse = Dem.on(Grid((37.5, 37.5, 562.5, 562.5), 75.0), np.arange(64.0).reshape(8, 8))
    >>> drawn = ConditionalTerrain(
    ...     CoarseCells(coarse, sigma_m=0.1), Matern52(30.0, 150.0), Grid((0.0, 0.0, 600.0, 600.0), 10.0)
    ... )
    >>> terrain = drawn.draw(np.random.default_rng(1))
    >>> bool(np.abs(drawn.cells.seen_in(terrain) - drawn.cells.height_m).max() < 1.0)
    True
    """

    cells: CoarseCells
    kernel: Kernel
    grid: Grid

    def draw(self, rng: np.random.Generator) -> Dem:
        """Return one surface.

        Raises
        ------
        InputError
            A grid too coarse for the kernel, or beyond the ground whose cells are known.
        """
        return self.conditioned(Dem.on(self.wide, kernel_field(self.wide, rng, self.kernel)), rng)

    @cached_property
    def wide(self) -> Grid:
        """The nodes and a margin: cells reach half a cell beyond nodes that end at their centres."""
        xmin, ymin, xmax, ymax = self.grid.bounds
        margin = self.grid.step_m * np.ceil(self.cells.prior.step_m / self.grid.step_m)
        return Grid(
            (xmin - margin, ymin - margin, xmax + margin, ymax + margin), self.grid.step_m, self.grid.crs
        )

    def conditioned(self, free: Dem, rng: np.random.Generator) -> Dem:
        """Return a surface on the `wide` nodes corrected so that it agrees with the cells.

        Parameters
        ----------
        free : Dem
            Any surface on the `wide` nodes [m]; relief that the cells do not show stays.
        rng : numpy.random.Generator
            Source of the errors of the cells.

        Returns
        -------
        Dem
            On the nodes of the terrain.

        Raises
        ------
        InputError
            Cells beyond the surface.
        """
        missing = self.cells.height_m - self.cells.seen_in(free)
        if np.isnan(missing).any():
            raise InputError(
                "cells of the prior lie beyond the terrain to be drawn; cut the prior to the area."
            )
        missing = missing + self.cells.sigma_m * rng.standard_normal(len(missing))
        level, weights = self._kriged(missing)
        correction = level + self._reach.T @ weights
        heights = free.at(self.grid.xy) + correction
        return Dem.on(self.grid, heights.reshape(self.grid.shape), self.cells.prior.vertical_datum)

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        covariance = self.cells.covariance(self.kernel)
        covariance[np.diag_indices(len(covariance))] += self.cells.sigma_m**2 + 1e-6 * self.kernel.variance_m2
        return cho_factor(covariance, lower=True)

    @cached_property
    def _reach(self) -> FloatArray:
        """Covariance (C, M) of the cells with the nodes."""
        nodes = self.grid.xy
        blocks = [
            self.cells.covariance_with(self.kernel, nodes[i : i + 2000]) for i in range(0, len(nodes), 2000)
        ]
        return np.hstack(blocks)

    def _kriged(self, values: FloatArray) -> tuple[float, FloatArray]:
        """Return the constant and the weights (C,) that interpolate values at the cells."""
        ones = cho_solve(self._factor, np.ones(len(values)))
        level = float(ones @ values / ones.sum())
        weights: FloatArray = cho_solve(self._factor, values - level)
        return level, weights
