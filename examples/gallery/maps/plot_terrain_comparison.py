"""
Reference and reconstruction
============================

The true surface beside the map of four swaths, in one colour scale.
"""

from firnline import reconstruct, sample_survey
from survey.figures import terrain_comparison

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
terrain_comparison(survey.terrain, mapped, area=survey.area)
