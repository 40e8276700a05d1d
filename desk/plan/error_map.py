"""Predicted standard deviation of the map as an image that the page lays over the terrain."""

import base64
from typing import Any

import numpy as np
import numpy.typing as npt

from desk.terrain.palette import DEVIATION, colour_of, legend_colours
from desk.terrain.tiles import png_bytes
from sim.cli.planning.area import AreaPlan
from survey.core.arrays import FloatArray
from survey.core.quantity_text import round_number

_NODES_ALONG = {"coarse": 24, "fine": 60}
"""Nodes along the longer side of the area, by detail; the fine ones are those of the plan sheets."""


def error_map(plan: AreaPlan, detail: str) -> dict[str, Any]:
    """Return the predicted standard deviation of a plan as an image with its place and legend.

    Parameters
    ----------
    plan : AreaPlan
        With a covariance.
    detail : {"coarse", "fine"}
        Distance of the nodes.

    Returns
    -------
    dict
        ``bounds`` [m], ``image`` (data address of a PNG), ``top_m`` of the colours, ``rmse_m``, ``p95_m``,
        ``worst_m``.
    """
    xmin, ymin, xmax, ymax = plan.area.bounds
    std = plan.drawing.std(plan.route, max(xmax - xmin, ymax - ymin) / _NODES_ALONG[detail])
    if std is None:
        return {"bounds": list(plan.area.bounds), "image": None}
    known = std.elevation[np.isfinite(std.elevation)]
    top_m = round_number(float(np.percentile(known, 98.0)) * 1.1)
    png = base64.b64encode(png_bytes(_pixels(std.elevation, top_m))).decode("ascii")
    return {
        "bounds": list(std.bounds),
        "image": f"data:image/png;base64,{png}",
        "top_m": top_m,
        "colours": legend_colours(DEVIATION),
        "rmse_m": float(np.sqrt(np.mean(known**2))),
        "p95_m": float(np.percentile(known, 95.0)),
        "worst_m": float(known.max()),
    }


def _pixels(std: FloatArray, top_m: float) -> npt.NDArray[np.uint8]:
    known = np.isfinite(std)
    share = np.where(known, std / top_m, 0.0)
    pixels = np.zeros((*std.shape, 4), dtype=np.uint8)
    pixels[..., :3] = colour_of(DEVIATION, share)
    pixels[..., 3] = np.where(known, 255, 0)
    return pixels
