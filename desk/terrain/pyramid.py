"""Elevation pyramid: a raster at resolutions that halve from level to level."""

import math
from contextlib import ExitStack
from pathlib import Path
from threading import Lock
from typing import Any, Self

import numpy as np
from affine import Affine
from pyproj import CRS

from survey.core.arrays import Bounds, FloatArray
from survey.core.crs.checks import projected_crs
from survey.core.errors import InputError
from survey.io.raster import read_window
from survey.io.raster.georeference import check_transform
from survey.io.raster.opening import checked_band, opened_dataset

_MOST_CELLS_IN_MEMORY = 4_000_000
_STRIP_CELLS = 4_000_000


class ElevationPyramid:
    """Heights of a raster of any size, averaged over squares of 2ᵏ cells.

    Level k has cells of 2ᵏ cells of the raster. The finest levels are read from the file in windows;
    those that fit into memory are computed once, when they are first needed.

    Parameters
    ----------
    path : pathlib.Path
        Raster of elevations in a projected CRS, north-up with square cells.

    Raises
    ------
    InputError
        The file is missing, damaged, turned, in degrees, or no raster of elevations.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock, self._files = Lock(), ExitStack()
        source = self._files.enter_context(opened_dataset(path, 1))
        self._source, self._band = source, checked_band(source, path, 1)
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

        Parameters
        ----------
        k : int
            At least `base`.

        Returns
        -------
        (H, W) ndarray
            Mean heights [m], NaN where none is known.
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

        Parameters
        ----------
        k, row, column, rows, columns : int
            Level, first row and column (negative ones lie beyond the raster) and size, in cells of the level.

        Returns
        -------
        (rows, columns) ndarray
            Heights [m].
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


def block_means(values: FloatArray, n: int) -> FloatArray:
    """Average squares of n × n cells over the cells that are known; NaN where none is.

    Parameters
    ----------
    values : (H, W) ndarray
        NaN where nothing is known.
    n : int
        Side of the squares; those at the southern and eastern edge may be cut.

    Returns
    -------
    (ceil(H / n), ceil(W / n)) ndarray
        Means.

    Examples
    --------
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


def _level_in_memory(shape: tuple[int, int]) -> int:
    """Return the finest level that fits into memory."""
    n_cells = shape[0] * shape[1]
    return max(0, math.ceil(math.log2(n_cells / _MOST_CELLS_IN_MEMORY) / 2))


def _window(column: int, row: int, columns: int, rows: int) -> Any:
    from rasterio.windows import Window

    return Window(column, row, columns, rows)
