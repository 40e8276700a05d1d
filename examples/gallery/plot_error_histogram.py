"""
Histogram of errors
===================

Errors of all nodes, with RMSE, bias and NMAD.
"""

import numpy as np

from firnline import Grid, LawnmowerConfig, SurfacePoints, SurveyArea, plan, reconstruct, score
from survey.figures import error_histogram
from survey.terrain import matern_field

grid = Grid((500_000.0, 6_700_000.0, 500_300.0, 6_700_300.0), 3.0, "EPSG:32608")
terrain = matern_field(grid, np.random.default_rng(8), relief_m=18.0, nu=2.5, length_scale_m=90.0)
area = SurveyArea.rectangle((500_020.0, 6_700_020.0, 500_280.0, 6_700_280.0), grid.crs)
route = plan(area, None, LawnmowerConfig(swaths=4))
xy = route.sample(5.0).xy
heights = terrain.at(xy) + np.random.default_rng(1).normal(0.0, 0.1, len(xy))
points = SurfacePoints(np.column_stack([xy, heights]), sigma_m=0.1, crs=grid.crs)
made = reconstruct(points, Grid.over(area.bounds, step_m=4.0, crs=grid.crs), area=area)
judged = score(made, truth=terrain, area=area)
error_histogram(made, terrain, judged.elevation, area=area)
