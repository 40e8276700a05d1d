"""Figures of a survey: types in, `matplotlib.figure.Figure` out; no file is read or written.

Every figure has one style, states its units, and uses colours that the colour-blind can distinguish. Files are written by `survey.reporting`.
"""

from survey.figures.calibration import calibration_plot
from survey.figures.errors import error_against_distance, error_histogram, error_map, terrain_profile
from survey.figures.maps import (
    change_map,
    deviation_map,
    landmark_map,
    support_map,
    survey_map,
    terrain_comparison,
    width_map,
)
from survey.figures.paths import error_over_time, executed_route, path_map
from survey.figures.plans import plan_map
from survey.figures.style import png_bytes

__all__ = [
    "calibration_plot",
    "change_map",
    "deviation_map",
    "error_against_distance",
    "error_histogram",
    "error_map",
    "error_over_time",
    "executed_route",
    "landmark_map",
    "path_map",
    "plan_map",
    "png_bytes",
    "support_map",
    "survey_map",
    "terrain_comparison",
    "terrain_profile",
    "width_map",
]
