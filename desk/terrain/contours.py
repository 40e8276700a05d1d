"""Contour lines of a part of the terrain."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from desk.terrain.pyramid import ElevationPyramid, Overview
from survey.core.arrays import Bounds, FloatArray
from survey.core.text import round_number

_MOST_CELLS = 60_000
_N_INTERVALS = 14.0
_EACH_INDEX_LINE = 5
_TOLERANCE_CELLS = 0.1


def contour_lines(pyramid: ElevationPyramid, bounds: Bounds) -> dict[str, Any]:
    """Return contour lines within bounds, at an interval that suits their relief.

    `bounds`: ``(xmin, ymin, xmax, ymax)`` [m]. Returns: ``interval_m``, and ``lines`` with ``height_m``,
    ``is_index`` (every fifth one) and ``places``.
    """
    part = pyramid.over(bounds, _MOST_CELLS)
    known = part.heights[np.isfinite(part.heights)]
    if len(known) == 0 or min(part.heights.shape) < 2:
        return {"interval_m": 0.0, "lines": []}
    low, high = np.percentile(known, [1.0, 99.0])
    interval_m = round_number(max(float(high - low), 0.1) / _N_INTERVALS)
    first, last = int(np.ceil(known.min() / interval_m)), int(np.floor(known.max() / interval_m))
    lines = [line for k in range(first, last + 1) for line in _lines_at(part, k, interval_m)]
    return {"interval_m": interval_m, "lines": lines}


def _lines_at(part: Overview, k: int, interval_m: float) -> Iterator[dict[str, Any]]:
    """Yield the lines of one height."""
    from skimage.measure import approximate_polygon, find_contours  # takes a moment to import

    height_m = k * interval_m
    for line in find_contours(part.heights, height_m):  # type: ignore[no-untyped-call]
        thinned = approximate_polygon(line, _TOLERANCE_CELLS)  # type: ignore[no-untyped-call]
        if len(thinned) > 1:
            places = _places(part, thinned).round(2).tolist()
            yield {
                "height_m": round(height_m, 6),
                "is_index": k % _EACH_INDEX_LINE == 0,
                "places": places,
            }


def _places(part: Overview, line: FloatArray) -> FloatArray:
    """Return eastings and northings (N, 2) of rows and columns of cell centres."""
    places: FloatArray = np.column_stack(
        [part.west + (line[:, 1] + 0.5) * part.cell_m, part.north - (line[:, 0] + 0.5) * part.cell_m]
    )
    return places
