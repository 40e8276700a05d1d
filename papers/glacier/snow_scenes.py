"""Rendered drives over snow and ice for the studies of images: one renderer per scene, pairs of frames along a line."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from papers.glacier.image_measures import Mask, Pair, local_contrast
from sim.config.scene import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.instruments.camera import rover_camera
from sim.rendering import Renderer
from sim.world.scenery import fine_terrain
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.camera.frames import Image
from survey.data.grid import Grid
from survey.terrain import squared_exponential_field

SIDE_M = 160.0
LOW_CONTRAST = 0.03
"""Local contrast of wind-worked snow."""

SKIES: dict[str, dict[str, Any]] = {
    "clear, sun at 25°": {},
    "clear, sun at 18° from the side": {"sun_elevation_deg": 18.0, "sun_from_deg": 140.0},
    "clear, sun at 45°": {"sun_elevation_deg": 45.0},
    "thin cloud": {"sky_share": 0.7},
    "overcast, no mountains": {"sky_share": 1.0, "ridges_deg": 0.0},
    "haze, clean snow": {"debris": 0.0, "haze_m": 500.0},
}
"""Name → how it differs from the default appearance."""


@dataclass(frozen=True)
class SnowScene:
    """A small site under one sky, seen by the default camera.

    Parameters
    ----------
    look : AppearanceConfig
        Light and surface.
    seed : int
        Of ground, texture and noise.
    imaging : ImagingConfig
        The camera.
    scenery : SceneryConfig
        The ground's relief; without crevasses unless said.
    """

    look: AppearanceConfig
    seed: int
    imaging: ImagingConfig = field(default_factory=ImagingConfig)
    scenery: SceneryConfig = field(default_factory=lambda: SceneryConfig(crevasses_per_ha=0.0))

    @cached_property
    def renderer(self) -> Renderer:
        """The scene as the camera sees it."""
        grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 1.0)
        terrain = squared_exponential_field(
            grid, stream(self.seed, "terrain"), relief_m=6.0, length_scale_m=110.0
        )
        ground = fine_terrain(terrain, self.scenery, self.seed)
        return Renderer(
            ground,
            self.look,
            rover_camera(self.imaging),
            self.seed,
            imaging=self.imaging,
            wind_from_deg=self.scenery.wind_from_deg,
        )

    def pose(self, drive: int, along_m: float = 0.0) -> FloatArray:
        """Return T_world_camera on the drive of this number, so far along its straight line."""
        rng = stream(self.seed, "drive", drive)
        yaw, start = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3 * SIDE_M, 0.7 * SIDE_M, 2)
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        place = (start + along_m * ahead)[None]
        # The rover lies level across a metre of ground, not on one cell.
        around = place + 0.4 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
        up = self.renderer.terrain.normal(around).mean(axis=0)
        up /= np.linalg.norm(up)
        left = np.cross(up, [*ahead, 0.0])
        left /= np.linalg.norm(left)
        T_world_body = np.eye(4)
        T_world_body[:3, :3] = np.column_stack([np.cross(left, up), left, up])
        T_world_body[:3, 3] = *place[0], self.renderer.terrain.elevation(around).mean()
        return T_world_body @ self.renderer.camera.T_body_camera

    def frame(self, drive: int, along_m: float = 0.0) -> tuple[Image, Mask]:
        """Return the image there and which of its pixels are ground."""
        pose = self.pose(drive, along_m)
        number = 1000 * drive + round(100.0 * along_m)
        return self.renderer.render(pose, frame_index=number), np.isfinite(self.renderer.depth(pose))

    def pair(self, drive: int, apart_m: float = 0.25) -> Pair:
        """Return two frames some way apart on a drive, with the exact motion between them."""
        first, second = self.pose(drive), self.pose(drive, apart_m)
        images = self.frame(drive)[0], self.frame(drive, apart_m)[0]
        flow, seen = self.renderer.flow(first, second), self.renderer.visible(first, second)
        return Pair(*images, flow, seen & np.isfinite(flow).all(axis=-1))

    def ground_contrast(self, n_drives: int = 3) -> float:
        """Return the local contrast of the ground, median over drives."""
        return float(np.median([local_contrast(*self.frame(drive)) for drive in range(n_drives)]))


def at_contrast(sky: Mapping[str, Any], seed: int, wanted: float = LOW_CONTRAST) -> SnowScene:
    """Return a scene under a sky whose texture is as strong as gives the wanted local contrast."""
    contrast = 1.0
    for _ in range(4):
        scene = SnowScene(AppearanceConfig(**{**sky, "contrast": contrast}), seed)
        found = scene.ground_contrast()
        if abs(found - wanted) < 0.05 * wanted:
            break
        contrast *= float(np.clip((wanted / found) ** 1.3, 0.3, 3.0))
    return scene
