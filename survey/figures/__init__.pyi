"""Public names and the modules that define them."""

from survey.figures.calibration import calibration_plot as calibration_plot
from survey.figures.errors import error_against_distance as error_against_distance
from survey.figures.errors import error_histogram as error_histogram
from survey.figures.errors import error_map as error_map
from survey.figures.errors import terrain_profile as terrain_profile
from survey.figures.maps import change_map as change_map
from survey.figures.maps import deviation_map as deviation_map
from survey.figures.maps import distance_map as distance_map
from survey.figures.maps import landmark_map as landmark_map
from survey.figures.maps import support_map as support_map
from survey.figures.maps import survey_map as survey_map
from survey.figures.maps import terrain_comparison as terrain_comparison
from survey.figures.maps import width_map as width_map
from survey.figures.overhangs import overhang_sections as overhang_sections
from survey.figures.paths import error_over_time as error_over_time
from survey.figures.paths import executed_route as executed_route
from survey.figures.paths import path_map as path_map
from survey.figures.plans import plan_map as plan_map
from survey.figures.style import picture_bytes as picture_bytes
from survey.figures.style import png_bytes as png_bytes
