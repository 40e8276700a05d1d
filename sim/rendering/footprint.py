"""Pixel footprints: the part of the surface that each pixel covers, and anisotropic texture sampling.

A pixel's footprint is a strip along the line of sight. Up to a few taps are spread over it,
each from the level of the mipmap that fits their distance. The fine texture is a periodic tile;
at every place two copies of it are mixed, moved by the hashed numbers of the two nearest
corners of a triangular lattice (after Heitz and Neyret, 2018, who mix three), so that it
never repeats.
"""

from typing import NamedTuple

import numpy as np

from sim.rendering.compiled import (
    Floats,
    Ints,
    Words,
    entry,
    f32,
    fused,
    hash32,
    i32,
    inlined,
    row_loop,
    u32,
    u64,
)
from sim.rendering.visibility import RowRays

LATTICE_M = 6.0
"""Side of the triangles in which the texture keeps one position."""
GRAIN_FROM_M = 0.012
"""Footprint below which the grain of the snow is seen."""
_AT_ONCE = 64
"""Pixels of a row whose taps are read together, as many as the one with most of them has."""


class Footprints(NamedTuple):
    """The ground pixels of one row, without gaps between them."""

    range_m: Floats
    path_m: Floats
    """Distance along the ray."""
    x: Floats
    """Where the texture is read."""
    y: Floats
    ux: Floats
    uy: Floats
    length_m: Floats
    """Of the footprint along the line of sight."""
    spacing_m: Floats
    """Between the taps."""
    width_m: Floats
    """That a tap stands for."""
    weight0: Floats
    """Of the two copies of the texture."""
    weight1: Floats
    grain0: Floats
    """The same for the grain, which fades with distance."""
    grain1: Floats
    texture: Floats
    """Relative change of brightness by all that is finer than the map."""
    direct: Floats
    """Radiance by sunlight."""
    ambient: Floats
    """Radiance by skylight."""
    water: Floats
    """Share of water."""
    radiance: Floats
    pixel: Ints
    """Column in the image."""
    taps: Ints
    grain_taps: Ints
    level: Ints
    """Of the texture's mipmap."""
    grain_level: Ints
    map_level: Ints
    jump0: Ints
    """Hashed numbers of the two corners."""
    jump1: Ints


class Aim(NamedTuple):
    """Sampling points of one tile in texels of the level that is read, pixel by pixel."""

    step_x: Floats
    """From tap to tap."""
    step_y: Floats
    x0: Floats
    """First tap in the copy of the first corner, and of the second."""
    y0: Floats
    x1: Floats
    y1: Floats
    share0: Floats
    """Weight of one tap of each copy."""
    share1: Floats
    cells: Ints
    """One less than the side of the level, a mask."""
    start: Ints
    """Of the level's words."""


@inlined
def mip_level(size: np.float32) -> np.int32:
    """Return the mip level of a size in texels: the next power of two above the size over the square root of 2."""
    s = size * f32(0.7071)
    low = i32(s > f32(1)) + i32(s > f32(2)) + i32(s > f32(4)) + i32(s > f32(8))
    return i32(low + i32(s > f32(16)) + i32(s > f32(32)) + i32(s > f32(64)) + i32(s > f32(128)))


@row_loop
def measure(
    n: int,
    rays: RowRays,
    ox: float,
    oy: float,
    pixel_rad: float,
    most_taps: float,
    step_m: float,
    at: Footprints,
) -> None:
    """Measure the footprints of the `n` pixels listed in `at.pixel`."""
    zero, one = f32(0), f32(1)
    ox, oy, pixel, most, per_step = f32(ox), f32(oy), f32(pixel_rad), f32(most_taps), f32(1.0 / step_m)
    for k in range(n):
        c = entry(at.pixel[k])
        r, slope, ux, uy = rays.range_m[c], rays.slope[c], rays.ux[c], rays.uy[c]
        gx, gy, z = rays.gx[c], rays.gy[c], rays.z[c]
        stretch = np.sqrt(one + slope * slope)
        path = r * stretch
        upright = one / np.sqrt(one + gx * gx + gy * gy)
        facing = max((ux * gx + uy * gy - slope) / stretch * upright, f32(0.02))
        across = path * pixel
        along = across / facing
        taps = max(min(most, np.ceil(one / facing - f32(0.3))), one)
        at.range_m[k], at.path_m[k], at.ux[k], at.uy[k] = r, path, ux, uy
        at.length_m[k], at.spacing_m[k] = along, along / taps
        width = max(across, along / taps)
        at.width_m[k], at.taps[k] = width, i32(taps)
        at.grain_taps[k] = i32(min(taps, f32(2))) if width < f32(GRAIN_FROM_M) else i32(0)
        # Steep walls would smear a texture seen from above: there the height shifts it.
        wall = upright < f32(0.45)
        at.x[k] = ox + ux * r + (f32(0.37) * z if wall else zero)
        at.y[k] = oy + uy * r + (f32(1.90) * z if wall else zero)
        at.level[k], at.grain_level[k] = mip_level(width * f32(100)), min(mip_level(width * f32(400)), i32(4))
        on_map = max(across, along * (f32(0.5) if along > f32(0.6) else one)) * per_step
        at.map_level[k] = min(mip_level(on_map * f32(0.943)), i32(6))
        at.texture[k], at.direct[k], at.ambient[k], at.water[k] = zero, zero, zero, zero


