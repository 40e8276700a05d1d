"""Lawnmower: straight parallel swaths, driven back and forth."""

from planners.config import SwathConfig
from planners.config_lawnmower import LawnmowerConfig
from planners.layout import straight_route
from planners.patterns.planner import LayoutTask, Planner
from survey.data.route import Route


def straight_layout(config: SwathConfig, task: LayoutTask) -> Route:
    """Lay straight swaths over the area and join them."""
    return straight_route(task.area, config, crew=task.crew)


LAWNMOWER = Planner(LawnmowerConfig, straight_layout)
"""Entry of the registry."""
