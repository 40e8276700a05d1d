"""Surveys of windows of real ground: what was measured, the nodes to map, their heights, and a coarse prior.

Lines run along x on even and along y on odd windows, from the fence inward by half a spacing, with a sample each 40th of
the side. Landmarks lie within a band about lines, less often and less precisely the farther off, as a rover's cameras see
them; ground points lie anywhere, as those of a lidar.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from affine import Affine

from benchmarks.landmarks import FARTHEST_M
from benchmarks.promise_on_real_ground.windows import SEED, site_of, windows
from survey import Dem, Grid
from survey.core.arrays import Bounds, FloatArray
from survey.core.streams import stream

LINES = {"side/4": 4, "side/8": 8, "side/16": 16}
"""Number of lines of each density, named by the distance between them."""
SCATTERED = ("landmarks", "ground points")
NOISE_M = 0.1
N_STEPS, N_NODES = 40, 80
"""Steps between samples along a line, and between nodes of a map, in one side."""
N_LANDMARKS, N_GROUND_POINTS = 1000, 2000
WHITE_M, DATUM_M = 1.0, 0.5
"""Errors of the priors: of each cell, and common to all."""
_N_SUBCELLS = 10


@dataclass(frozen=True)
class Survey:
    """Places (N, 2), heights and their standard deviations (N,), the nodes, their heights (M,), and the prior [m]."""

    xy: FloatArray
    z: FloatArray
    sigma_m: FloatArray
    grid: Grid
    truth: FloatArray
    prior: Dem


class Samples(NamedTuple):
    """Places (N, 2) and standard deviations (N,) of samples [m]."""

    xy: FloatArray
    sigma_m: FloatArray


def survey_of(landscape: str, index: int, kind: str) -> Survey:
    """Return a survey of a window: lines of one density, landmarks or ground points."""
    site, bounds = site_of(landscape, index), windows(landscape)[index]
    rng = stream(SEED, "gridders", landscape, index, kind)
    samples = samples_of(kind, site.area.bounds, rng, along_y=index % 2 == 1)
    z = site.terrain.at(samples.xy) + samples.sigma_m * rng.standard_normal(len(samples.xy))
    xmin, _, xmax, _ = site.area.bounds
    grid = Grid(site.area.bounds, (xmax - xmin) / N_NODES, site.terrain.crs)
    prior = block_means(site.terrain, bounds, stream(SEED, "blocks", landscape, index))
    return Survey(samples.xy, z, samples.sigma_m, grid, site.terrain.at(grid.xy), prior)


def samples_of(kind: str, square: Bounds, rng: np.random.Generator, *, along_y: bool) -> Samples:
    """Return the samples of a survey of a square, along x or y."""
    side_m = square[2] - square[0]
    if kind in LINES:
        at = _lines(LINES[kind], side_m)
        sigma_m = np.full(len(at), NOISE_M)
    elif kind == "landmarks":
        at, sigma_m = _landmarks(side_m, rng)
    else:
        at, sigma_m = rng.uniform(0.0, side_m, (N_GROUND_POINTS, 2)), np.full(N_GROUND_POINTS, NOISE_M)
    return Samples(np.array(square[:2]) + (at[:, ::-1] if along_y else at), sigma_m)


def _lines(n: int, side_m: float) -> FloatArray:
    """Return places (N, 2) along and across lines [m]."""
    along = np.linspace(0.0, side_m, N_STEPS + 1)
    across = side_m / n * (np.arange(n) + 0.5)
    return np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)


def _landmarks(side_m: float, rng: np.random.Generator) -> Samples:
    """Return places (N, 2) along and across lines, and standard deviations (N,) that grow with the range [m]."""
    n, n_lines = 4 * N_LANDMARKS, LINES["side/4"]
    line, start = rng.integers(0, n_lines, n), rng.uniform(0.0, side_m, n)
    range_m, bearing = 0.8 + rng.gamma(1.5, 6.0, n), rng.uniform(-1.2, 1.2, n)
    across = side_m / n_lines * (line + 0.5) + rng.choice((-1.0, 1.0), n) * range_m * np.cos(bearing)
    at = np.stack([start + range_m * np.sin(bearing), across], axis=-1)
    inside = ((at >= 0.0) & (at <= side_m)).all(axis=1) & (range_m < FARTHEST_M)
    seen = np.flatnonzero(inside)[:N_LANDMARKS]
    return Samples(at[seen], np.minimum(0.05 + 0.01 * range_m[seen], 0.5))


def block_means(terrain: Dem, bounds: Bounds, rng: np.random.Generator) -> Dem:
    """Return means over cells of 30 m, or of 15 m below a side of 300 m, with their errors."""
    west, _, east, north = bounds
    cell_m = 30.0 if round(east - west) >= 300 else 15.0
    n = round((east - west) / cell_m)
    middle = cell_m * (np.arange(n) + 0.5)
    cells = np.stack(np.meshgrid(west + middle, north - middle), axis=-1).reshape(-1, 1, 2)
    within = cell_m * ((np.arange(_N_SUBCELLS) + 0.5) / _N_SUBCELLS - 0.5)
    low, high = np.split(np.array(terrain.grid().bounds), 2)
    shown = np.clip(cells + np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2), low, high)
    means = terrain.at(shown.reshape(-1, 2)).reshape(n * n, -1).mean(axis=1)
    errors = WHITE_M * rng.standard_normal(n * n) + DATUM_M * rng.standard_normal()
    return Dem((means + errors).reshape(n, n), Affine(cell_m, 0.0, west, 0.0, -cell_m, north), terrain.crs)
