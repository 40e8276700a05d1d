"""
Random terrain
==============

Four kinds of random terrain with 20 m of relief on 300 × 300 m. Studies draw their sites from these families.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import Grid
from survey.terrain import random_dem

FAMILIES = ("squared-exponential", "matern-3/2", "diamond_square", "fractional_brownian")

grid = Grid((0.0, 0.0, 300.0, 300.0), 2.0)
figure, axes = plt.subplots(2, 2, figsize=(9, 7.5), layout="constrained")
for family, ax in zip(FAMILIES, axes.flat, strict=True):
    random_dem(family, grid, np.random.default_rng(3), relief_m=20.0).plot(ax=ax)
    ax.set_title(family)
