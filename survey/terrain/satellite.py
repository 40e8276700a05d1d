"""Satellite elevation products of a terrain: coarse means with errors, and smooth interpolation of their cells.

`satellite_copy` takes means over coarse cells and adds white noise. `product_copy` adds the errors of a real product:
offset, tilt, horizontal shift, correlated and white errors. `smooth_interpolation` returns a smooth surface with the
same cell means.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from affine import Affine
from scipy.interpolate import make_interp_spline
from scipy.ndimage import shift as shifted_array

from survey.core import FloatArray, InputError, same_crs
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.prior_likelihood import correlation


@dataclass(frozen=True)
class SatelliteDem(Dem):
    """A coarse DEM with the standard deviation of its cells.

    `elevation` (H, W): heights [m], row 0 in the north; NaN for nodata. `transform`: maps (column, row) of a
    cell's corner to easting and northing. `crs`: projected, in metres. `vertical_datum`: datum of the
    heights; ``""`` when unstated. `sigma_m`: standard deviation of each cell's independent error [m]; NaN for
    what is derived from the heights, such as a slope.
    """

    sigma_m: float = float("nan")

    def window(self, bounds: tuple[float, float, float, float]) -> Self:
        """Return the cells whose centres lie within the bounds, with the same noise.

        `bounds` (4,): west, south, east and north [m].
        """
        return replace(super().window(bounds), sigma_m=self.sigma_m)


def satellite_copy(
    dem: Dem, *, rng: np.random.Generator, cell_m: float = 75.0, sigma_m: float = 1.0
) -> SatelliteDem:
    """Return the block means of a DEM with white noise: 8 × 8 cells on 600 m by default.

    When the DEM's outer nodes are a whole number of coarse cells apart (601 × 601 nodes at
    1 m), the coarse cells run from node to node and the outermost nodes count by half;
    otherwise they run between the outer edges of the DEM's cells.

    Parameters
    ----------
    dem : Dem
        The terrain.
    rng : numpy.random.Generator
        Source of the noise.
    cell_m : float
        Width of a coarse cell [m].
    sigma_m : float
        Standard deviation of the noise, independent from cell to cell [m].

    Returns
    -------
    SatelliteDem
        In the same CRS and vertical datum. A cell is empty when less than half of it is known.

    Raises
    ------
    InputError
        Cells that do not divide the terrain, finer than it, or fewer than 2 × 2; negative noise.

    Notes
    -----
    Errors of real satellite products are correlated over kilometres and depend on slope and
    snow; white noise is the paper's simplification.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> flat = Dem.on(Grid((0.0, 0.0, 600.0, 600.0), 5.0), np.full((121, 121), 7.0))
    >>> copy = satellite_copy(flat, rng=np.random.default_rng(1), sigma_m=0.0)
    >>> copy.shape, copy.bounds, float(copy.elevation.max())
    ((8, 8), (0.0, 0.0, 600.0, 600.0), 7.0)
    """
    if not (np.isfinite(sigma_m) and sigma_m >= 0.0):
        raise InputError(f"the satellite's noise is {sigma_m} m; it must be 0 or greater.")
    xmin, ymin, xmax, ymax = _extent(dem, cell_m)
    left, _, _, top = dem.bounds
    n_columns, n_rows = round((xmax - xmin) / cell_m), round((ymax - ymin) / cell_m)
    across = _overlaps(dem.shape[1], dem.step_m, xmin - left, cell_m, n_columns)
    down = _overlaps(dem.shape[0], dem.step_m, top - ymax, cell_m, n_rows)
    known = np.isfinite(dem.elevation)
    weight = down @ known @ across.T
    total = down @ np.where(known, dem.elevation, 0.0) @ across.T
    noise = sigma_m * rng.standard_normal(weight.shape)
    mean = np.where(weight >= 0.5 - 1e-9, total / np.maximum(weight, 1e-9), np.nan) + noise
    transform = Affine(cell_m, 0.0, xmin, 0.0, -cell_m, ymax)
    return SatelliteDem(mean, transform, dem.crs, dem.vertical_datum, sigma_m)


def _extent(dem: Dem, cell_m: float) -> tuple[float, float, float, float]:
    """Return the bounds that the coarse cells divide: of the nodes, else of the cells' outer edges."""
    if not (np.isfinite(cell_m) and cell_m >= dem.step_m):
        raise InputError(
            f"a satellite cell of {cell_m} m is finer than the terrain's {dem.step_m:g} m; use a coarser one."
        )
    for bounds in (dem.grid().bounds, dem.bounds):
        counts = [(bounds[2] - bounds[0]) / cell_m, (bounds[3] - bounds[1]) / cell_m]
        if all(abs(count - round(count)) < 1e-6 and round(count) >= 2 for count in counts):
            return bounds
    xmin, ymin, xmax, ymax = dem.bounds
    raise InputError(
        f"terrain of {xmax - xmin:g} × {ymax - ymin:g} m is no whole number (two or more) of {cell_m:g} m cells; "
        "take another window or cell."
    )


