"""
Estimated path
==============

Path with its standard deviation, fixes of the receiver, and the true path.
"""

import numpy as np

from firnline import Grid, LawnmowerConfig, SensorConfig, SurveyArea, localize, plan, simulate
from survey.figures import path_map
from survey.terrain import matern_field

grid = Grid((500_000.0, 6_700_000.0, 500_300.0, 6_700_300.0), 3.0, "EPSG:32608")
terrain = matern_field(grid, np.random.default_rng(8), relief_m=18.0, nu=2.5, length_scale_m=90.0)
area = SurveyArea.rectangle((500_020.0, 6_700_020.0, 500_280.0, 6_700_280.0), grid.crs)
route = plan(area, None, LawnmowerConfig(swaths=3))
recording, truth = simulate(terrain, route, seed=2, sensors=SensorConfig(landmarks_per_m=0.5))
found = localize(recording)
path = found.trajectory
path_map(
    path.position,
    path.covariance[:, :3, :3],
    fixes=recording.gps.position,
    reference=truth.trajectory.position,
)
