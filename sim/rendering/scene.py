"""What is constant from frame to frame: surface, lit ground, textures of snow and of rough ground, and what is around."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.config.world import AppearanceConfig
from sim.rendering.clouds import CloudLayer, clouds_of
from sim.rendering.compiled import Ints, Words
from sim.rendering.far_ground import FarGround, far_ground
from sim.rendering.light import Backdrop, GroundMap, backdrop, ground_map, mipmap
from sim.rendering.visibility import Surface, surface_of
from sim.world.appearance import (
    ROUGH_ALBEDO,
    Tile,
    downhill_rad,
    grain_tile,
    gravel_tile,
    pack_tile,
    rough_tile,
    snow_on_rough_ground,
    snow_patches,
    surface_tile,
)
from sim.world.fine_terrain import FineTerrain
from sim.world.surroundings import horizon_deg, surroundings_of
from survey import Dem

_EDGE_OF_SIGHT_M = 60000.0
"""Distance of the backdrop behind the ground around a site [m]."""
_IN_SHADE = np.uint32(0xFFFFF000)
"""Keeps skylight and water of the words of a `GroundMap`, and no sunlight."""


class Texture(NamedTuple):
    """A periodic tile for the compiled loops."""

    words: Words
    starts: Ints
    mask: int
    per_m: float
    gain: float


class RoughGround(NamedTuple):
    """Texture and albedo of bare ice or debris, and the share of snow on it."""

    tile: Texture
    albedo: float
    snow: Words
    """The share in the place of the water, laid out as the `GroundMap`; one word where all is snow."""


class RenderScene(NamedTuple):
    """Data that are constant from frame to frame."""

    surface: Surface
    ground: GroundMap
    snow: Texture
    grain: Texture
    rough: RoughGround
    backdrop: Backdrop
    far: FarGround
    clouds: CloudLayer


def scene_of(
    terrain: FineTerrain,
    datum: float,
    look: AppearanceConfig,
    wind_from_deg: float,
    seed: int,
    surroundings: Dem | None = None,
) -> RenderScene:
    """Return what is constant from frame to frame: surface, ground map, textures, backdrop, ground around the site."""
    around = None
    if surroundings is not None:
        around = surroundings_of(surroundings, terrain, datum, look, seed)
    rows, columns = terrain.height.shape
    centre = 0.5 * terrain.step_m * np.array([columns - 1, rows - 1])
    # What needs much memory while it is made comes first.
    far = far_ground(around, look)
    bare_sky = {"ridges_deg": 0.0, "ridges_distance_m": _EDGE_OF_SIGHT_M}
    sky = look if around is None else look.model_copy(update=bare_sky)
    scenery = backdrop(sky, centre, seed, ROUGH_ALBEDO.get(terrain.surface, 1.0))
    snow, fine = surface_tile(look, wind_from_deg, seed), grain_tile(look, seed)
    if terrain.surface != "snow":
        fine = (
            gravel_tile(look, seed)
            if terrain.surface == "debris"
            else replace(fine, amplitude=3.0 * fine.amplitude)
        )
    surface = surface_of(terrain, datum)
    patches = snow_patches((rows, columns), terrain.step_m, look, seed)
    lit, rough = ground_map(terrain, surface.height, patches, look), _rough_ground(terrain, look, seed)
    if around is not None and horizon_deg(around, np.array([look.sun_from_deg]))[0] > look.sun_elevation_deg:
        lit = lit._replace(words=lit.words & _IN_SHADE)
    clouds = clouds_of(look, seed)
    return RenderScene(surface, lit, _texture(snow), _texture(fine), rough, scenery, far, clouds)


def _rough_ground(terrain: FineTerrain, look: AppearanceConfig, seed: int) -> RoughGround:
    if terrain.surface == "snow":
        return RoughGround(
            _texture(pack_tile(np.zeros((8, 8), np.float32), 1.0)), 1.0, np.zeros(1, np.uint32)
        )
    tile = rough_tile(terrain.surface, look, downhill_rad(terrain.height), seed)
    share = snow_on_rough_ground(terrain.height, terrain.step_m, terrain.snow_cover, seed)[::-1]
    words = np.rint(255.0 * share).astype(np.uint32) << np.uint32(24)
    return RoughGround(_texture(tile), ROUGH_ALBEDO[terrain.surface], mipmap(words).words)


def _texture(tile: Tile) -> Texture:
    return Texture(tile.words, tile.starts, tile.texels - 1, tile.texels_per_m, tile.amplitude)
