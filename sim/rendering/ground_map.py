"""Ground map: precomputed sunlight, cast shadows and skylight on every node, with a mipmap."""

import math
from typing import NamedTuple

import numpy as np

from sim.config.scene import AppearanceConfig
from sim.rendering.compiled import Doubles, Floats, Ints, Words, by_share, f32, scalar, share_out, u32
from sim.world.appearance import sun_direction
from sim.world.fine_terrain import FineTerrain

DIRECT_UNIT = 2048.0
AMBIENT_UNIT = 4096.0
_SHADOW_REACH_M = 60.0
_PENUMBRA = 0.02
_LEVELS = 7


class GroundMap(NamedTuple):
    """One word per node and mip level: sunlight (12 bits), skylight (12 bits), water (8 bits)."""

    words: Words
    starts: Ints
    """Index of each level's first word."""
    widths: Ints
    heights: Ints


def ground_map(terrain: FineTerrain, height: Floats, patches: Floats, config: AppearanceConfig) -> GroundMap:
    """Return the map of a lit terrain; `height` and `patches` (share of clean snow's reflectance) begin in the south."""
    south_up = (np.ascontiguousarray(grid[::-1]) for grid in (terrain.tone, terrain.openness, terrain.water))
    words = np.empty(height.shape, np.uint32)
    share_out(
        _light, height, *south_up, patches, terrain.step_m, sun_direction(config), config.sky_share, words
    )
    levels: list[Words] = [words]
    while len(levels) < _LEVELS:
        rows, columns = (max(int(n) // 2, 2) for n in levels[-1].shape)
        coarser = np.empty((rows, columns), np.uint32)
        share_out(_halve, levels[-1], coarser)
        levels.append(coarser)
    starts = np.cumsum([0] + [level.size for level in levels[:-1]]).astype(np.int32)
    widths, heights = (np.array([level.shape[k] for level in levels], np.int32) for k in (1, 0))
    return GroundMap(np.concatenate([level.ravel() for level in levels]), starts, widths, heights)


@by_share
def _light(
    worker: int,
    n_workers: int,
    height: Floats,
    tone: Floats,
    openness: Floats,
    water: Floats,
    patches: Floats,
    step_m: float,
    sun: Doubles,
    sky_share: float,
    words: Words,
) -> None:
    """Return the radiance of each node by the sun (Lambert's law, relative to level ground) and by the sky."""
    rows, columns = height.shape
    half = f32(0.5 / step_m)
    sx, sy, sz = f32(sun[0]), f32(sun[1]), f32(sun[2])
    for j in range(worker, rows, n_workers):
        for i in range(columns):
            west, east = max(i - 1, 0), min(i + 1, columns - 1)
            south, north = max(j - 1, 0), min(j + 1, rows - 1)
            gx, gy = (height[j, east] - height[j, west]) * half, (height[north, i] - height[south, i]) * half
            lit = max((sz - gx * sx - gy * sy) / (sz * math.sqrt(f32(1) + gx * gx + gy * gy)), f32(0))
            albedo = f32(tone[j, i]) * f32(1.0 / 255.0) * patches[j, i]
            seen = f32(openness[j, i]) * f32(1.0 / 255.0)
            direct = f32(0)
            if lit > f32(0):
                sunlight = _sunlit(height, i, j, step_m, sun)
                direct = (
                    f32(1.0 - sky_share) * min(lit, f32(1.3)) * albedo * sunlight * min(f32(1), seen * f32(2))
                )
            ambient = f32(sky_share) * albedo * seen
            d = u32(min(direct * f32(DIRECT_UNIT) + f32(0.5), f32(4095)))
            a = u32(min(ambient * f32(AMBIENT_UNIT) + f32(0.5), f32(4095)))
            words[j, i] = d | (a << u32(12)) | (u32(water[j, i]) << u32(24))


@by_share
def _halve(worker: int, n_workers: int, fine: Words, coarse: Words) -> None:
    """Return means of 2 × 2 words, of each of the three parts by itself."""
    rows, columns = coarse.shape
    for j in range(worker, rows, n_workers):
        for i in range(columns):
            direct, ambient, water = u32(2), u32(2), u32(2)
            for k in range(4):
                word = fine[min(2 * j + k // 2, fine.shape[0] - 1), min(2 * i + k % 2, fine.shape[1] - 1)]
                direct += word & u32(4095)
                ambient += (word >> u32(12)) & u32(4095)
                water += word >> u32(24)
            coarse[j, i] = (
                (direct >> u32(2)) | ((ambient >> u32(2)) << u32(12)) | ((water >> u32(2)) << u32(24))
            )


@scalar
def _sunlit(height: Floats, i: int, j: int, step_m: float, sun: Doubles) -> float:
    """Return the visible share of the sun's disk at a node, by the highest terrain towards it."""
    rows, columns = height.shape
    level = math.hypot(sun[0], sun[1])
    if level < 1e-6:
        return f32(1)
    dx, dy, climb = f32(sun[0] / level), f32(sun[1] / level), f32(sun[2] / level)
    per_step, z = f32(1.0 / step_m), height[j, i]
    most, r = f32(-1e9), f32(0.35)
    while r < f32(_SHADOW_REACH_M):
        u, v = f32(i) + dx * r * per_step, f32(j) + dy * r * per_step
        a, b = int(u), int(v)
        if u < 0 or v < 0 or a >= columns - 1 or b >= rows - 1:
            break
        s, t = u - f32(a), v - f32(b)
        south = height[b, a] + (height[b, a + 1] - height[b, a]) * s
        north = height[b + 1, a] + (height[b + 1, a + 1] - height[b + 1, a]) * s
        most = max(most, (south + (north - south) * t - z) / r - climb)
        r += f32(0.25) + f32(0.06) * r
    return min(max(f32(0.5) - most * f32(1.0 / _PENUMBRA), f32(0)), f32(1))
