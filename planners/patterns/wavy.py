"""Wavy swaths: a sine about each reference line."""

from planners.config_wavy import WavyConfig
from planners.layout_wavy import wavy_route
from planners.patterns.planner import LayoutTask, Planner
from survey.data.route import Route


def _layout(config: WavyConfig, task: LayoutTask) -> Route:
    """Lay wavy swaths over the area and join them."""
    return wavy_route(task.area, config, slope_length_m=task.slope_length_m, crew=task.crew)


def _needs_kernel(config: WavyConfig) -> bool:
    """Return whether the wavelength has to be taken from the covariance."""
    return config.wavelength_m is None


WAVY = Planner(WavyConfig, _layout, needs_kernel=_needs_kernel)
"""Entry of the registry."""