def _overlaps(n_fine: int, fine_m: float, offset_m: float, coarse_m: float, n_coarse: int) -> FloatArray:
    """Return the share (n_coarse, n_fine) of each coarse cell that each fine cell fills, along one axis."""
    fine = fine_m * np.arange(n_fine)
    coarse = offset_m + coarse_m * np.arange(n_coarse)[:, None]
    overlap = np.minimum(fine + fine_m, coarse + coarse_m) - np.maximum(fine, coarse)
    shares: FloatArray = np.clip(overlap, 0.0, None) / coarse_m
    return shares


_MOST_CELLS = 4000


@dataclass(frozen=True)
class ProductErrors:
    """Errors of one copy of an elevation product, as they were drawn; the defaults are none.

    `offset_m`: height by which all cells are too high [m]. `tilt_m_per_km` (2,): slope of the error to the
    east and to the north, about the middle of the copy [m/km]. `shift_m` (2,): displacement of the copy to
    the east and to the north [m]. `correlated_sigma_m`, `correlation_m`: standard deviation of the error that
    neighbouring cells share, and the distance over which its correlation falls to 1/e [m]. `sigma_m`:
    standard deviation of each cell's independent error [m].

    >>> ProductErrors(offset_m=0.5).is_white
    False
    """

    offset_m: float = 0.0
    tilt_m_per_km: tuple[float, float] = (0.0, 0.0)
    shift_m: tuple[float, float] = (0.0, 0.0)
    correlated_sigma_m: float = 0.0
    correlation_m: float = 250.0
    sigma_m: float = 1.0

    @classmethod
    def drawn(cls, errors: PriorErrors, rng: np.random.Generator) -> Self:
        """Draw offset, tilt and shift of a class of products; sizes of the others are its medians."""
        offset, *others = rng.standard_normal(5).tolist()
        tilt, shift = errors.tilt_sigma_m_per_km, errors.shift_sigma_m
        return cls(
            errors.level_sigma_m * offset,
            (tilt * others[0], tilt * others[1]),
            (shift * others[2], shift * others[3]),
            errors.correlated.median_m,
            errors.correlation_m,
            errors.white.median_m,
        )

    @property
    def is_white(self) -> bool:
        """Whether cells err independently, and in no other way."""
        return replace(self, sigma_m=1.0) == ProductErrors(correlation_m=self.correlation_m)


def product_copy(
    dem: Dem,
    errors: ProductErrors,
    *,
    rng: np.random.Generator,
    cell_m: float = 75.0,
    correlated_rng: np.random.Generator | None = None,
) -> SatelliteDem:
    """Return the block means of a displaced DEM, with the errors of a product.

    `cell_m`: width of a coarse cell [m].

    >>> from survey.data.grid import Grid
    >>> flat = Dem.on(Grid((0.0, 0.0, 600.0, 600.0), 5.0), np.full((121, 121), 7.0))
    >>> high = ProductErrors(offset_m=0.5, sigma_m=0.0)
    >>> float(product_copy(flat, high, rng=np.random.default_rng(1)).elevation.mean())
    7.5
    """
    moved = dem if errors.shift_m == (0.0, 0.0) else _moved(dem, errors.shift_m)
    copy = satellite_copy(moved, rng=rng, cell_m=cell_m, sigma_m=errors.sigma_m)
    if errors.is_white:
        return copy
    elevation = copy.elevation + _common(copy, errors) + _correlated(copy, errors, correlated_rng or rng)
    return replace(copy, elevation=elevation)


def _moved(dem: Dem, shift_m: tuple[float, float]) -> Dem:
    """Return the terrain displaced to the east and to the north; unknown cells stay unknown."""
    east, north = shift_m
    by = (-north / dem.step_m, east / dem.step_m)
    known = np.isfinite(dem.elevation)
    filled = np.where(known, dem.elevation, np.nanmean(dem.elevation))
    moved = shifted_array(filled, by, order=1, mode="nearest")
    return replace(dem, elevation=np.where(known, moved, np.nan))


