"""A planner: swaths at 45 degrees."""

from tests.docs.recipes.recipe import Recipe

PLANNER = Recipe(
    "Add a planner",
    2,
    added={
        "planners/patterns/diagonal.py": '''"""Diagonal: swaths at 45 degrees."""

from typing import Literal

from planners.config import SwathConfig
from planners.patterns.planner import LayoutTask, Planner
from planners.swaths.reference_lines import Swath, reference_lines
from survey.data.route import Route


class DiagonalConfig(SwathConfig):
    """Straight swaths at 45 degrees."""

    pattern: Literal["diagonal"] = "diagonal"
    """Name of the pattern."""


def _layout(config: DiagonalConfig, task: LayoutTask) -> Route:
    from planners.swaths.swath_route import join_swaths

    lines = reference_lines(task.area, config.model_copy(update={"heading_deg": 45.0}))
    legs = join_swaths([Swath(axis, axis) for axis in lines.back_and_forth], task.area, task.crew)
    return Route(legs, task.area.crs, config.pattern, lines.spacing_m)


DIAGONAL = Planner(DiagonalConfig, _layout)
'''
    },
    inserted={
        "planners/registry.py": (
            (
                "from planners.patterns.lawnmower import",
                "from planners.patterns.diagonal import DIAGONAL\n",
            ),
            ("LAWNMOWER, WAVY, PIECEWISE", "DIAGONAL, "),
        )
    },
    check="""
from firnline import SurveyArea, plan
from planners.registry import planner_config
area = SurveyArea.rectangle((500_000.0, 6_700_000.0, 500_200.0, 6_700_200.0), "EPSG:32608")
config = planner_config({"pattern": "diagonal", "swaths": 3}, "here")
route = plan(area, None, config)
assert (route.pattern, [leg.kind for leg in route.legs]) == ("diagonal", ["swath", "transit"] * 2 + ["swath"])
area.write("site.gpkg")
command("plan", "site.gpkg", "--pattern", "diagonal", "--swaths", "3", "-o", "route.gpkg")
assert mission(planner={"pattern": "diagonal", "swaths": 2}).planner.swaths == 2
""",
)
