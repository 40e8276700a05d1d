"""
Support of a map
================

Where the map is measured, and where it is interpolated.
"""

from firnline import reconstruct, sample_survey
from survey.figures import support_map

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
support_map(mapped, area=survey.area, route=survey.route)
