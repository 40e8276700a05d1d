"""Copies of a terrain with the errors of a real elevation product: offset, tilt, shift, correlated and white errors."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.ndimage import shift as shifted_array

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.prior_likelihood import correlation
from survey.terrain.satellite import SatelliteDem, satellite_copy

_MOST_CELLS = 4000


@dataclass(frozen=True)
class ProductErrors:
    """Errors of one copy of an elevation product, as they were drawn; the defaults are none.

    Parameters
    ----------
    offset_m : float
        Height by which all cells are too high [m].
    tilt_m_per_km : (2,) tuple of float
        Slope of the error to the east and to the north, about the middle of the copy [m/km].
    shift_m : (2,) tuple of float
        Displacement of the copy to the east and to the north [m].
    correlated_sigma_m, correlation_m : float
        Standard deviation of the error that neighbouring cells share, and the distance over which its correlation
        falls to 1/e [m].
    sigma_m : float
        Standard deviation of each cell's independent error [m].

    Examples
    --------
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
        """Draw offset, tilt and shift of a class of products; sizes of the others are its medians.

        Parameters
        ----------
        errors : PriorErrors
            Error model of the class.
        rng : numpy.random.Generator
            For the draw.

        Returns
        -------
        ProductErrors
            One draw.
        """
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

    Parameters
    ----------
    dem : Dem
        The terrain. What a displacement brings in from beyond its edge continues the edge.
    errors : ProductErrors
        Errors of the copy.
    rng : numpy.random.Generator
        For the white error.
    cell_m : float
        Width of a coarse cell [m].
    correlated_rng : numpy.random.Generator, optional
        For the correlated error; `rng` by default.

    Returns
    -------
    SatelliteDem
        In the same CRS and vertical datum; the same as `satellite_copy` where the errors are white.

    Raises
    ------
    InputError
        What `satellite_copy` refuses, or correlated errors of more than 4,000 cells.

    Examples
    --------
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
