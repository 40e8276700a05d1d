"""Synthetic terrain from shapes: hills, cosines, waves on a slope, midpoint displacement."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.terrain.random_fields import (
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

    Parameters
    ----------
    grid : Grid
        Where the heights are wanted.
    rng : numpy.random.Generator
        Source of the draws, which do not depend on the grid's step.
    relief_m : float
        Highest minus lowest node [m]; the lowest is at 0.
    n_hills : int
        Number of hills; their tops lie anywhere on the site, their heights are in the
        ratio 0.2 to 1.
    radius_m : (2,) tuple of float
        Least and largest standard deviation of a hill [m].

    Returns
    -------
    Dem
        On the grid, above an unstated datum.

    Raises
    ------
    InputError
        No hills, radii that are not positive or not in order.

    Examples
    --------
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

    Parameters
    ----------
    grid : Grid
        Nodes of the terrain.
    rng : numpy.random.Generator
        For the draw.
    relief_m : float
        Difference between the highest and the lowest node [m].
    order : int
        Highest number of half waves across the site, at least 1.

    Returns
    -------
    Dem
        On the grid, above an unstated datum.

    Examples
    --------
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

    Parameters
    ----------
    grid : Grid
        Nodes of the terrain.
    rng : numpy.random.Generator
        For the draw.
    relief_m : float
        Difference between the highest and the lowest node [m].
    n_waves : int
        Number of waves, at least 1; together they are as high as the plane falls across the site.
    wavelength_m : (2,) tuple of float
        Shortest and longest wave [m].

    Returns
    -------
    Dem
        On the grid, above an unstated datum.

    Examples
    --------
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

    Parameters
    ----------
    grid : Grid
        Nodes of the terrain.
    rng : numpy.random.Generator
        For the draw.
    relief_m : float
        Difference between the highest and the lowest node [m].
    roughness : float
        Size of the displacements at one level divided by that at the level before,
        between 0 (smooth) and 1 (rough), both excluded.

    Returns
    -------
    Dem
        On the grid, above an unstated datum.

    Notes
    -----
    The square that is divided has 2ⁿ steps and covers the grid from its south-west corner.
    Halving the step of a grid keeps the nodes that there were before. The method leaves
    creases along the axes: it is no stationary field.

    Examples
    --------
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
