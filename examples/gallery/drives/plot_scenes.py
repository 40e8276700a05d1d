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

real = real_sample()  # heights of the Shuttle Radar Topography Mission, 75 m apart
east, north = 745_258.0, 4_016_828.0
near = real.window((east - 400.0, north - 400.0, east + 400.0, north + 400.0))
site = smooth_interpolation(near, Grid((east - 60.0, north - 60.0, east + 60.0, north + 60.0), 1.0, real.crs))
ground = fine_terrain(site, SceneryConfig(crevasses_per_ha=0.0), seed=1)

ruts = Ruts((120.0, 120.0), gauge_m=0.45, width_m=0.15, depth_m=0.025, smooth=0.5)
for turn in np.linspace(0.0, 2.0 * np.pi, 400):  # a loop to the north-west of the camera
    x, y = 57.0 + 3.0 * np.cos(turn), 65.0 + 3.0 * np.sin(turn)
    ruts.press(x, y, turn + 0.5 * np.pi)

cos, sin = np.cos(np.radians(115.0)), np.sin(np.radians(115.0))
T_world_body = np.eye(4)
T_world_body[:2, :2] = [[cos, -sin], [sin, cos]]
T_world_body[:3, 3] = east, north, ground.elevation(np.array([[east, north]]))[0]

figure, axes = plt.subplots(3, 2, figsize=(9, 9.5), layout="constrained")
all_on = {"horizon": "terrain", "clouds": 0.35, "haze_m": 8000.0}
views = [
    ("as by default", {}, False, 0.0),
    ("horizon: ground of the raster", {"horizon": "terrain", "haze_m": 8000.0}, False, 0.0),
    ("clouds", all_on, False, 0.0),
    ("clouds, two minutes later", all_on, False, 120.0),
    ("ruts", {**all_on, "ruts": True}, False, 0.0),
    ("colour", {**all_on, "ruts": True}, True, 0.0),
]
for ax, (title, settings, is_coloured, time_s) in zip(axes.ravel(), views, strict=True):
    imaging = ImagingConfig(width=480, height=320, pitch_down_deg=8.0, colour=is_coloured)
    camera, look = rover_camera(imaging), AppearanceConfig(**settings)
    around = real if look.horizon else None
    renderer = Renderer(
        ground, look, camera, seed=1, imaging=imaging, surroundings=around, ruts=ruts if look.ruts else None
    )
    image = renderer.render(T_world_body @ camera.T_body_camera, time_s)
    ax.imshow(image[..., ::-1] if is_coloured else image, cmap="gray", vmin=0, vmax=255)
    ax.set(title=title, xticks=[], yticks=[])
