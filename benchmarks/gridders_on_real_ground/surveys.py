"""Surveys of windows of real ground: what was measured, the nodes to map, their heights, and a coarse prior.

Lines run along x on even and along y on odd windows, from the fence inward by half a spacing, with a sample each 40th of
the side. Landmarks lie within a band about lines, less often and less precisely the farther off, as a rover's cameras see
them; ground points lie anywhere, as those of a lidar.
"""

from dataclasses import dataclass

import numpy as np
from affine import Affine

from benchmarks.landmarks import FARTHEST_M
from benchmarks.promise_on_real_ground.windows import SEED, landscape_of, site_of
from survey import Dem, Grid
from survey.core.arrays import FloatArray
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


def survey_of(landscape: str, index: int, kind: str) -> Survey:
    """Return a survey of a window: lines of one density, landmarks or ground points."""
    site = site_of(landscape, index)
    prior = block_means(
        site.terrain, landscape_of(landscape).side_m, stream(SEED, "blocks", landscape, index)
    )
    bounds, rng = site.area.bounds, stream(SEED, "gridders", landscape, index, kind)
    return measured(site.terrain, prior, *places(kind, bounds, rng, along_y=index % 2 == 1), rng)


def measured(
    terrain: Dem,
    prior: Dem,
    bounds: FloatArray,
    xy: FloatArray,
    sigma_m: FloatArray,
    rng: np.random.Generator,
) -> Survey:
    """Measure a terrain at places (N, 2) with standard deviations (N,), to be mapped within bounds [m]."""
    grid = Grid(tuple(bounds), (bounds[2] - bounds[0]) / N_NODES, terrain.crs)
    z = terrain.at(xy) + sigma_m * rng.standard_normal(len(xy))
    return Survey(xy, z, sigma_m, grid, terrain.at(grid.xy), prior)


def places(
    kind: str, bounds: tuple[float, float, float, float], rng: np.random.Generator, *, along_y: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return bounds, places (N, 2) and standard deviations (N,) of a survey of a square [m]."""
    corner, side_m = np.array(bounds[:2]), bounds[2] - bounds[0]
    if kind in LINES:
        along_across, sigma_m = _lines(LINES[kind], side_m), None
    elif kind == "landmarks":
        along_across, sigma_m = _landmarks(side_m, rng)
    else:
        along_across, sigma_m = rng.uniform(0.0, side_m, (N_GROUND_POINTS, 2)), None
    xy = corner + (along_across[:, ::-1] if along_y else along_across)
    square = np.array([*corner, *(corner + side_m)])
    return square, xy, np.full(len(xy), NOISE_M) if sigma_m is None else sigma_m


def _lines(n: int, side_m: float) -> FloatArray:
    """Return places (N, 2) along and across lines [m]."""
    along = np.linspace(0.0, side_m, N_STEPS + 1)
    across = side_m / n * (np.arange(n) + 0.5)
    return np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)


def _landmarks(side_m: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return places (N, 2) along and across lines, and standard deviations (N,) that grow with the range [m]."""
    n, n_lines = 4 * N_LANDMARKS, LINES["side/4"]
    line, start = rng.integers(0, n_lines, n), rng.uniform(0.0, side_m, n)
    range_m, bearing = 0.8 + rng.gamma(1.5, 6.0, n), rng.uniform(-1.2, 1.2, n)
    across = side_m / n_lines * (line + 0.5) + rng.choice((-1.0, 1.0), n) * range_m * np.cos(bearing)
    at = np.stack([start + range_m * np.sin(bearing), across], axis=-1)
    inside = ((at >= 0.0) & (at <= side_m)).all(axis=1) & (range_m < FARTHEST_M)
    seen = np.flatnonzero(inside)[:N_LANDMARKS]
    return at[seen], np.minimum(0.05 + 0.01 * range_m[seen], 0.5)


def block_means(terrain: Dem, side_m: float, rng: np.random.Generator) -> Dem:
    """Return means over cells of 30 m, or of 15 m below a side of 300 m, with their errors."""
    cell_m = 30.0 if side_m >= 300.0 else 15.0
    west, _, _, north = terrain.bounds
    n = round(side_m / cell_m)
    middle = cell_m * (np.arange(n) + 0.5)
    cells = np.stack(np.meshgrid(west + middle, north - middle), axis=-1).reshape(-1, 1, 2)
    within = cell_m * ((np.arange(_N_SUBCELLS) + 0.5) / _N_SUBCELLS - 0.5)
    low, high = np.split(np.array(terrain.grid().bounds), 2)
    shown = np.clip(cells + np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2), low, high)
    means = terrain.at(shown.reshape(-1, 2)).reshape(n * n, -1).mean(axis=1)
    errors = WHITE_M * rng.standard_normal(n * n) + DATUM_M * rng.standard_normal()
    return Dem((means + errors).reshape(n, n), Affine(cell_m, 0.0, west, 0.0, -cell_m, north), terrain.crs)
