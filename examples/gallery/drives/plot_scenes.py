"""
Horizon, clouds, ruts and colour
================================

The same view with random mountains, and with what settings add: the ground of an elevation raster around the site, clouds whose
shadows drift with the wind, ruts of the rover, and colour. All of it is off by default.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import Grid
from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer, Ruts
from sim.simulate.assembly import rover_camera
from sim.world.fine_terrain import fine_terrain
from survey.terrain.real import real_sample
from survey.terrain.satellite import smooth_interpolation

real, east, north = real_sample(), 745_258.0, 4_016_828.0
near = real.window((east - 400.0, north - 400.0, east + 400.0, north + 400.0))
site = smooth_interpolation(near, Grid((east - 60.0, north - 60.0, east + 60.0, north + 60.0), 1.0, real.crs))
ground = fine_terrain(site, SceneryConfig(crevasses_per_ha=0.0), seed=1)
ruts = Ruts((120.0, 120.0), gauge_m=0.45, width_m=0.15, depth_m=0.025, smooth=0.5)
for turn in np.linspace(0.0, 2.0 * np.pi, 400):  # a loop to the north-west of the camera
    ruts.press(57.0 + 3.0 * np.cos(turn), 65.0 + 3.0 * np.sin(turn), turn + 0.5 * np.pi)
T_world_body = np.eye(4)
T_world_body[:2, :2] = [[-0.423, -0.906], [0.906, -0.423]]  # heading 115° from the east
T_world_body[:3, 3] = east, north, ground.elevation(np.array([[east, north]]))[0]
looks, seconds = [{}, {"horizon": "terrain", "haze_m": 8000.0}], (0.0, 0.0, 0.0, 120.0, 0.0, 0.0)
looks += [looks[1] | {"clouds": 0.35}] * 2 + [looks[1] | {"clouds": 0.35, "ruts": True}] * 2
titles = ("as by default", "ground of the raster", "clouds", "clouds, two minutes later", "ruts", "colour")
for k, ax in enumerate(plt.subplots(3, 2, figsize=(9, 9.5), layout="constrained")[1].ravel()):
    imaging = ImagingConfig(width=480, height=320, pitch_down_deg=8.0, colour=titles[k] == "colour")
    camera, around = rover_camera(imaging), real if looks[k] else None
    options = {"imaging": imaging, "surroundings": around, "ruts": ruts if "ruts" in looks[k] else None}
    renderer = Renderer(ground, AppearanceConfig(**looks[k]), camera, 1, **options)
    shown = renderer.render(T_world_body @ camera.T_body_camera, seconds[k])
    ax.imshow(shown[..., ::-1] if imaging.colour else shown, cmap="gray", vmin=0, vmax=255)
    ax.set(title=titles[k], xticks=[], yticks=[])
