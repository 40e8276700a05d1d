"""A planner: swaths at 45 degrees."""

from tests.docs.recipes.recipe import Recipe

PLANNER = Recipe(
    "Add a planner",
    2,
    added={
        "planners/patterns/diagonal.py": '''"""Diagonal: swaths at 45 degrees."""

from typing import Literal

from planners.config import SwathConfig
from planners.patterns.lawnmower import straight_route
from planners.patterns.planner import LayoutTask, Planner
from survey.data.route import Route


class DiagonalConfig(SwathConfig):
    """Straight swaths at 45 degrees."""

    pattern: Literal["diagonal"] = "diagonal"
    """Name of the pattern."""


def _layout(config: DiagonalConfig, task: LayoutTask) -> Route:
    return straight_route(task.area, config.model_copy(update={"heading_deg": 45.0}), crew=task.crew)


DIAGONAL = Planner(DiagonalConfig, _layout)
'''
    },
    inserted={
        "planners/registry.py": (
            (
                "from planners.patterns.lawnmower import",
                "from planners.patterns.diagonal import DIAGONAL\n",
            ),
            ("    LAWNMOWER,\n    WAVY,", "    DIAGONAL,\n"),
        )
    },
    check="""
from firnline import SurveyArea, plan
from planners.registry import planner_config
area = SurveyArea.rectangle((500_000.0, 6_700_000.0, 500_200.0, 6_700_200.0), "EPSG:32608")
config = planner_config({"pattern": "diagonal", "swaths": 3}, "here")
assert plan(area, None, config).pattern == "diagonal"
area.write("site.gpkg")
command("plan", "site.gpkg", "--pattern", "diagonal", "--swaths", "3", "-o", "route.gpkg")
assert mission(planner={"pattern": "diagonal", "swaths": 2}).planner.swaths == 2
""",
)
