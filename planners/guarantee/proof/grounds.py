"""Simulated ground that is not drawn from the covariance that a guarantee rests on.

Three kinds, each corrected so that it agrees with the cells of the prior:

- heavy tails: a field of the covariance times a Student factor of four degrees of freedom, one for each surface;
- changing roughness: a field of the covariance whose amplitude changes from place to place by a factor of about 1.5;
- resampled relief: the prior's own relief, shrunk to half, a quarter, … of its size and laid over itself, which has
  ridges, gullies and flats where a Gaussian field has none.
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from survey.core.arrays import FloatArray
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.gp.kernels import SquaredExponential, Stationary
from survey.terrain.random_fields import CoarseCells, ConditionalTerrain, kernel_field

_FREEDOM = 4.0
_LOG_AMPLITUDE = 0.4
_N_OCTAVES = 4

Ground = Callable[[ConditionalTerrain, Stationary, np.random.Generator], Dem]
"""Draws one surface on the nodes of a conditional terrain."""


def heavy_tailed(world: ConditionalTerrain, kernel: Stationary, rng: np.random.Generator) -> Dem:
    """Draw a field of the covariance times a Student factor."""
    factor = np.sqrt((_FREEDOM - 2.0) / rng.chisquare(_FREEDOM))
    return world.conditioned(Dem.on(world.wide, factor * kernel_field(world.wide, rng, kernel)), rng)


def changing(world: ConditionalTerrain, kernel: Stationary, rng: np.random.Generator) -> Dem:
    """Draw a field of the covariance whose amplitude changes from place to place."""
    xmin, ymin, xmax, ymax = world.wide.bounds
    slow = SquaredExponential(_LOG_AMPLITUDE**2, 0.25 * max(xmax - xmin, ymax - ymin))
    amplitude = np.exp(kernel_field(world.wide, rng, slow) - _LOG_AMPLITUDE**2)
    return world.conditioned(Dem.on(world.wide, amplitude * kernel_field(world.wide, rng, kernel)), rng)


def resampled(world: ConditionalTerrain, kernel: Stationary, rng: np.random.Generator) -> Dem:
    """Lay shrunk copies of the prior's relief over one another, as rough as the covariance over half a cell."""
    relief = _relief(world.cells)
    heights = np.zeros(world.wide.shape)
    # Copies of half the size have the amplitude that the smoothness of the covariance asks for.
    smoothness = 0.5 * ((kernel.error_growth or 3.0) - 1.0)
    for octave in range(1, _N_OCTAVES + 1):
        heights += 2.0 ** (-smoothness * octave) * _shrunk(relief, world, 2.0**octave, rng)
    lag_m = 0.5 * world.cells.prior.step_m
    n = max(round(lag_m / world.wide.step_m), 1)
    found = np.mean(np.square(heights[n:] - heights[:-n]))
    lag = np.array([n * world.wide.step_m, 0.0])
    wanted = 2.0 * (kernel.variance_m2 - float(kernel.covariance_of_lag(lag)))
    factor = np.sqrt(wanted / found) if found > 0.0 else 0.0
    return world.conditioned(Dem.on(world.wide, factor * heights), rng)


RESAMPLED = "resampled relief"
"""Name of the ground that repeats the relief of the prior."""

GROUNDS: dict[str, Ground] = {
    "heavy tails": heavy_tailed,
    "changing roughness": changing,
    RESAMPLED: resampled,
}
"""Kinds of simulated ground by name."""


def _relief(cells: CoarseCells) -> FloatArray:
    """Return the smoothed heights (R, C) of the prior about their plane [m]; unknown cells lie on the plane."""
    prior = cells.prior
    row, column = np.indices(prior.shape)
    known = np.isfinite(prior.elevation)
    basis = np.stack([np.ones(prior.shape), row, column], axis=-1)
    plane = np.linalg.lstsq(basis[known], prior.elevation[known], rcond=None)[0]
    relief = np.where(known, prior.elevation - basis @ plane, 0.0)
    # Errors of single cells are no relief.
    smoothed: FloatArray = gaussian_filter(relief, 1.0, mode="nearest")
    return smoothed


def _shrunk(
    relief: FloatArray, world: ConditionalTerrain, times: float, rng: np.random.Generator
) -> FloatArray:
    """Return relief at the nodes, shrunk so many times, mirrored at its borders, turned and moved by chance."""
    turned = np.rot90(relief, int(rng.integers(4)))
    start = rng.uniform(0.0, 2.0, 2) * turned.shape
    per_node = times * _node_cells(world.wide, world.cells.prior)
    rows, columns = np.indices(world.wide.shape) * per_node
    shrunk: FloatArray = map_coordinates(
        turned, [rows + start[0], columns + start[1]], order=3, mode="mirror"
    )
    return shrunk


def _node_cells(grid: Grid, prior: Dem) -> float:
    """Return the distance of neighbouring nodes in cells of the prior."""
    return grid.step_m / prior.step_m
