"""Swath to drive next after what was measured, as ``firnline plan --require --adaptive`` proposes it."""

from pathlib import Path
from typing import Any

from planners.guarantee.adaptive import AdaptiveConfig, next_swath
from planners.guarantee.requirement import MapRequirement
from planners.swaths.heading import across_marked_grain
from survey.core.text import length_text
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints


def proposed_swath(
    area: SurveyArea,
    prior: Dem,
    driven: Route,
    points: SurfacePoints,
    *,
    requirement: MapRequirement,
    file: Path,
) -> dict[str, Any]:
    """Propose the swath to drive next, or find that none is needed or none would do.

    Returns: ``sentence``, ``holds``, and the ``lines`` to drive (empty where there are none) with the
    ``file``.
    """
    config = AdaptiveConfig.of(requirement, across_marked_grain(area.free, prior))
    advice = next_swath(area, driven, points.xy, points.xyz[:, 2], config)
    limit = f"{config.limit_m:.4g} m with {config.probability:.0%}"
    found: dict[str, Any] = {"holds": advice.holds, "lines": []}
    if not advice.holds:
        sentence = f"No further swaths would reach {limit}; the densest survey is predicted to err {advice.predicted.rmse_m:.3g} m."
        return {**found, "sentence": sentence}
    if advice.route is None:
        return {**found, "sentence": f"An RMSE within {limit} is met already; no more driving is needed."}
    advice.route.write(file)
    sentence = (
        f"Drive one more swath, {length_text(advice.route.ground_length_m)} with the way there. With those that follow, the map "
        f"is predicted to have an RMSE of {advice.predicted.rmse_m:.2f} m; {limit} is asked for."
    )
    lines = [leg.xy.round(2).tolist() for leg in advice.route.legs]
    return {"holds": True, "lines": lines, "sentence": sentence, "file": file.name}
