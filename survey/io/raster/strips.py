"""Reading of raster cells: windows and strips of rows."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine

from survey.core.arrays import Bounds, FloatArray
from survey.core.errors import CapacityError, InputError
from survey.io.raster.deflate_blocks import refuse_damaged_blocks
from survey.io.raster.opening import LARGEST_CELLS, checked_band, opened_dataset
from survey.io.raster.values import band_scale, refuse_picture, refuse_unmarked, valid_range

_STRIP_CELLS = 4_000_000


@contextmanager
def opened_raster(file: Path) -> Iterator[Any]:
    """Open a raster for reading in windows by `read_window`; what GDAL then finds damaged is refused in a sentence.

    Parameters
    ----------
    file : pathlib.Path
        An existing raster.

    Raises
    ------
    InputError
        As in `read_raster`.
    """
    with opened_dataset(file, 1) as source:
        checked_band(source, file, 1)
        refuse_damaged_blocks(source, file, 1, (0, 0, source.width, source.height))
        yield source


def window_of(source: Any, file: Path, bounds: Bounds | None) -> tuple[int, int, int, int]:
    """Return first column, first row, width and height of what is to be read, or refuse as too large."""
    window = (0, 0, int(source.width), int(source.height))
    t = source.transform
    if bounds is not None and t.b == t.d == 0.0 and t.a > 0.0 and t.e != 0.0:
        window = _window_over(bounds, t, source.width, source.height, file)
    _, _, width, height = window
    if height * width > LARGEST_CELLS:
        raise CapacityError(
            f"{file} has {height:,} × {width:,} cells {'there' if bounds else 'in all'}; {LARGEST_CELLS:,} can be read at once "
            f"({8 * LARGEST_CELLS / 1e9:.2f} GB), cut a window (gdal_translate -projwin) or average it (gdalwarp -tr) first."
        )
    return window


def _window_over(bounds: Bounds, t: Affine, width: int, height: int, file: Path) -> tuple[int, int, int, int]:
    """Return the cells from which heights within the bounds are interpolated: one more to each side."""
    west, south, east, north = bounds
    columns = _span((west - t.c) / t.a, (east - t.c) / t.a, width)
    edges = sorted(((north - t.f) / t.e, (south - t.f) / t.e))  # the first row may be the southern one
    rows = _span(edges[0], edges[1], height)
    if min(columns[1], rows[1]) < 2:
        south, north = sorted((t.f, t.f + height * t.e))
        raise InputError(
            f"{file} lies elsewhere than the bounds ({', '.join(f'{b:.7g}' for b in bounds)}): it reaches from "
            f"{t.c:.7g}, {south:.7g} to {t.c + width * t.a:.7g}, {north:.7g}; check both and their CRS."
        )
    return columns[0], rows[0], columns[1], rows[1]


def _span(low: float, high: float, n: int) -> tuple[int, int]:
    """Return the first cell and the number of cells between two places counted in cells, one more to each side."""
    if not (low < n and high > 0.0):
        return 0, 0
    first, last = max(0, math.floor(low) - 1), min(n, math.ceil(high) + 1)
    return first, last - first


def read_strips(source: Any, band: int, window: Sequence[int]) -> FloatArray:
    """Read a band strip by strip, so that memory follows what the file holds and not what its header claims."""
    from rasterio.windows import Window

    column, row, width, height = window
    values = np.empty((height, width))
    rows = max(1, _STRIP_CELLS // width)
    for first in range(0, height, rows):
        strip = Window(column, row + first, width, min(rows, height - first))
        values[first : first + rows] = read_window(source, band, strip)
    return values


def read_window(source: Any, band: int, window: Any) -> FloatArray:
    """Read a window of an open raster.

    Parameters
    ----------
    source : rasterio.DatasetReader
        From `opened_raster`.
    band : int
        Counted from 1.
    window : rasterio.windows.Window
        Columns and rows of the raster.

    Returns
    -------
    (h, w) ndarray
        Values [m], scale, offset and unit applied; NaN for nodata.
    """
    refuse_picture(source, band)
    strip = source.read(band, window=window, masked=True, out_dtype=np.float64)
    stored: FloatArray = strip.filled(np.nan)
    stored[~np.isfinite(stored)] = np.nan
    low, high = valid_range(source, band)
    stored[(stored < low) | (stored > high)] = np.nan
    scale = band_scale(source, band)
    refuse_unmarked(stored, source.name, source.dtypes[band - 1], in_metres=scale == (1.0, 0.0))
    return scale.applied(stored)