def _common(copy: Dem, errors: ProductErrors) -> FloatArray:
    x, y = np.meshgrid(copy.x - copy.x.mean(), copy.y - copy.y.mean())
    east, north = errors.tilt_m_per_km
    total: FloatArray = errors.offset_m + 1e-3 * (east * x + north * y)
    return total


def _correlated(copy: Dem, errors: ProductErrors, rng: np.random.Generator) -> FloatArray:
    if errors.correlated_sigma_m == 0.0:
        return np.zeros(copy.shape)
    if copy.elevation.size > _MOST_CELLS:
        raise InputError(
            f"the satellite has {copy.elevation.size} cells, and correlated errors are drawn for at most {_MOST_CELLS}; "
            "set coarser cells."
        )
    factor = np.linalg.cholesky(
        correlation(copy.xy, errors.correlation_m) + 1e-9 * np.eye(copy.elevation.size)
    )
    drawn: FloatArray = errors.correlated_sigma_m * (factor @ rng.standard_normal(copy.elevation.size))
    return drawn.reshape(copy.shape)


_LEAST_CELLS = 5


def smooth_interpolation(coarse: Dem, grid: Grid) -> Dem:
    r"""Return the smooth surface whose mean over each coarse cell is that cell's value.

    Along each axis a quartic spline F runs through the heights summed up to each cell edge;
    its derivative is a cubic spline f with continuous second derivative and

    .. math::  \frac{1}{d} \int_{x_i}^{x_i + d} f(x) \, dx = \frac{F(x_i + d) - F(x_i)}{d} = z_i .

    The surface is the product of both axes. It rises above the highest cell and falls below
    the lowest one, as the terrain does whose means they are.

    `coarse`: cell means [m], without nodata; a margin of two or more cells around the grid keeps the free
    ends of the splines away from it.

    A step in the terrain makes the surface swing beside it (Gibbs). What is smaller than a
    cell cannot come back.

    >>> x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    >>> coarse = Dem.on(Grid((0.0, 0.0, 5.0, 4.0), 1.0), x + 2.0 * y)
    >>> smooth_interpolation(coarse, Grid((1.0, 1.0, 2.0, 2.0), 0.5)).elevation[0]
    array([5. , 5.5, 6. ])
    """
    same_crs(coarse.crs, grid.crs, "the coarse cells and the grid")
    _check_cells(coarse, grid)
    left, _, _, top = coarse.bounds
    along_x = _mean_preserving(coarse.elevation.T, coarse.step_m, grid.x - left).T
    return Dem.on(grid, _mean_preserving(along_x, coarse.step_m, top - grid.y), coarse.vertical_datum)


def _mean_preserving(cells: FloatArray, width_m: float, places_m: FloatArray) -> FloatArray:
    """Evaluate the mean-preserving spline of each column of cells at distances from the first edge."""
    # Distances in cells and sums about the first cell keep the arithmetic near 1.
    base = cells[:1]
    edges = np.arange(len(cells) + 1.0)
    sums = np.vstack([np.zeros_like(base), np.cumsum(cells - base, axis=0)])
    values: FloatArray = make_interp_spline(edges, sums, k=4).derivative()(places_m / width_m)
    return values + base


def _check_cells(coarse: Dem, grid: Grid) -> None:
    n_empty = int(np.isnan(coarse.elevation).sum())
    if n_empty:
        raise InputError(
            f"{n_empty} of the coarse cells hold no height; choose a window without nodata or fill them first."
        )
    if min(coarse.shape) < _LEAST_CELLS:
        raise InputError(
            f"there are {coarse.shape[0]} × {coarse.shape[1]} coarse cells; at least {_LEAST_CELLS} × {_LEAST_CELLS} are needed."
        )
    inner, outer, slack = grid.bounds, coarse.bounds, 1e-6 * coarse.step_m
    if any(i < o - slack for i, o in zip(inner[:2], outer[:2], strict=True)) or any(
        i > o + slack for i, o in zip(inner[2:], outer[2:], strict=True)
    ):
        raise InputError(
            f"the grid {inner} reaches beyond the coarse cells {tuple(round(o, 2) for o in outer)}; widen the window of cells."
        )
