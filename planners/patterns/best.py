"""Best swaths: straight or wavy, with the heading, inset and spacing of least predicted error."""

from planners.config_best import BestConfig
from planners.patterns.planner import LayoutTask, Planner, always
from planners.prediction.choose import choose
from survey.data.route import Route


def _layout(config: BestConfig, task: LayoutTask) -> Route:
    """Compare patterns and return the route of the best one."""
    model = task.required_model(config.pattern)
    return choose(task.area, config, model, crew=task.crew, progress=task.progress).route


BEST = Planner(BestConfig, _layout, needs_kernel=always)
"""Entry of the registry."""
