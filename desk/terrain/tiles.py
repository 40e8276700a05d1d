"""Images of rasters for the map: tiles of the terrain, contour lines, and pictures with their place."""

import base64
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from desk.terrain.background import GroundPicture, MapService
from desk.terrain.pyramid import ElevationPyramid, Overview
from desk.terrain.shading import Table, TerrainStyle, colour_of, encode_png, legend_colours
from survey.core import Bounds, FloatArray, round_number
from survey.data.dem import Dem

TILE_CELLS = 256
Layer = Literal["relief", "slope"]
LAYERS: tuple[Layer, ...] = get_args(Layer)
_MOST_TILES = 512


class TerrainTiles:
    """Tiles of a terrain; zoom 0 shows all of it in one tile, each further zoom has cells of half the width.

    `pyramid`: the terrain. `background`: what is drawn below it where the user chose a picture or a map service.
    """

    def __init__(self, pyramid: ElevationPyramid) -> None:
        self.pyramid = pyramid
        self.background: GroundPicture | MapService | None = None
        self.style = TerrainStyle.of(pyramid, pyramid.bounds)
        self._png = lru_cache(_MOST_TILES)(self._drawn)

    def grid(self) -> dict[str, Any]:
        """Return the tile grid as the map library takes it.

        Returns: extent [m], size of tiles, and the width of a cell at each zoom [m].
        """
        resolutions = [self.pyramid.step_m * 2**k for k in range(self.pyramid.coarsest, -1, -1)]
        return {"extent": self.pyramid.bounds, "tile_cells": TILE_CELLS, "resolutions_m": resolutions}

    def png(
        self, layer: Layer, zoom: int, column: int, row: int, style: TerrainStyle | None = None
    ) -> bytes | None:
        """Return a tile.

        Returns: PNG; None where the terrain has no such tile.
        """
        level = self.pyramid.coarsest - zoom
        height, width = self.pyramid.shape
        side = TILE_CELLS * 2 ** max(level, 0)
        if level < 0 or not (0 <= row * side < height and 0 <= column * side < width):
            return None
        return self._png(layer, level, column, row, style or self.style)

    def _drawn(self, layer: Layer, level: int, column: int, row: int, style: TerrainStyle) -> bytes:
        first = (row * TILE_CELLS - 1, column * TILE_CELLS - 1)
        heights = self.pyramid.window(level, *first, TILE_CELLS + 2, TILE_CELLS + 2)
        draw = {"relief": style.relief, "slope": style.slope}[layer]
        return encode_png(draw(heights, self.pyramid.step_m * 2**level))


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
            yield {"height_m": round(height_m, 6), "is_index": k % _EACH_INDEX_LINE == 0, "places": places}


def _places(part: Overview, line: FloatArray) -> FloatArray:
    """Return eastings and northings (N, 2) of rows and columns of cell centres."""
    places: FloatArray = np.column_stack(
        [part.west + (line[:, 1] + 0.5) * part.cell_m, part.north - (line[:, 0] + 0.5) * part.cell_m]
    )
    return places


_MOST_PIXELS = 1024


def picture(raster: Dem, table: Table, low: float, high: float) -> dict[str, Any]:
    """Draw a raster in the colours of a table.

    `table` (256, 3): colours. Returns: ``bounds`` [m], ``image`` (data address of a PNG), ``limits``,
    ``colours``.
    """
    step = max(1, -(-max(raster.shape) // _MOST_PIXELS))
    values = raster.elevation[::step, ::step]
    rows, columns = values.shape
    t, cell_m = raster.transform, step * raster.step_m
    png = base64.b64encode(encode_png(_pixels(values, table, low, high))).decode("ascii")
    return {
        "bounds": [t.c, t.f - rows * cell_m, t.c + columns * cell_m, t.f],
        "image": f"data:image/png;base64,{png}",
        "limits": [low, high],
        "colours": legend_colours(table),
    }


def _pixels(values: FloatArray, table: Table, low: float, high: float) -> npt.NDArray[np.uint8]:
    known = np.isfinite(values)
    share = np.where(known, (values - low) / max(high - low, 1e-9), 0.0)
    pixels = np.zeros((*values.shape, 4), dtype=np.uint8)
    pixels[..., :3] = colour_of(table, share)
    pixels[..., 3] = np.where(known, 255, 0)
    return pixels
