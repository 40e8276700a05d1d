"""
Images of the rover's camera
============================

A simulated view of snow with a plain sensor, and with what real sensors add; all of it is off or weak by default.
"""

import numpy as np
from matplotlib import pyplot as plt

from firnline import Dem, Grid
from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer
from sim.simulate.assembly import rover_camera
from sim.world.fine_terrain import fine_terrain

level = Dem.on(Grid((0.0, 0.0, 80.0, 80.0), 1.0), np.zeros((81, 81)))
ground = fine_terrain(level, SceneryConfig(), seed=1)
turned = np.eye(4)
turned[:2, :2] = [[np.cos(0.08), -np.sin(0.08)], [np.sin(0.08), np.cos(0.08)]]
standing = np.eye(4)
turned[:3, 3] = standing[:3, 3] = 20.0, 40.0, ground.elevation(np.array([[20.0, 40.0]]))[0]

figure, axes = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
sensors = [
    ("as by default", {}, False),
    ("exposed while the rover turns by 4.6°", {}, True),
    ("vignetting of 70 %, gain in steps of 1 EV", {"vignetting": 0.7, "gain_step_ev": 1.0}, False),
    ("drops on the lens, JPEG of quality 10", {"drops": 8, "jpeg_quality": 10}, False),
]
for ax, (title, settings, moves) in zip(axes.ravel(), sensors, strict=True):
    imaging = ImagingConfig(width=320, height=240, **settings)
    camera = rover_camera(imaging)
    views = [pose @ camera.T_body_camera for pose in (standing, turned)]
    renderer = Renderer(ground, AppearanceConfig(), camera, seed=1, imaging=imaging)
    image = renderer.render(views[0], T_world_camera_exposed=views[1] if moves else None)
    ax.imshow(image, cmap="gray", vmin=0, vmax=255)
    ax.set(title=title, xticks=[], yticks=[])
