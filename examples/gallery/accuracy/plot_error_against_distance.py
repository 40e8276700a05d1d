"""
Error against the distance from the route
=========================================

Errors and claimed standard deviations grow with the distance from the nearest swath.
"""

from firnline import reconstruct, sample_survey
from survey.figures import error_against_distance

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
error_against_distance(mapped, survey.terrain, survey.route, area=survey.area)
