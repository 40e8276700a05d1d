"""
Standard deviation of a map
===========================

The standard deviation is small along the swaths and grows between them.
"""

from firnline import reconstruct, sample_survey
from survey.figures import deviation_map

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
deviation_map(mapped, area=survey.area, route=survey.route)
