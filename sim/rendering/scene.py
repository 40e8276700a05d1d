"""Render scene: rays of the camera, surface, ground map, textures and backdrop."""

import numpy as np

from sim.config.scene import AppearanceConfig
from sim.rendering.backdrop import backdrop
from sim.rendering.compiled import Doubles
from sim.rendering.ground_map import ground_map
from sim.rendering.rows import Lens, RenderScene, Texture
from sim.rendering.surface import surface_of
from sim.world.appearance import Tile, grain_tile, snow_patches, surface_tile
from sim.world.fine_terrain import FineTerrain
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera


def lens_of(camera: Camera) -> Lens:
    """Return the rays of all pixels of a camera; refuse pixels without one."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()])).reshape(camera.height, camera.width, 3)
    if not np.isfinite(rays).all():
        raise InputError("some pixels of the camera have no ray (90° or more off the axis); narrow the lens.")
    x, y, z = (np.ascontiguousarray(rays[..., k], dtype=np.float32) for k in range(3))
    return Lens(x, y, z, 1.0 / float(camera.matrix[0, 0]))


def scene_of(
    terrain: FineTerrain, datum: float, look: AppearanceConfig, wind_from_deg: float, seed: int
) -> RenderScene:
    """Return what is constant from frame to frame: surface, ground map, textures, backdrop."""
    rows, columns = terrain.height.shape
    centre = 0.5 * terrain.step_m * np.array([columns - 1, rows - 1])
    # What needs much memory while it is made comes first.
    scenery = backdrop(look, centre, seed)
    snow, grain = _texture(surface_tile(look, wind_from_deg, seed)), _texture(grain_tile(look, seed))
    surface = surface_of(terrain, datum)
    patches = snow_patches((rows, columns), terrain.step_m, look, seed)
    return RenderScene(surface, ground_map(terrain, surface.height, patches, look), snow, grain, scenery)


def _texture(tile: Tile) -> Texture:
    return Texture(tile.words, tile.starts, tile.texels - 1, tile.texels_per_m, tile.amplitude)


def edge_rays(lens: Lens) -> Doubles:
    """Return the rays along the image's edges, which bound all others."""
    rays = np.stack([lens.x, lens.y, lens.z], axis=-1)
    around = np.concatenate([rays[0], rays[-1], rays[:, 0], rays[:, -1]])
    return around.astype(np.float64)
