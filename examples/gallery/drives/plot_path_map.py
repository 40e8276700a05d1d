"""
Estimated path
==============

Path with its standard deviation, fixes of the receiver, and the true path.
"""

from firnline import localize, sample_survey, simulate
from survey.figures import path_map

survey = sample_survey(swaths=3)
recording, truth = simulate(survey.terrain, survey.route, seed=2)
found = localize(recording)
path = found.trajectory
path_map(
    path.position,
    path.covariance[:, :3, :3],
    fixes=recording.gps.position,
    reference=truth.trajectory.position,
)
