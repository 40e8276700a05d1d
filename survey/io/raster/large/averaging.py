"""Averages of the cells of a raster that does not fit the memory."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine

from survey.core.arrays import FloatArray, IntArray
from survey.core.crs.vertical_datum import UNSTATED, vertical_datum_of
from survey.core.files.reading import existing_file
from survey.io.raster.facts import stated_datum
from survey.io.raster.georeference import check_transform
from survey.io.raster.reading import Raster
from survey.io.raster.strips import opened_raster, read_window

_CELLS_AT_ONCE = 4_000_000


def read_averaged(path: str | Path, cells: int, bands: Sequence[int] = (1,)) -> list[Raster]:
    """Return the averages of squares of cells, read in strips of rows.

    Parameters
    ----------
    path : str or pathlib.Path
        A north-up raster with square cells.
    cells : int
        Cells along a side of a square. The squares are counted from the origin of the CRS, so that those of two rasters
        with the same cells are the same.
    bands : sequence of int
        Counted from 1.

    Returns
    -------
    list of Raster
        One for each band; NaN where less than half of a square is known.

    Raises
    ------
    InputError
        As in `survey.io.raster.read_raster`, or a raster that is rotated or has oblong cells.
    """
    with opened_raster(existing_file(path, "the raster")) as source:
        check_transform(source.transform)
        wkt = source.crs.to_wkt() if source.crs else None
        datum = stated_datum(source) or (vertical_datum_of(wkt) if wkt else UNSTATED)
        step_m, west, north = source.transform.a, source.transform.c, source.transform.f
        columns = _starts(round(west / step_m), source.width, cells)
        rows = _starts(-round(north / step_m), source.height, cells)
        corner = (
            west + step_m * (_first_edge(round(west / step_m), cells)),
            north - step_m * (_first_edge(-round(north / step_m), cells)),
        )
        transform = Affine(cells * step_m, 0.0, corner[0], 0.0, -cells * step_m, corner[1])
        means = [_means(source, band, rows, columns) for band in bands]
    return [Raster(values, transform, wkt, datum) for values in means]


def _first_edge(first: int, cells: int) -> int:
    """Return the number of the cell, from the raster's first one, at which its first square begins: 0 or less."""
    return -(first % cells)


def _starts(first: int, n: int, cells: int) -> IntArray:
    """Return the first row or column of each square within a raster of n rows or columns."""
    starts: IntArray = np.maximum(np.arange(_first_edge(first, cells), n, cells), 0)
    return starts


def _means(source: Any, band: int, rows: IntArray, columns: IntArray) -> FloatArray:
    """Return the means over squares that begin at the given rows and columns."""
    from rasterio.windows import Window

    ends = np.append(rows[1:], source.height)
    at_once = max(1, int(_CELLS_AT_ONCE / source.width / max(np.max(ends - rows), 1)))
    means = np.empty((len(rows), len(columns)))
    for k in range(0, len(rows), at_once):
        first, last = int(rows[k]), int(ends[min(k + at_once, len(rows)) - 1])
        values = read_window(source, band, Window(0, first, source.width, last - first))
        means[k : k + at_once] = _reduced(values, rows[k : k + at_once] - first, columns)
    return means


def _reduced(values: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    known = np.isfinite(values)
    n, size, total = (
        np.add.reduceat(np.add.reduceat(part, columns, axis=1), rows, axis=0)
        for part in (known.astype(np.float64), np.ones(values.shape), np.where(known, values, 0.0))
    )
    means: FloatArray = np.full(n.shape, np.nan)
    np.divide(total, n, out=means, where=2.0 * n >= np.maximum(size, 1.0))
    return means
