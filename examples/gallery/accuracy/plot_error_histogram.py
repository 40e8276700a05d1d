"""
Histogram of errors
===================

Errors of all nodes, with RMSE, bias and NMAD.
"""

from firnline import reconstruct, sample_survey, score
from survey.figures import error_histogram

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
accuracy = score(mapped, truth=survey.terrain, area=survey.area)
error_histogram(mapped, survey.terrain, accuracy.elevation, area=survey.area)
