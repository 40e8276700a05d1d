"""Map tiles: squares of 256 pixels of a terrain layer as PNG."""

import io
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
from PIL import Image

from desk.terrain.pyramid import ElevationPyramid
from desk.terrain.shading import TerrainStyle

TILE_CELLS = 256
Layer = Literal["relief", "slope"]
LAYERS: tuple[Layer, ...] = get_args(Layer)
_MOST_TILES = 512


class TerrainTiles:
    """Tiles of a terrain; zoom 0 shows all of it in one tile, each further zoom has cells of half the width.

    `pyramid`: the terrain.
    """

    def __init__(self, pyramid: ElevationPyramid) -> None:
        self.pyramid = pyramid
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
        return png_bytes(draw(heights, self.pyramid.step_m * 2**level))


def png_bytes(pixels: npt.NDArray[np.uint8]) -> bytes:
    """Return an image as PNG.

    `pixels` (H, W, 4): red, green, blue, opacity.
    """
    buffer = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
