"""Clouds that drift with the wind: seen in the sky, and by their shadows on the ground.

All clouds lie in one plane. A periodic field of their cover moves with the wind as time goes on. The sky reads it where a
ray meets the plane, the ground where the line to the sun does, so that each shadow belongs to a cloud.
"""

from typing import NamedTuple

import cv2
import numpy as np

from sim.config.world import AppearanceConfig
from sim.rendering.compiled import Doubles, Floats, Ints, Words, entry, f32, i32, inlined, row_loop
from sim.rendering.footprint import Footprints, mip_level, tile_at
from sim.rendering.light import Light
from sim.rendering.visibility import RowRays
from sim.world.appearance import pack_tile
from sim.world.fine_terrain import band_limited_field
from survey.core import FloatArray, stream

BASE_M = 1200.0
"""Height of the clouds above the datum [m]."""
_TEXEL_M = 8.0
_TEXELS = 1024
_SIZES_M = 40.0, 2500.0
_SOFTNESS = 1.6
_RELIEF_M = 90.0
"""Distance over which the thickness towards the sun is compared [m]."""
_PENUMBRA_LEVEL = 2
"""Mip level whose texels are as wide as the penumbra of the sun's disk."""
_BLOCKED = 0.85
"""Share of the sunlight that the thickest cloud takes away."""


class CloudLayer(NamedTuple):
    """Cover of the cloud plane as a periodic tile, and its motion."""

    words: Words
    starts: Ints
    mask: int
    gain: float
    mean: float
    """Mean cover; 0 where there are no clouds."""


def clouds_of(look: AppearanceConfig, seed: int) -> CloudLayer:
    """Return the clouds of a scene; a tile of 8 × 8 texels where there are none."""
    if look.clouds == 0.0:
        tile = pack_tile(np.zeros((8, 8), np.float32), 1.0)
        return CloudLayer(tile.words, tile.starts, 7, tile.amplitude, 0.0)
    rng = stream(seed, "appearance", "clouds")
    shape = _TEXELS, _TEXELS
    heaps = band_limited_field(shape, _TEXEL_M, _SIZES_M, 1.9, rng, periodic=True)
    above = heaps - np.quantile(heaps[::4, ::4], 1.0 - look.clouds)
    cover = np.clip(above / _SOFTNESS + 0.15, 0.0, 1.0)
    cover = cv2.GaussianBlur(cover * cover * (3.0 - 2.0 * cover), (0, 0), 0.7).astype(np.float32)
    tile = pack_tile(cover, 1.0 / _TEXEL_M)
    return CloudLayer(tile.words, tile.starts, tile.texels - 1, tile.amplitude, float(cover.mean()))


def drift_m(look: AppearanceConfig, wind_from_deg: float, time_s: float) -> FloatArray:
    """Return how far the clouds have moved to the east and north (2,) at a time [m]."""
    towards = np.radians(270.0 - wind_from_deg)
    return look.cloud_speed_m_s * time_s * np.array([np.cos(towards), np.sin(towards)])


@inlined
def _cover_at(
    x: np.float32, y: np.float32, level: np.int32, clouds: CloudLayer, mean: np.float32, gain: np.float32
) -> np.float32:
    """Interpolate the cover at a place in texels of the finest level."""
    scale = f32(1) / f32(i32(i32(1) << level))
    shift = f32(0.5) * scale - f32(0.5)  # a texel of a coarser level sits half a fine texel to the side
    cells, start = i32(i32(clouds.mask) >> level), clouds.starts[entry(level)]
    return mean + gain * tile_at(x * scale + shift, y * scale + shift, cells, start, clouds.words)


@row_loop
def shade_by_clouds(
    n: int, at: Footprints, rays: RowRays, origin: Doubles, light: Light, clouds: CloudLayer
) -> None:
    """Dim the sunlight on the ground by the clouds in front of the sun."""
    zero, one, per = f32(0), f32(1), f32(1.0 / _TEXEL_M)
    to_x, to_y = f32(light.sun[0] / light.sun[2]), f32(light.sun[1] / light.sun[2])
    ox, oy = f32(origin[0] - light.drift_m[0]), f32(origin[1] - light.drift_m[1])
    base, mean, gain = f32(BASE_M), f32(clouds.mean), f32(clouds.gain)
    for k in range(n):
        c = entry(at.pixel[k])
        r, rise = at.range_m[k], max(base - rays.z[c], zero)
        x, y = ox + at.ux[k] * r + to_x * rise, oy + at.uy[k] * r + to_y * rise
        level = min(max(mip_level(at.width_m[k] * per), i32(_PENUMBRA_LEVEL)), i32(6))
        cover = _cover_at(x * per, y * per, level, clouds, mean, gain)
        at.direct[k] *= one - f32(_BLOCKED) * min(max(cover, zero), one)


@row_loop
def paint_clouds(
    n: int,
    pixel: Ints,
    rays: RowRays,
    origin: Doubles,
    pixel_rad: float,
    haze_m: float,
    light: Light,
    clouds: CloudLayer,
    is_open: Floats,
    painted: Floats,
    opaque: Floats,
) -> None:
    """Paint clouds over the `n` listed pixels, by the share of open sky; towards the horizon they vanish in haze."""
    zero, one, per = f32(0), f32(1), f32(1.0 / _TEXEL_M)
    ox, oy = f32(origin[0] - light.drift_m[0]), f32(origin[1] - light.drift_m[1])
    base, mean, gain = f32(BASE_M - origin[2]), f32(clouds.mean), f32(clouds.gain)
    sun_x, sun_y = f32(_RELIEF_M * light.sun[0]), f32(_RELIEF_M * light.sun[1])
    radians, per_haze = f32(pixel_rad), f32(0.15 / haze_m)
    for k in range(n):
        c = entry(pixel[k])
        slope = max(rays.slope[c], f32(0.01))
        r = base / slope
        stretch = np.sqrt(one + slope * slope)
        # A pixel covers r · angle across and more along the plane; their geometric mean is read.
        width = r * stretch * radians * np.sqrt(stretch / slope)
        x, y = ox + rays.ux[c] * r, oy + rays.uy[c] * r
        level = min(mip_level(width * per), i32(6))
        cover = min(max(_cover_at(x * per, y * per, level, clouds, mean, gain), zero), one)
        clear = np.exp(-r * stretch * per_haze) if rays.slope[c] > f32(0.01) else zero
        # Grey below thick parts, and darker where the cloud thickens towards the sun.
        sunward = _cover_at((x + sun_x) * per, (y + sun_y) * per, level, clouds, mean, gain)
        white = (
            f32(1.0) - f32(0.10) * cover - f32(0.32) * max(min(sunward, one) - f32(0.8) * cover, f32(-0.2))
        )
        opaque[k] = cover * (f32(2) - cover) * clear * is_open[k]
        painted[k] += (white - painted[k]) * opaque[k]
