"""
Surfaces of a glacier
=====================

The same place as clean snow, bare ice with melt channels, debris-covered ice, and debris under patches of snow.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import Dem, Grid
from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer
from sim.simulate.assembly import rover_camera
from sim.world.fine_terrain import fine_terrain

grid = Grid((0.0, 0.0, 80.0, 80.0), 1.0)
x, _ = np.meshgrid(grid.x, grid.y)
sloping = Dem.on(grid, 0.08 * x)
imaging = ImagingConfig(width=480, height=300)
camera = rover_camera(imaging)
figure, axes = plt.subplots(2, 2, figsize=(9, 6), layout="constrained")
surfaces = [("snow", 0.0), ("bare ice", 0.0), ("debris", 0.0), ("debris", 0.3)]
for ax, (surface, snow_cover) in zip(axes.ravel(), surfaces, strict=True):
    ground = fine_terrain(sloping, SceneryConfig(surface=surface, snow_cover=snow_cover), seed=1)
    standing = np.eye(4)
    standing[:3, 3] = 20.0, 40.0, ground.elevation(np.array([[20.0, 40.0]]))[0] + 0.2
    renderer = Renderer(ground, AppearanceConfig(sun_elevation_deg=40.0), camera, seed=1, imaging=imaging)
    ax.imshow(renderer.render(standing @ camera.T_body_camera), cmap="gray", vmin=0, vmax=255)
    ax.set(title=surface + (f", {snow_cover:.0%} under snow" if snow_cover else ""), xticks=[], yticks=[])
