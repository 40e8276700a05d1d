"""
Error of a map
==============

Reconstruction minus reference, with the route.
"""

from firnline import reconstruct, sample_survey
from survey.figures import error_map

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
error_map(mapped, survey.terrain, area=survey.area, route=survey.route)