@row_loop
def lattice(n: int, at: Footprints) -> None:
    """Find the nearer two corners of the lattice triangle around each place, their weights and hashes.

    A corner weighs the cube of what it exceeds the farthest one in barycentric coordinates
    (narrow seams); the squares add up to 1, so that the mix has the variance of the tile.
    """
    zero, one = f32(0), f32(1)
    # A copy of the tile with a random offset at every corner: the tile's repetition is not seen, nor tracked.
    for k in range(n):
        x, y = at.x[k], at.y[k]
        u = (x - f32(0.57735027) * y) * f32(1.0 / LATTICE_M)
        v = f32(1.1547005) * y * f32(1.0 / LATTICE_M)
        fu, fv = u - np.floor(u), v - np.floor(v)
        i, j = i32(np.floor(u)), i32(np.floor(v))
        upper = fu + fv >= one
        shift = i32(1) if upper else i32(0)
        w0 = fu + fv - one if upper else one - fu - fv
        w1 = one - fv if upper else fu
        w2 = one - fu if upper else fv
        least = min(w0, w1, w2)
        not0, not2 = w0 <= least, w2 <= least
        wa, wb = (w1 if not0 else w0) - least, (w1 if not2 else w2) - least
        wa, wb = wa * wa * wa, wb * wb * wb
        norm = one / np.sqrt(wa * wa + wb * wb + f32(1e-24))
        wa, wb = wa * norm, wb * norm
        near = min(max((f32(GRAIN_FROM_M) - at.width_m[k]) * f32(150), zero), one)
        at.weight0[k], at.weight1[k] = wa, wb
        at.grain0[k], at.grain1[k] = wa * near, wb * near
        east0, north0 = (i + i32(1), j) if not0 else (i + shift, j + shift)
        east1, north1 = (i + i32(1), j) if not2 else (i, j + i32(1))
        at.jump0[k], at.jump1[k] = i32(hash32(east0, north0)), i32(hash32(east1, north1))


@row_loop
def aim(
    n: int,
    at: Footprints,
    weight0: Floats,
    weight1: Floats,
    taps: Ints,
    level: Ints,
    starts: Ints,
    mask: int,
    per_m: float,
    gain: float,
    to: Aim,
) -> None:
    """Compute sampling points and weights of the taps in both corners' copies of a tile."""
    half, per, amplitude, low, centimetre = f32(0.5), f32(per_m), f32(gain), u32(2047), f32(0.01)
    for k in range(n):
        lv = level[k]
        scale = per / f32(i32(i32(1) << lv))
        # A texel of a coarser level sits half a fine texel to the side.
        shift = half * scale / per - half
        to.cells[k], to.start[k] = i32(i32(mask) >> lv), starts[entry(lv)]
        spacing, count = at.spacing_m[k] * scale, f32(taps[k])
        step_x, step_y = at.ux[k] * spacing, at.uy[k] * spacing
        back = half * (count - f32(1))
        x, y = at.x[k] * scale + shift - back * step_x, at.y[k] * scale + shift - back * step_y
        moved = scale * centimetre
        h0, h1 = u32(at.jump0[k]), u32(at.jump1[k])
        to.step_x[k], to.step_y[k] = step_x, step_y
        to.x0[k] = x + f32(i32(h0 & low)) * moved
        to.y0[k] = y + f32(i32((h0 >> u32(11)) & low)) * moved
        to.x1[k] = x + f32(i32(h1 & low)) * moved
        to.y1[k] = y + f32(i32((h1 >> u32(11)) & low)) * moved
        per_tap = amplitude / max(count, f32(1))
        to.share0[k], to.share1[k] = weight0[k] * per_tap, weight1[k] * per_tap


@row_loop
def to_level(n: int, at: Footprints, per_m: float) -> None:
    """Choose the levels of a tile with that number of texels per metre."""
    per = f32(per_m)
    for k in range(n):
        at.level[k] = mip_level(at.width_m[k] * per)


@row_loop
def lay_snow(n: int, at: Footprints, albedo: float) -> None:
    """Combine the texture of ground without snow with patches of snow, whose share is in `at.water`.

    Snow lies between stones: the edge of a patch follows the texture. Afterwards the texture holds the reflectance as a
    share of snow's, less 1, and the weights of the snow's own texture are those of its share.
    """
    zero, half, one, albedo = f32(0), f32(0.5), f32(1), f32(albedo)
    for k in range(n):
        rough = at.texture[k]
        share = at.water[k] * f32(1.0 / 255.0)
        snow = min(max(half + f32(3) * (share - half) - rough, zero), one)
        bare = albedo * (one - snow)
        at.texture[k] = snow + bare * (one + rough) - one
        at.weight0[k], at.weight1[k] = at.weight0[k] * snow, at.weight1[k] * snow
        grain = f32(0.12) * snow + bare  # snow is smoother than gravel and the crust of ice
        at.grain0[k], at.grain1[k] = at.grain0[k] * grain, at.grain1[k] * grain
        at.water[k] = zero


