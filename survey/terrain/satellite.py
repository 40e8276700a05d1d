"""Satellite prior of a terrain: means over coarse cells, with noise."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from affine import Affine

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem


@dataclass(frozen=True)
class SatelliteDem(Dem):
    """A coarse DEM with the standard deviation of its cells.

    Parameters
    ----------
    elevation : (H, W) array_like
        Heights [m], row 0 in the north; NaN for nodata.
    transform : affine.Affine
        Maps (column, row) of a cell's corner to easting and northing.
    crs : str or pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        Datum of the heights; ``""`` when unstated.
    sigma_m : float
        Standard deviation of each cell's independent error [m]; NaN for what is derived
        from the heights, such as a slope.
    """

    sigma_m: float = float("nan")

    def window(self, bounds: tuple[float, float, float, float]) -> Self:
        """Return the cells whose centres lie within the bounds, with the same noise.

        Parameters
        ----------
        bounds : (4,) tuple of float
            West, south, east and north [m].

        Returns
        -------
        SatelliteDem
            The cells whose centres lie within the bounds.
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
