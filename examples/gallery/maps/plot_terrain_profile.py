"""
Profile across the swaths
=========================

Reference, map and its interval along a line across the swaths.
"""

from firnline import reconstruct, sample_survey
from survey.figures import terrain_profile

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
terrain_profile(mapped, survey.terrain, survey.route, area=survey.area)
