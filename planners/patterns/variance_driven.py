"""Variance-driven path: waypoints where the predicted variance falls most per metre."""

from planners.config_variance_driven import VarianceDrivenConfig
from planners.patterns.planner import LayoutTask, Planner, always
from planners.prediction.informative import variance_driven
from survey.data.route import Route


def _layout(config: VarianceDrivenConfig, task: LayoutTask) -> Route:
    """Insert waypoints until the budget is used or the wanted error is predicted."""
    model = task.required_model(config.pattern)
    return Route(variance_driven(task.area, config, model, task.progress), task.area.crs, config.pattern)


VARIANCE_DRIVEN = Planner(VarianceDrivenConfig, _layout, needs_kernel=always, is_for_fleets=False)
"""Entry of the registry."""
