"""
Places for checkpoints
======================

Thirty places that meet the spread that standards ask for, on gentle ground.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import Grid, SurveyArea
from survey.scoring import design_checkpoints
from survey.terrain import matern_field

grid = Grid((500_000.0, 6_700_000.0, 500_600.0, 6_700_600.0), 10.0, "EPSG:32608")
terrain = matern_field(grid, np.random.default_rng(6), relief_m=40.0, nu=2.5, length_scale_m=120.0)
area = SurveyArea.rectangle((500_020.0, 6_700_020.0, 500_580.0, 6_700_580.0), grid.crs)
places = design_checkpoints(area, 30, np.random.default_rng(1), terrain=terrain)

figure, ax = plt.subplots(figsize=(6, 5), layout="constrained")
terrain.plot(ax=ax)
ax.plot(places[:, 0], places[:, 1], "^", color="white", markeredgecolor="black")