@row_loop
def read_tile(n: int, at: Footprints, taps: Ints, to: Aim, words: Words) -> None:
    """Add all taps of both corners' copies of a tile to the texture."""
    zero = f32(0)
    for first in range(0, n, _AT_ONCE):
        last = min(first + _AT_ONCE, n)
        most = i32(0)
        for q in range(last - first):
            most = max(most, taps[u64(first + q)])
        for tap in range(most):
            number = f32(tap)
            for q in range(last - first):
                k = u64(first + q)
                is_read = i32(tap) < taps[k]
                step_x, step_y, cells, start = to.step_x[k], to.step_y[k], to.cells[k], to.start[k]
                first_copy = tile_at(
                    fused(number, step_x, to.x0[k]), fused(number, step_y, to.y0[k]), cells, start, words
                )
                second_copy = tile_at(
                    fused(number, step_x, to.x1[k]), fused(number, step_y, to.y1[k]), cells, start, words
                )
                texture = at.texture[k] + (to.share0[k] if is_read else zero) * first_copy
                at.texture[k] = texture + (to.share1[k] if is_read else zero) * second_copy


@inlined
def tile_at(x: np.float32, y: np.float32, cells: np.int32, start: np.int32, words: Words) -> np.float32:
    """Interpolate a level of a tile: words of 2 × 2 texels in blocks of 4 × 4 words."""
    low = u32(255)
    fx, fy = np.floor(x), np.floor(y)
    a, b = x - fx, y - fy
    i, j = i32(i32(fx) & cells), i32(i32(fy) & cells)
    block, within = i32(i32(i32(j & i32(-4)) * i32(cells + i32(1))) + i32(i32(i & i32(-4)) << i32(2))), i32(3)
    word = words[entry(i32(i32(block + i32(i32(j & within) << i32(2))) + i32(i32(i & within) + start)))]
    p0, p1 = i32(word & low), i32((word >> u32(8)) & low)
    p2, p3 = i32((word >> u32(16)) & low), i32(word >> u32(24))
    south = f32(i32(p1 - p0)) * a + f32(p0)
    north = f32(i32(p3 - p2)) * a + f32(p2)
    return (north - south) * b + (south - f32(128))


@row_loop
def read_map(
    tap: int,
    n: int,
    at: Footprints,
    ox: float,
    oy: float,
    words: Words,
    starts: Ints,
    columns: int,
    rows: int,
    step_m: float,
) -> None:
    """Add tap 0 or 1 of the map of sunlight (12 bits), skylight (12 bits) and water (8 bits)."""
    zero, half, one = f32(0), f32(0.5), f32(1)
    ox, oy, per_step = f32(ox), f32(oy), f32(1.0 / step_m)
    all_columns, all_rows = i32(columns), i32(rows)
    for k in range(n):
        long = at.length_m[k] > f32(0.6)
        offset = (f32(tap) - half) * half * at.length_m[k] if long else zero
        share = half if long else (one if tap == 0 else zero)
        lv = at.map_level[k]
        width, height = max(i32(all_columns >> lv), i32(2)), max(i32(all_rows >> lv), i32(2))
        scale = per_step / f32(i32(i32(1) << lv))
        shift = half - half * scale / per_step
        r = at.range_m[k] + offset
        u = min(max((ox + at.ux[k] * r) * scale - shift, zero), f32(width) - f32(1.001))
        v = min(max((oy + at.uy[k] * r) * scale - shift, zero), f32(height) - f32(1.001))
        i, j = i32(u), i32(v)
        a, b = u - f32(i), v - f32(j)
        p = i32(i32(starts[entry(lv)] + i32(j * width)) + i)
        k0, k1 = words[entry(p)], words[entry(i32(p + i32(1)))]
        p = i32(p + width)
        k2, k3 = words[entry(p)], words[entry(i32(p + i32(1)))]
        w3 = a * b * share
        w1, w2 = a * share - w3, b * share - w3
        w0 = share - w1 - w2 - w3
        low, mid = u32(4095), u32(12)
        at.direct[k] += (
            f32(i32(k0 & low)) * w0
            + f32(i32(k1 & low)) * w1
            + f32(i32(k2 & low)) * w2
            + f32(i32(k3 & low)) * w3
        )
        at.ambient[k] += (
            f32(i32((k0 >> mid) & low)) * w0
            + f32(i32((k1 >> mid) & low)) * w1
            + f32(i32((k2 >> mid) & low)) * w2
            + f32(i32((k3 >> mid) & low)) * w3
        )
        at.water[k] += (
            f32(i32(k0 >> u32(24))) * w0
            + f32(i32(k1 >> u32(24))) * w1
            + f32(i32(k2 >> u32(24))) * w2
            + f32(i32(k3 >> u32(24))) * w3
        )
