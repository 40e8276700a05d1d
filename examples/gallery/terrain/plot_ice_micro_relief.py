"""
Micro-relief of bare ice
========================

Generated relief with the measured spectrum of bare glacier ice; crests run across the wind.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import Grid
from survey.terrain import ice_micro_relief

grid = Grid((0.0, 0.0, 60.0, 60.0), 0.25)
relief = ice_micro_relief(grid, np.random.default_rng(5))

figure, ax = plt.subplots(figsize=(6, 5), layout="constrained")
image = ax.imshow(relief, extent=(0.0, 60.0, 0.0, 60.0), cmap="bone")
ax.set(xlabel="Easting [m]", ylabel="Northing [m]")
figure.colorbar(image, ax=ax, label="Height [m]")
