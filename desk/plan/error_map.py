"""Draw the predicted standard deviation of the map as an image with transparency."""

import base64
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from desk.terrain.palette import DEVIATION, colour_of, legend_colours
from desk.terrain.tiles import png_bytes
from planners.prediction.predict import predict_error
from sim.cli.planning.area import AreaPlan
from survey.core.arrays import FloatArray
from survey.core.quantity_text import round_number
from survey.data.dem import Dem

_COARSE_NODES_ALONG = 24
_COARSE_SAMPLES = 300
_SAMPLE_STEP_M = 10.0


def error_map(plan: AreaPlan, detail: str) -> dict[str, Any]:
    """Return the predicted standard deviation of a plan as an image with its place and legend.

    Parameters
    ----------
    plan : AreaPlan
        With a covariance.
    detail : {"coarse", "fine"}
        Fine is the standard deviation of the plan sheets. Coarse has fewer nodes, and fewer, better samples
        stand for all.

    Returns
    -------
    dict
        ``bounds`` [m], ``image`` (data address of a PNG), ``top_m`` of the colours, ``rmse_m``, ``p95_m``,
        ``worst_m``.
    """
    std = _coarse_std(plan) if detail == "coarse" else plan.drawing.std(plan.route, plan.drawing.fine_cell_m)
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


def _coarse_std(plan: AreaPlan) -> Dem | None:
    """Return the standard deviation on few nodes, from samples that are means of neighbours."""
    drawing = plan.drawing
    if drawing.kernel is None:
        return None
    xmin, ymin, xmax, ymax = plan.area.bounds
    step_m = max(_SAMPLE_STEP_M, plan.route.length_m / _COARSE_SAMPLES)
    return predict_error(
        plan.route,
        plan.area,
        drawing.kernel,
        noise_m=drawing.noise_m * math.sqrt(_SAMPLE_STEP_M / step_m),
        sample_step_m=step_m,
        cell_m=max(xmax - xmin, ymax - ymin) / _COARSE_NODES_ALONG,
    ).std


def _pixels(std: FloatArray, top_m: float) -> npt.NDArray[np.uint8]:
    known = np.isfinite(std)
    share = np.where(known, std / top_m, 0.0)
    pixels = np.zeros((*std.shape, 4), dtype=np.uint8)
    pixels[..., :3] = colour_of(DEVIATION, share)
    pixels[..., 3] = np.where(known, 255, 0)
    return pixels
