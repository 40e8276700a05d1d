"""
Errors of a path
================

Errors of the estimated path over time, with its claimed standard deviation.
"""

from firnline import localize, sample_survey, simulate
from survey.figures import error_over_time

survey = sample_survey(swaths=3)
recording, truth = simulate(survey.terrain, survey.route, seed=2)
found = localize(recording)
error_over_time(found.trajectory, truth.trajectory)
