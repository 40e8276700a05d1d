"""
Landmarks of a drive
====================

Where the landmarks of three swaths lie.
"""

from firnline import localize, sample_survey, simulate
from survey.figures import landmark_map

survey = sample_survey(swaths=3)
recording, truth = simulate(survey.terrain, survey.route, seed=2)
found = localize(recording)
landmark_map(found.points, survey.terrain, area=survey.area, route=survey.route)
