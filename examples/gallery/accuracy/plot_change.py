"""
Elevation change
================

Difference of two surveys, and the variogram of its errors on the ground that did not change.
"""

import numpy as np
import shapely
from matplotlib import pyplot as plt

from firnline import Dem, Grid, change

rng = np.random.default_rng(3)
grid = Grid((0.0, 0.0, 990.0, 990.0), 10.0)
ice = shapely.Point(500.0, 500.0).buffer(250.0)
sunk = np.where(shapely.contains_xy(ice, *grid.xy.T).reshape(grid.shape), -2.0, 0.0)
before = Dem.on(grid, rng.normal(0.0, 0.3, grid.shape))
result = change(Dem.on(grid, sunk + rng.normal(0.0, 0.3, grid.shape)), before, {"ice": ice})

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
result.difference.plot(ax=left)
lags_m = np.linspace(1.0, 300.0, 100)
right.plot(lags_m, result.variogram.at(lags_m))
right.set(xlabel="Distance [m]", ylabel="Variogram [m²]", ylim=(0.0, 0.3))
