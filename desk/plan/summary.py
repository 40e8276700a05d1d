"""Summary of a plan for the page: legs, numbers with units, ground that is left out, the command that is the same."""

from typing import Any

from shapely import Polygon

from desk.plan.document import PlanDocument
from desk.plan.live import LivePlan
from desk.plan.request import command_of
from firnline.cli.planning.outputs import fact_texts
from planners.swaths.reference_lines import swaths_text


def plan_summary(live: LivePlan, document: PlanDocument, name: str, terrain: str) -> dict[str, Any]:
    """Return what the page shows of a plan."""
    route = live.plan.route
    texts = fact_texts(route.prediction)
    return {
        "is_provisional": live.is_provisional,
        "no_error_because": live.no_error_because,
        "has_error": live.plan.kernel is not None and "rmse_m" in route.prediction,
        "legs": [{"kind": leg.kind, "rover": leg.rover, "places": leg.xy.tolist()} for leg in route.legs],
        "n_rovers": route.n_rovers,
        "swaths": swaths_text(route),
        "spacing_m": route.spacing_m,
        "facts": [
            {"name": key, "title": title, "text": text, "value": route.prediction[key]}
            for key, (title, text) in texts.items()
        ],
        "area_m2": live.plan.area.ground_area_m2,
        "left_out": [
            {"rings": _rings(piece.polygon), "reason": piece.reason, "text": str(piece)}
            for piece in live.plan.left_out
        ],
        "command": command_of(document, f"{name}.gpkg", terrain, f"{name}.geojson"),
    }


def _rings(polygon: Polygon) -> list[list[list[float]]]:
    lines = [polygon.exterior, *polygon.interiors]
    return [[[float(x), float(y)] for x, y, *_ in line.coords[:-1]] for line in lines]
