"""
Calibration of the standard deviation
=====================================

The share of nodes within an interval against the interval's nominal level; an honest map lies on the diagonal.
"""

from firnline import reconstruct, sample_survey, score
from survey.figures import calibration_plot

survey = sample_survey()
mapped = reconstruct(survey.points, survey.grid, area=survey.area)
accuracy = score(mapped, truth=survey.terrain, area=survey.area)
calibration_plot(mapped, survey.terrain, accuracy.calibration, area=survey.area)
