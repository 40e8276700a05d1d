"""
Ground that is too steep
========================

Swaths and transits keep to ground of at most 22 degrees; what no rover can reach is left out and named.
"""

import numpy as np

from firnline import Grid, LawnmowerConfig, Rover, SurveyArea, plan
from survey.figures import plan_map
from survey.terrain import matern_field

grid = Grid((500_000.0, 6_700_000.0, 500_400.0, 6_700_300.0), 10.0, "EPSG:32608")
prior = matern_field(grid, np.random.default_rng(21), relief_m=45.0, nu=2.5, length_scale_m=90.0)
area = SurveyArea.rectangle((500_020.0, 6_700_020.0, 500_380.0, 6_700_280.0), grid.crs)
rover = Rover(max_pitch_deg=22.0, max_roll_deg=22.0)
route = plan(area, prior, LawnmowerConfig(swaths=6), rover=rover)

plan_map(area, route, terrain=prior)
