"""Mid-ground and mountains: the ground around the site as a second height field behind the fine terrain.

The same sweep, root search and texture sampling are used as on the fine terrain, so that near and far ground move against
each other as their distances require. Haze thins out with height.
"""

import math
from typing import NamedTuple

import numpy as np

from sim.config.world import AppearanceConfig
from sim.rendering.compiled import Floats, entry, f32, row_loop
from sim.rendering.footprint import Footprints
from sim.rendering.light import AMBIENT_UNIT, DIRECT_UNIT, HAZE_RADIANCE, GroundMap, mipmap
from sim.rendering.visibility import NEAR_HORIZON, RowRays, Surface, View, surface_on
from sim.world.surroundings import SiteSurroundings, sunlight_on

HAZE_HEIGHT_M = 350.0
"""Height over which haze thins out to 1/e [m]."""
_SLOPES = -0.5, 1.7


class FarGround(NamedTuple):
    """Ground around the site for the compiled loops."""

    surface: Surface
    ground: GroundMap
    """Sunlight and skylight of every node, and the share of rock in the place of the water."""
    x: float
    """Place of the south-western node relative to that of the fine terrain [m]."""
    y: float
    reach_m: float
    """Farthest range; 0 where there is no far ground."""


def far_ground(around: SiteSurroundings | None, look: AppearanceConfig) -> FarGround:
    """Return the lit ground around a site; an empty one of 2 × 2 nodes for None."""
    if around is None:
        blank = np.zeros((2, 2), np.float32)
        return FarGround(surface_on(blank, 1.0), mipmap(np.zeros((2, 2), np.uint32)), 0.0, 0.0, 0.0)
    direct = np.float32((1.0 - look.sky_share) * DIRECT_UNIT) * sunlight_on(around, look) * around.albedo
    ambient = np.float32(look.sky_share * AMBIENT_UNIT) * around.albedo
    parts = [
        np.rint(np.clip(part, 0.0, most)).astype(np.uint32)
        for part, most in ((direct, 4095), (ambient, 4095), (255.0 * around.rock, 255))
    ]
    words = parts[0] | (parts[1] << np.uint32(12)) | (parts[2] << np.uint32(24))
    reach = math.hypot(*around.height.shape) * around.step_m
    x, y = around.origin.tolist()
    return FarGround(surface_on(around.height, around.step_m), mipmap(words), x, y, reach)


def far_ranges(far: FarGround) -> Floats:
    """Return the ranges at which far ground is sampled: half a node apart, from there on 0.5 % of the range [m]."""
    ranges = [0.25 * far.surface.step_m]
    while ranges[-1] < far.reach_m:
        ranges.append(ranges[-1] + max(0.5 * far.surface.step_m, 0.005 * ranges[-1]))
    return np.array(ranges, np.float32)


def far_view(view: View, n_rows: int) -> View:
    """Return a view with rows from slightly below the horizon to the highest mountains."""
    first, last = (slope / (NEAR_HORIZON + abs(slope)) for slope in _SLOPES)
    return view._replace(first_row=first, row_step=(last - first) / (n_rows - 1))


@row_loop
def shade_far(n: int, at: Footprints, rays: RowRays, in_shade: float, haze_m: float) -> None:
    """Compute the radiance of far ground in sun, skylight and haze that thins out with height.

    The optical depth of a path that rises by z is (path / haze) (1 - exp(-z / H)) / (z / H). The share of rock comes from
    `at.water`, which becomes 0; rock is rougher than snow. Leaves the shares of rock and of clear air as weights.
    """
    in_shade, per_haze, per_height = f32(in_shade), f32(1.0 / haze_m), f32(1.0 / HAZE_HEIGHT_M)
    one = f32(1)
    for k in range(n):
        rock = at.water[k] * f32(1.0 / 255.0)
        direct, ambient = at.direct[k] * f32(1.0 / DIRECT_UNIT), at.ambient[k] * f32(1.0 / AMBIENT_UNIT)
        texture = at.texture[k] * (one + f32(4) * rock)
        rise = max(rays.slope[entry(at.pixel[k])] * at.range_m[k] * per_height, f32(1e-3))
        thin = (one - np.exp(-rise)) / rise
        clear = np.exp(-at.path_m[k] * per_haze * thin)
        ground = direct * max(f32(0), one + texture) + ambient * max(one + in_shade * texture, f32(0))
        at.direct[k], at.ambient[k], at.texture[k], at.water[k] = direct, ambient, texture, f32(0)
        at.weight0[k], at.weight1[k] = rock, clear
        at.radiance[k] = ground * clear + f32(HAZE_RADIANCE) * (one - clear)
