"""
Plan and drive
==============

The planned route, the path that was driven, and the path that was estimated.
"""

import numpy as np

from firnline import Grid, LawnmowerConfig, SensorConfig, SurveyArea, localize, plan, simulate
from survey.figures import executed_route
from survey.terrain import matern_field

grid = Grid((500_000.0, 6_700_000.0, 500_300.0, 6_700_300.0), 3.0, "EPSG:32608")
terrain = matern_field(grid, np.random.default_rng(8), relief_m=18.0, nu=2.5, length_scale_m=90.0)
area = SurveyArea.rectangle((500_020.0, 6_700_020.0, 500_280.0, 6_700_280.0), grid.crs)
route = plan(area, None, LawnmowerConfig(swaths=3))
recording, truth = simulate(terrain, route, seed=2, sensors=SensorConfig(landmarks_per_m=0.5))
found = localize(recording)
executed_route(route, truth.trajectory.position[:, :2], found.trajectory.position[:, :2], area=area)
