"""
Plan and drive
==============

The planned route, the path that was driven, and the path that was estimated.
"""

from firnline import localize, sample_survey, simulate
from survey.figures import executed_route

survey = sample_survey(swaths=3)
recording, truth = simulate(survey.terrain, survey.route, seed=2)
found = localize(recording)
executed_route(
    survey.route, truth.trajectory.position[:, :2], found.trajectory.position[:, :2], area=survey.area
)
