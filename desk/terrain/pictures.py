"""Pictures of rasters, with their place and the limits of their colours."""

import base64
from typing import Any

import numpy as np
import numpy.typing as npt

from desk.terrain.palette import Table, colour_of, legend_colours
from desk.terrain.tiles import png_bytes
from survey.core.arrays import FloatArray
from survey.data.dem import Dem

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
    png = base64.b64encode(png_bytes(_pixels(values, table, low, high))).decode("ascii")
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
