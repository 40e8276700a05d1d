"""Elevation pyramid: a raster at halved resolutions, and heights at places."""

import math
from contextlib import ExitStack
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple, Self

import numpy as np
from affine import Affine
from pyproj import CRS

from survey.core import Bounds, FloatArray, InputError, projected_crs
from survey.core.map_scale import MapScale
from survey.io.raster import read_window
from survey.io.raster.opening import check_band, check_transform, open_dataset


def level_for(width: float, height: float, most_cells: int) -> int:
    """Return the finest level on which a window of so many cells of the raster has few enough cells.

    Returns: 0 for the cells of the raster themselves.

    >>> level_for(100.0, 100.0, 20_000), level_for(1000.0, 1000.0, 20_000)
    (0, 3)
    """
    level = 0
    while (width / 2**level + 3) * (height / 2**level + 3) > most_cells:
        level += 1
    return level


def block_means(values: FloatArray, n: int) -> FloatArray:
    """Average squares of n × n cells over the cells that are known; NaN where none is.

    `values` (H, W): NaN where nothing is known. Returns (ceil(H / n), ceil(W / n)): means.

    >>> block_means(np.array([[1.0, 3.0, 5.0], [np.nan, 2.0, 7.0]]), 2)
    array([[2., 6.]])
    """
    if n == 1:
        return values
    height, width = values.shape
    if height % n or width % n:
        values = np.pad(values, ((0, -height % n), (0, -width % n)), constant_values=np.nan)
    blocks = values.reshape(values.shape[0] // n, n, values.shape[1] // n, n)
    known = np.isfinite(blocks)
    if known.all():
        means: FloatArray = blocks.mean(axis=(1, 3))
        return means
    counts = known.sum(axis=(1, 3))
    sums = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


_MOST_CELLS_IN_MEMORY = 4_000_000
_STRIP_CELLS = 4_000_000


class Overview(NamedTuple):
    """Heights of a part of the terrain on one level.

    `heights` (H, W): NaN where none is known [m]. `west`, `north`: outer corner of the first cell [m].
    `cell_m`: width of a cell [m].
    """

    heights: FloatArray
    west: float
    north: float
    cell_m: float


class ElevationPyramid:
    """Heights of a raster of any size, averaged over squares of 2ᵏ cells.

    Level k has cells of 2ᵏ cells of the raster. The finest levels are read from the file in windows;
    those that fit into memory are computed once, when they are first needed.

    `path`: raster of elevations in a projected CRS, north-up with square cells.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock, self._files = Lock(), ExitStack()
        source = self._files.enter_context(open_dataset(path, 1))
        self._source, self._band = source, check_band(source, path, 1)
        if source.crs is None:
            raise InputError(
                f"{path} carries no coordinate reference system; write it with one (gdal_edit -a_srs)."
            )
        self.crs: CRS = projected_crs(source.crs.to_wkt(), str(path))
        self.transform: Affine = source.transform
        check_transform(self.transform)
        self.shape = (int(source.height), int(source.width))
        self.base = _level_in_memory(self.shape)
        self._levels: dict[int, FloatArray] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._files.close()

    @property
    def step_m(self) -> float:
        """Width of a cell of level 0 [m]."""
        return float(self.transform.a)

    @property
    def map_scale(self) -> float:
        """Mean length in the CRS of a metre on the ground."""
        return MapScale.over(self.crs, self.bounds).linear.mean

    @property
    def bounds(self) -> Bounds:
        """``(xmin, ymin, xmax, ymax)`` of the raster [m]."""
        t, (rows, columns) = self.transform, self.shape
        return float(t.c), float(t.f + rows * t.e), float(t.c + columns * t.a), float(t.f)

    @property
    def coarsest(self) -> int:
        """Level on which the raster is at most 256 cells wide and high."""
        return max(0, math.ceil(math.log2(max(self.shape) / 256)))

    def level(self, k: int) -> FloatArray:
        """Return a complete level that fits into memory.

        Returns (H, W): mean heights [m], NaN where none is known.
        """
        with self._lock:
            if self.base not in self._levels:
                self._levels[self.base] = self._averaged(self.base)
            for coarser in range(self.base + 1, k + 1):
                if coarser not in self._levels:
                    self._levels[coarser] = block_means(self._levels[coarser - 1], 2)
            return self._levels[k]

    def window(self, k: int, row: int, column: int, rows: int, columns: int) -> FloatArray:
        """Return a window of a level; NaN beyond the raster.

        Returns (rows, columns): heights [m].
        """
        result = np.full((rows, columns), np.nan)
        height, width = (-(-side // 2**k) for side in self.shape)
        first_row, first_column = max(row, 0), max(column, 0)
        last_row, last_column = min(row + rows, height), min(column + columns, width)
        if last_row <= first_row or last_column <= first_column:
            return result
        if k >= self.base:
            part = self.level(k)[first_row:last_row, first_column:last_column]
        else:
            with self._lock:
                part = self._read(k, first_row, first_column, last_row, last_column)
        result[first_row - row : last_row - row, first_column - column : last_column - column] = part
        return result

    def over(self, bounds: Bounds, most_cells: int) -> Overview:
        """Return the part of the terrain within bounds, on the finest level on which it has few enough cells.

        `bounds`: ``(xmin, ymin, xmax, ymax)`` [m].
        """
        t, (n_rows, n_columns) = self.transform, self.shape
        west, east = (min(max((x - t.c) / t.a, 0.0), n_columns) for x in (bounds[0], bounds[2]))
        north, south = (min(max((y - t.f) / t.e, 0.0), n_rows) for y in (bounds[3], bounds[1]))
        level = level_for(east - west, south - north, most_cells)
        n = 2**level
        column, row = int(west // n), int(north // n)
        rows, columns = max(1, math.ceil(south / n) - row), max(1, math.ceil(east / n) - column)
        cell_m = self.step_m * n
        heights = self.window(level, row, column, rows, columns)
        return Overview(heights, t.c + column * cell_m, t.f - row * cell_m, cell_m)

    def _read(self, k: int, row: int, column: int, last_row: int, last_column: int) -> FloatArray:
        """Read cells of a level from the file."""
        n, (height, width) = 2**k, self.shape
        bottom, right = min(last_row * n, height), min(last_column * n, width)
        cells = (column * n, row * n, right - column * n, bottom - row * n)
        return block_means(read_window(self._source, self._band, _window(*cells)), n)

    def _averaged(self, k: int) -> FloatArray:
        """Average the file strip by strip."""
        n, (height, width) = 2**k, self.shape
        rows = max(1, _STRIP_CELLS // (width * n))
        strips = range(0, -(-height // n), rows)
        n_columns, n_rows = -(-width // n), -(-height // n)
        return np.vstack([self._read(k, row, 0, min(row + rows, n_rows), n_columns) for row in strips])


def _level_in_memory(shape: tuple[int, int]) -> int:
    """Return the finest level that fits into memory."""
    n_cells = shape[0] * shape[1]
    return max(0, math.ceil(math.log2(n_cells / _MOST_CELLS_IN_MEMORY) / 2))


def _window(column: int, row: int, columns: int, rows: int) -> Any:
    from rasterio.windows import Window

    return Window(column, row, columns, rows)


_MOST_CELLS = 4_000_000


def heights_at(pyramid: ElevationPyramid, places: FloatArray) -> FloatArray:
    """Interpolate bilinearly on the finest level on which all places fit into memory.

    `places` (N, 2): easting and northing [m]. Returns (N,): height [m]; NaN off the terrain and beside
    unknown cells.
    """
    t, (n_rows, n_columns) = pyramid.transform, pyramid.shape
    column, row = (places[:, 0] - t.c) / t.a, (places[:, 1] - t.f) / t.e
    inside = (
        np.isfinite(places).all(axis=1) & (column >= 0) & (column <= n_columns) & (row >= 0) & (row <= n_rows)
    )
    heights = np.full(len(places), np.nan)
    if not inside.any():
        return heights
    column, row = column[inside], row[inside]
    level = level_for(float(np.ptp(column)), float(np.ptp(row)), _MOST_CELLS)
    u, v = column / 2**level - 0.5, row / 2**level - 0.5
    first_u, first_v = int(np.floor(u.min())), int(np.floor(v.min()))
    size = (int(v.max()) - first_v + 3, int(u.max()) - first_u + 3)
    heights[inside] = _between(pyramid.window(level, first_v, first_u, *size), u - first_u, v - first_v)
    return heights


def _between(cells: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Interpolate between the centres of cells; beside an unknown cell the nearest one counts."""
    i, j = np.floor(v).astype(np.int64), np.floor(u).astype(np.int64)
    s, t = u - j, v - i
    upper = cells[i, j] * (1 - s) + cells[i, j + 1] * s
    lower = cells[i + 1, j] * (1 - s) + cells[i + 1, j + 1] * s
    nearest = cells[i + (t >= 0.5), j + (s >= 0.5)]
    blended = upper * (1 - t) + lower * t
    return np.where(np.isfinite(blended), blended, nearest)
