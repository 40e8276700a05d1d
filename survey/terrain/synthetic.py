"""Synthetic terrain: hills, cosines, waves on a slope, midpoint displacement, random fields by name, ice micro-relief.

The hummocks of bare glacier ice are relief too small for any satellite. Their numbers come from four 200 m profiles of
drone photogrammetry, 1 m apart, that leave the weather station S5 on the Greenland ice sheet in the directions 90°, 120°,
150° and 186° (6 September 2019; van Tiggelen et al., 2021, The Cryosphere 15, 2601, data under the MIT licence in
github.com/mvantiggelen/TC_2020). After the published high-pass at 35 m:

=============================  =====  =====  =====  =====
direction (from north) [deg]     90    120    150    186
standard deviation [m]         0.276  0.603  0.616  0.450
sd of the slope over 1 m       0.114  0.200  0.239  0.172
skewness                       -0.33   0.03  -0.21  -0.22
first zero of the correlation    5 m    6 m    6 m    5 m
=============================  =====  =====  =====  =====

An anisotropic Matérn field of smoothness 3/2 was fitted to their spectra between 4 m and 29 m by Whittle's likelihood
(`python -m benchmarks.ice_micro_relief` repeats it). A free smoothness comes out at 1.54; without anisotropy the
log-likelihood is 18 lower. The skewness is not different from 0.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import quad

from survey.core import ConfigError, FloatArray, InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.gp.kernels import Matern32
from survey.terrain.random_fields import (
    fractional_brownian,
    matern_field,
    require_resolved,
    spectral_field,
    squared_exponential_field,
    with_relief,
)


def gaussian_hills(
    grid: Grid,
    rng: np.random.Generator,
    *,
    relief_m: float = 25.0,
    n_hills: int = 15,
    radius_m: tuple[float, float] = (80.0, 160.0),
) -> Dem:
    """Draw a sum of round Gaussian hills.

    `relief_m`: highest minus lowest node [m]; the lowest is at 0. `radius_m` (2,): least and largest standard
    deviation of a hill [m].

    >>> gaussian_hills(Grid((0.0, 0.0, 600.0, 600.0), 20.0), np.random.default_rng(1)).relief_m
    25.0
    """
    if n_hills < 1 or not 0.0 < radius_m[0] <= radius_m[1]:
        raise InputError(
            f"{n_hills} hills of radius {radius_m} m were asked for; at least one, and a rising positive pair, are needed."
        )
    xmin, ymin, xmax, ymax = grid.bounds
    tops = rng.uniform((xmin, ymin), (xmax, ymax), (n_hills, 2))
    radii = rng.uniform(*radius_m, n_hills)
    sizes = rng.uniform(0.2, 1.0, n_hills)
    along_x = np.exp(-0.5 * ((grid.x - tops[:, :1]) / radii[:, None]) ** 2)
    along_y = np.exp(-0.5 * ((grid.y - tops[:, 1:]) / radii[:, None]) ** 2)
    return with_relief(grid, (along_y.T * sizes) @ along_x, relief_m)


def cosine_surface(grid: Grid, rng: np.random.Generator, *, relief_m: float = 25.0, order: int = 3) -> Dem:
    r"""Draw a low-order cosine series over the site.

    .. math::  z(u, v) = \sum_{0 < p + q;\ p, q \le order} \frac{a_{pq}}{\sqrt{p^2 + q^2}}
               \cos(\pi p u) \cos(\pi q v), \qquad a_{pq} \sim N(0, 1)

    with u and v running from 0 to 1 across the site. The weights are our choice.

    `relief_m`: difference between the highest and the lowest node [m].

    >>> cosine_surface(Grid((0.0, 0.0, 600.0, 600.0), 20.0), np.random.default_rng(1)).relief_m
    25.0
    """
    if order < 1:
        raise InputError(f"the order of the cosine series is {order}; at least 1 is needed.")
    half_waves = np.arange(order + 1)
    size = np.hypot(half_waves[:, None], half_waves[None, :])
    size[0, 0] = np.inf
    coefficients = rng.standard_normal(size.shape) / size
    u, v = _unit_coordinates(grid)
    return with_relief(
        grid,
        np.cos(np.pi * np.outer(v, half_waves)) @ coefficients @ np.cos(np.pi * np.outer(half_waves, u)),
        relief_m,
    )


def slope_and_waves(
    grid: Grid,
    rng: np.random.Generator,
    *,
    relief_m: float = 25.0,
    n_waves: int = 6,
    wavelength_m: tuple[float, float] = (200.0, 400.0),
) -> Dem:
    """Draw a plane with sinusoidal waves of random direction.

    `relief_m`: difference between the highest and the lowest node [m]. `wavelength_m` (2,): shortest and
    longest wave [m].

    >>> slope_and_waves(Grid((0.0, 0.0, 600.0, 600.0), 20.0), np.random.default_rng(1)).relief_m
    25.0
    """
    if n_waves < 1 or not 0.0 < wavelength_m[0] <= wavelength_m[1]:
        raise InputError(
            f"{n_waves} waves of {wavelength_m} m were asked for; at least one, and a rising positive pair, are needed."
        )
    fall_direction = rng.uniform(0.0, 2.0 * np.pi)
    directions = rng.uniform(0.0, 2.0 * np.pi, n_waves)
    numbers = 2.0 * np.pi / rng.uniform(*wavelength_m, n_waves)
    phases = rng.uniform(0.0, 2.0 * np.pi, n_waves)
    u, v = _unit_coordinates(grid)
    plane = np.cos(fall_direction) * u[None, :] + np.sin(fall_direction) * v[:, None]
    waves = np.zeros(grid.shape)
    for direction, number, phase in zip(directions, numbers, phases, strict=True):
        along = np.cos(direction) * grid.x[None, :] + np.sin(direction) * grid.y[:, None]
        waves += np.sin(number * along + phase)
    return with_relief(grid, plane + waves / n_waves, relief_m)


def diamond_square(
    grid: Grid, rng: np.random.Generator, *, relief_m: float = 25.0, roughness: float = 0.5
) -> Dem:
    """Draw terrain by midpoint displacement [Fournier, Fussell and Carpenter, 1982].

    `relief_m`: difference between the highest and the lowest node [m].

    The square that is divided has 2ⁿ steps and covers the grid from its south-west corner.
    Halving the step of a grid keeps the nodes that there were before. The method leaves
    creases along the axes: it is no stationary field.

    >>> diamond_square(Grid((0.0, 0.0, 60.0, 60.0), 2.0), np.random.default_rng(1)).relief_m
    25.0
    """
    if not 0.0 < roughness < 1.0:
        raise InputError(f"the roughness is {roughness}; a number between 0 and 1 was expected.")
    levels = int(np.ceil(np.log2(max(grid.shape) - 1)))
    heights = rng.standard_normal((2, 2))
    for level in range(1, levels + 1):
        heights = _divided(heights, rng, roughness**level)
    rows, columns = grid.shape
    return with_relief(grid, heights[-rows:, :columns], relief_m)


def _divided(coarse: FloatArray, rng: np.random.Generator, size: float) -> FloatArray:
    """Halve the cells of a square: the centres from four corners, then the sides from their neighbours."""
    n = len(coarse) - 1
    fine = np.zeros((2 * n + 1, 2 * n + 1))
    fine[::2, ::2] = coarse
    corners = coarse[:-1, :-1] + coarse[1:, :-1] + coarse[:-1, 1:] + coarse[1:, 1:]
    fine[1::2, 1::2] = corners / 4.0 + size * rng.standard_normal((n, n))
    total = np.zeros_like(fine)
    count = np.zeros_like(fine)
    for axis in (0, 1):
        for there, here in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
            to = (here, slice(None)) if axis == 0 else (slice(None), here)
            source = (there, slice(None)) if axis == 0 else (slice(None), there)
            total[to] += fine[source]
            count[to] += 1.0
    for sides in ((slice(1, None, 2), slice(None, None, 2)), (slice(None, None, 2), slice(1, None, 2))):
        shape = fine[sides].shape
        fine[sides] = total[sides] / count[sides] + size * rng.standard_normal(shape)
    return fine


def _unit_coordinates(grid: Grid) -> tuple[FloatArray, FloatArray]:
    """Return the columns from west (0) to east (1) and rows from south (0) to north (1), in row order."""
    xmin, ymin, xmax, ymax = grid.bounds
    return (grid.x - xmin) / (xmax - xmin), (grid.y - ymin) / (ymax - ymin)


_FAMILIES: dict[str, Callable[..., Dem]] = {
    "squared-exponential": squared_exponential_field,
    "matern-3/2": partial(matern_field, nu=1.5),
    "matern-5/2": partial(matern_field, nu=2.5),
    "gaussian_hills": gaussian_hills,
    "cosine_surface": cosine_surface,
    "diamond_square": diamond_square,
    "fractional_brownian": fractional_brownian,
    "slope_and_waves": slope_and_waves,
}


def random_dem(
    family: str, grid: Grid, rng: np.random.Generator, relief_m: float = 25.0, **parameters: Any
) -> Dem:
    """Draw terrain of a named family.

    Parameters
    ----------
    family : str
        ``squared-exponential``, ``matern-3/2``, ``matern-5/2``, ``gaussian_hills``,
        ``cosine_surface``, ``diamond_square``, ``fractional_brownian`` or ``slope_and_waves``.
    grid : Grid
        Where the heights are wanted.
    rng : numpy.random.Generator
        Source of the draws.
    relief_m : float
        Highest minus lowest node [m].
    **parameters
        Of that family's function, e.g. ``length_scale_m=220.0``.

    Returns
    -------
    Dem
        On the grid, above an unstated datum.

    Raises
    ------
    ConfigError
        An unknown family.
    InputError
        A parameter out of its range.

    Examples
    --------
    >>> grid = Grid((0.0, 0.0, 600.0, 600.0), 25.0)
    >>> random_dem("matern-5/2", grid, np.random.default_rng(1), length_scale_m=150.0).relief_m
    25.0
    """
    if family not in _FAMILIES:
        raise ConfigError(
            f"the terrain family {family!r} is not known; one of {', '.join(_FAMILIES)} was expected."
        )
    return _FAMILIES[family](grid, rng, relief_m=relief_m, **parameters)


LONGEST_WAVE_M = 35.0
"""Where the published profiles were high-passed [m]."""
ALONG_CRESTS_M = 18.5
"""Length scale along the crests of the hummocks [m]."""
ACROSS_CRESTS_M = 7.78
"""Length scale across the crests [m]."""
CREST_AZIMUTH_DEG = 65.0
"""Direction of the crests, clockwise from north [deg]."""
_UNFILTERED_SD_M = 1.192
"""Of the fitted field with all of its long waves, of which the filtered profiles say nothing [m]."""


def _share_of_short_waves() -> float:
    """Return the share of the fitted field's variance in waves shorter than the longest (any direction)."""
    cut = 2.0 * np.pi / LONGEST_WAVE_M
    area = ALONG_CRESTS_M * ACROSS_CRESTS_M

    def beyond(angle: float) -> float:
        squared = (ALONG_CRESTS_M * np.cos(angle)) ** 2 + (ACROSS_CRESTS_M * np.sin(angle)) ** 2
        return float(area / squared * (1.0 + cut**2 * squared / 3.0) ** -1.5)

    return float(quad(beyond, 0.0, 2.0 * np.pi)[0] / (2.0 * np.pi))


