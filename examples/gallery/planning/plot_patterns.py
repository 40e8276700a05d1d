"""
Patterns of routes
==================

Four patterns on one site: straight and wavy swaths, swaths of least predicted error, and the lawnmower with tie lines.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import BestConfig, Grid, LawnmowerConfig, SurveyArea, WavyConfig, plan
from survey.terrain import matern_field

grid = Grid((500_000.0, 6_700_000.0, 500_300.0, 6_700_300.0), 15.0, "EPSG:32608")
prior = matern_field(grid, np.random.default_rng(8), relief_m=18.0, nu=2.5, length_scale_m=90.0)
area = SurveyArea.rectangle((500_020.0, 6_700_020.0, 500_280.0, 6_700_280.0), grid.crs)
configs = {
    "lawnmower": LawnmowerConfig(swaths=4),
    "wavy": WavyConfig(swaths=4),
    "best within 900 m": BestConfig(budget_m=900.0),
    "lawnmower with tie lines": LawnmowerConfig(swaths=4, tie_lines=2),
}

figure, axes = plt.subplots(1, 4, figsize=(14, 4), layout="constrained")
for ax, (name, config) in zip(axes, configs.items(), strict=True):
    route = plan(area, prior, config)
    route.plot(ax=ax)
    ax.set_title(f"{name}\n{route.length_m:.0f} m")
    ax.set_xticks([])
    ax.set_yticks([])
