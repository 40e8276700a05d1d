"""Kinds of terrain that maps are judged on, none of which is drawn from the estimator's own prior alone."""

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.crs import projected_crs
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.gp.kernels import Matern32, SquaredExponential
from survey.terrain import diamond_square, fractional_brownian, real_sample, smooth_interpolation
from survey.terrain.random_fields import kernel_field

CRS = projected_crs("EPSG:32608", "the benchmark")
SIDE_M, CELL_M, STEP_M, MARGIN_M = 480.0, 60.0, 2.0, 60.0
WIDE = Grid((-MARGIN_M, -MARGIN_M, SIDE_M + MARGIN_M, SIDE_M + MARGIN_M), STEP_M, CRS)
DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[3] / "shared" / "data"))
_LIDAR = ("dem_slovenia_lidar_1m/TM1_564_146.tif", "dem_landlab_repeat_and_lidar/pre_runout_DEM.asc")


def terrain(kind: str, seed: int) -> Dem:
    """Return the terrain of a kind and seed, 60 m beyond the site of 480 m, with 25 m of relief unless it is real."""
    rng = stream(seed, "honesty", "terrain", kind)
    heights = _KINDS[kind](rng)
    return Dem.on(WIDE, heights)


def _relief(heights: FloatArray, relief_m: float = 25.0) -> FloatArray:
    scaled: FloatArray = (heights - heights.min()) * (relief_m / np.ptp(heights))
    return scaled


def _field(rng: np.random.Generator, *kernels: SquaredExponential | Matern32) -> FloatArray:
    total: FloatArray = np.sum([kernel_field(WIDE, rng, kernel) for kernel in kernels], axis=0)
    return total


def _ridges(rng: np.random.Generator) -> FloatArray:
    """Draw a field ten times longer along a random direction than across."""
    kernel = SquaredExponential(1.0, 250.0, 10.0, float(rng.uniform(0.0, 180.0)))
    return _relief(_field(rng, kernel), 15.0)


def _moraines(rng: np.random.Generator) -> FloatArray:
    """Draw curved ridges with sharp crests on a slope: the distance from a bent line, folded."""
    heading = rng.uniform(0.0, np.pi)
    along, across = _turned(heading)
    bent = across + 0.0006 * rng.normal() * along**2 + 12.0 * np.sin(along / 90.0 + rng.uniform(0.0, 6.0))
    heights = 0.02 * across
    for _ in range(4):
        offset = rng.uniform(-0.6, 0.6) * SIDE_M
        heights = heights + rng.uniform(3.0, 8.0) * np.exp(-np.abs(bent - offset) / rng.uniform(8.0, 18.0))
    return heights + 0.3 * _field(rng, SquaredExponential(1.0, 30.0))


def _turned(heading: float) -> tuple[FloatArray, FloatArray]:
    """Return coordinates along and across a heading about the middle of the site [m]."""
    x, y = (WIDE.xy - 0.5 * SIDE_M).T.reshape(2, *WIDE.shape)
    return np.cos(heading) * x + np.sin(heading) * y, np.cos(heading) * y - np.sin(heading) * x


def _hummocks(rng: np.random.Generator) -> FloatArray:
    return _relief(_field(rng, SquaredExponential(25.0, 150.0), SquaredExponential(2.0, 20.0)))


def _terraces(rng: np.random.Generator) -> FloatArray:
    """Draw smooth ground cut into steps of 4 m that are 10 m wide."""
    smooth = _relief(_field(rng, SquaredExponential(1.0, 170.0)))
    step = smooth / 4.0
    return 4.0 * (np.floor(step) + 1.0 / (1.0 + np.exp(-12.0 * (step - np.floor(step) - 0.5))))


def _cliff(rng: np.random.Generator) -> FloatArray:
    """Draw smooth ground with a scarp of 8 m across the site."""
    _, across = _turned(rng.uniform(0.0, np.pi))
    scarp = 8.0 / (1.0 + np.exp(-(across - rng.uniform(-80.0, 80.0)) / 3.0))
    return scarp + _relief(_field(rng, SquaredExponential(1.0, 180.0)), 15.0)


def _half_and_half(rng: np.random.Generator) -> FloatArray:
    """Draw smooth ground on one side of the site and hummocks of 1.5 m on the other."""
    _, across = _turned(rng.uniform(0.0, np.pi))
    share = 1.0 / (1.0 + np.exp(-across / 15.0))
    rough = 1.5 * _field(rng, SquaredExponential(1.0, 18.0))
    return _relief(_field(rng, SquaredExponential(1.0, 200.0)), 20.0) + share * rough


def _lidar(rng: np.random.Generator) -> FloatArray:
    """Cut a window out of one of two lidar models, turned by a multiple of 90 degrees."""
    return np.rot90(_window(_lidar_model(int(rng.integers(2))), rng), int(rng.integers(4)))


@lru_cache(maxsize=2)
def _lidar_model(which: int) -> Dem:
    dem = Dem.read(DATA / _LIDAR[which], crs=None if which == 0 else "EPSG:32610")
    return dem if dem.step_m >= STEP_M else dem.block_mean(STEP_M)


def _window(dem: Dem, rng: np.random.Generator) -> FloatArray:
    """Return heights at the nodes of a window without nodata."""
    size = WIDE.bounds[2] - WIDE.bounds[0]
    west, south, east, north = dem.grid().bounds
    for _ in range(1000):
        x, y = rng.uniform(west, east - size), rng.uniform(south, north - size)
        heights = dem.at(WIDE.xy - WIDE.bounds[:2] + [x, y]).reshape(WIDE.shape)
        if np.isfinite(heights).all():
            return heights
    raise ValueError("no window of the lidar model is free of nodata")


def _srtm(rng: np.random.Generator) -> FloatArray:
    """Interpolate a window of the real sample smoothly, with micro-relief of 0.3 m."""
    dem, n = real_sample(), 16
    while True:
        row, column = (int(rng.integers(size - n)) for size in dem.shape)
        cells = dem.elevation[row : row + n, column : column + n]
        if np.isfinite(cells).all() and 8.0 < np.ptp(cells[4:12, 4:12]) < 120.0:
            break
    place = Grid((-360.0, -360.0, 765.0, 765.0), 75.0, CRS)
    smooth = smooth_interpolation(Dem.on(place, cells), WIDE).elevation
    return smooth + 0.3 * _field(rng, SquaredExponential(1.0, 6.0))


_KINDS: dict[str, Callable[[np.random.Generator], FloatArray]] = {
    "squared exponential": lambda rng: _relief(_field(rng, SquaredExponential(1.0, 140.0))),
    "Matern": lambda rng: _relief(_field(rng, Matern32(1.0, 150.0))),
    "fBm": lambda rng: fractional_brownian(WIDE, rng).elevation,
    "diamond-square": lambda rng: diamond_square(WIDE, rng).elevation,
    "hummocks": _hummocks,
    "terraces": _terraces,
    "cliff": _cliff,
    "anisotropic ridges": _ridges,
    "moraine ridges": _moraines,
    "half and half": _half_and_half,
    "lidar windows": _lidar,
    "SRTM windows": _srtm,
}
KINDS = tuple(_KINDS)
"""Names of the kinds."""