_SHARE = _share_of_short_waves()
MEASURED_SD_M = round(_UNFILTERED_SD_M * _SHARE**0.5, 2)
"""Standard deviation of the fitted field's waves shorter than 35 m [m]."""


def ice_micro_relief(
    grid: Grid,
    rng: np.random.Generator,
    *,
    sd_m: float = MEASURED_SD_M,
    crest_azimuth_deg: float = CREST_AZIMUTH_DEG,
) -> FloatArray:
    r"""Draw the micro-relief of bare ice, to be added to a smooth surface.

    A Gaussian field with the spectrum of an anisotropic Matérn 3/2 covariance (length
    scales 18.5 m along and 7.8 m across the crests), without waves longer than 35 m.
    A straight profile through it, high-passed at 35 m, has the spectrum of one through
    the whole Matérn field: a wave that is shorter than 35 m along a line is so on the ground.

    Parameters
    ----------
    grid : Grid
        Where the heights are wanted; steps of 5 m or less.
    rng : numpy.random.Generator
        Source of the draws.
    sd_m : float
        Standard deviation of the heights over many draws [m]. Straight profiles after the
        35 m high-pass show less of it: at the default 0.3 m near the crests' direction and
        0.55 m across, as measured, for waves that meet the line at an angle look longer.
    crest_azimuth_deg : float
        Direction of the crests, clockwise from north [deg].

    Returns
    -------
    (H, W) ndarray
        Height above the smooth surface [m], mean 0 over many draws, not of each.

    Raises
    ------
    InputError
        A standard deviation that is negative or not finite, or a grid too coarse for the waves.

    Notes
    -----
    One place at the end of one melt season stands behind the numbers. The relief between 35 m
    and a satellite's cell, crevasses and melt channels are not in them.

    Examples
    --------
    >>> grid = Grid((0.0, 0.0, 200.0, 200.0), 1.0)
    >>> ice_micro_relief(grid, np.random.default_rng(1), sd_m=0.5).shape
    (201, 201)
    """
    if not (np.isfinite(sd_m) and sd_m >= 0.0):
        raise InputError(f"the micro-relief's standard deviation is {sd_m} m; it must be 0 or greater.")
    kernel = Matern32(
        1.0 / _SHARE, ALONG_CRESTS_M, ALONG_CRESTS_M / ACROSS_CRESTS_M, 90.0 - crest_azimuth_deg
    )
    cut = 2.0 * np.pi / LONGEST_WAVE_M

    def short_waves(omega: FloatArray) -> FloatArray:
        return np.where((omega**2).sum(axis=-1) >= cut**2, kernel.spectral_density(omega), 0.0)

    heights, variance = spectral_field(grid, rng, short_waves, padding_m=4.0 * LONGEST_WAVE_M)
    require_resolved(grid, variance, ACROSS_CRESTS_M)
    return sd_m * heights
