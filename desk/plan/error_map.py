"""Draw the predicted standard deviation of the map as an image with transparency."""

import math
from typing import Any

import numpy as np

from desk.terrain.palette import DEVIATION
from desk.terrain.pictures import picture
from firnline.cli.planning.area import AreaPlan
from planners.prediction import predict_error
from survey.core.text import round_number
from survey.data.dem import Dem

_COARSE_NODES_ALONG = 24
_COARSE_SAMPLES = 300
_SAMPLE_STEP_M = 10.0


def error_map(plan: AreaPlan, detail: str) -> dict[str, Any]:
    """Return the predicted standard deviation of a plan as an image with its place and legend.

    Returns: ``bounds`` [m], ``image`` (data address of a PNG), ``top_m`` of the colours, ``rmse_m``,
    ``p95_m``, ``worst_m``.
    """
    std = _coarse_std(plan) if detail == "coarse" else plan.drawing.std(plan.route, plan.drawing.fine_cell_m)
    if std is None:
        return {"bounds": list(plan.area.bounds), "image": None}
    known = std.elevation[np.isfinite(std.elevation)]
    top_m = round_number(float(np.percentile(known, 98.0)) * 1.1)
    return {
        **picture(std, DEVIATION, 0.0, top_m),
        "top_m": top_m,
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
