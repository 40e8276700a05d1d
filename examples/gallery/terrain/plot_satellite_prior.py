"""
A satellite's view
==================

Block means of a fine surface with an error of 1 m, in cells of 30 m.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import Grid
from survey.terrain import matern_field, satellite_copy

grid = Grid((500_000.0, 6_700_000.0, 500_297.0, 6_700_297.0), 3.0, "EPSG:32608")
rng = np.random.default_rng(8)
terrain = matern_field(grid, rng, relief_m=18.0, nu=1.5, length_scale_m=90.0)
prior = satellite_copy(terrain, rng=rng, cell_m=30.0, sigma_m=1.0)

figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for ax, title, dem in ((axes[0], "Terrain", terrain), (axes[1], "Satellite", prior)):
    dem.plot(ax=ax)
    ax.set_title(title)
