"""Figures of a survey: types in, `matplotlib.figure.Figure` out; no file is read or written.

Every figure has one style, states its units, and uses colours that the colour-blind can distinguish. Files are written by `survey.reporting`.
"""

from survey.figures.calibration import calibration_plot, held_out_plot
from survey.figures.curves import terrain_profile, trajectory_error
from survey.figures.errors import (
    error_against_distance,
    error_histogram,
    error_map,
    height_error,
)
from survey.figures.maps import (
    deviation_map,
    landmark_map,
    support_map,
    survey_map,
    terrain_comparison,
)
from survey.figures.paths import deviation_from_route, error_over_distance, executed_route, path_map
from survey.figures.plans import plan_map
from survey.figures.style import png_bytes

__all__ = [
    "calibration_plot",
    "deviation_from_route",
    "deviation_map",
    "error_against_distance",
    "error_histogram",
    "error_map",
    "error_over_distance",
    "executed_route",
    "height_error",
    "held_out_plot",
    "landmark_map",
    "path_map",
    "plan_map",
    "png_bytes",
    "support_map",
    "survey_map",
    "terrain_comparison",
    "terrain_profile",
    "trajectory_error",
]
