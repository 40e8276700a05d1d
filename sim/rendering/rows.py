"""Rows of an image: rays, surface lookup and shading, in parallel threads."""

from typing import NamedTuple

import numpy as np

from sim.rendering.backdrop import Backdrop, backdrop_row
from sim.rendering.compiled import Doubles, Floats, Ints, Words, by_share, f32, i32, row_loop, scalar, u32
from sim.rendering.footprint import (
    GRAIN_FROM_M,
    Aim,
    Footprints,
    aim,
    lattice,
    measure,
    read_map,
    read_tile,
)
from sim.rendering.ground_map import GroundMap
from sim.rendering.light import OWN_SHADOW_REACH_M, Light, add_shadow_and_water, shade, shadow_width_m2
from sim.rendering.rays import EDGE, FOUND, OUTSIDE, SKY, RowRays, meet_ground
from sim.rendering.surface import Surface, first_hit, height_and_gradient
from sim.rendering.sweep import View

_ROWS_AT_ONCE = 8
_FARTHEST_M = 3000.0
_ROUNDED_M2 = 0.01


class Lens(NamedTuple):
    """Unit directions of all pixels in the camera frame, (H, W) each, and the angle of one pixel."""

    x: Floats
    y: Floats
    z: Floats
    pixel_rad: float


class Texture(NamedTuple):
    """A periodic tile for the compiled loops."""

    words: Words
    starts: Ints
    mask: int
    per_m: float
    gain: float


class RenderScene(NamedTuple):
    """Data that are constant from frame to frame."""

    surface: Surface
    ground: GroundMap
    snow: Texture
    grain: Texture
    backdrop: Backdrop


@by_share
def render_rows(
    worker: int,
    n_workers: int,
    lens: Lens,
    rotations: Doubles,
    origins: Doubles,
    view: View,
    table: Floats,
    scene: RenderScene,
    light: Light,
    most_taps: int,
    shaded: bool,
    radiance: Floats,
    depth: Floats,
) -> None:
    """Fill radiance and depth (along the ray, -1 for sky), (H, W); each row has its own pose."""
    n_rows, width = lens.x.shape
    f, n = np.empty((35, width), np.float32), np.empty((11, width), np.int32)
    rays = RowRays(f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8], n[0])
    at = Footprints(
        f[9], f[10], f[11], f[12], f[13], f[14], f[15], f[16], f[17], f[18], f[19], f[20], f[21], f[22], f[23],
        f[24], f[25], f[26], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8],
    )  # fmt: skip
    to = Aim(f[27], f[28], f[29], f[30], f[31], f[32], f[33], f[34], n[9], n[10])
    height, flat_table = scene.surface.height, table.ravel()
    flat_height = height.ravel()
    for block in range(worker, (n_rows + _ROWS_AT_ONCE - 1) // _ROWS_AT_ONCE, n_workers):
        for row in range(block * _ROWS_AT_ONCE, min((block + 1) * _ROWS_AT_ONCE, n_rows)):
            meet_ground(
                lens.x[row], lens.y[row], lens.z[row], rotations[row], origins[row], view, flat_table,
                table.shape[1], flat_height, height.shape[1], height.shape[0], scene.surface.step_m, rays,
            )  # fmt: skip
            _paint_row(
                rays,
                at,
                to,
                origins[row],
                scene,
                light,
                lens.pixel_rad,
                most_taps,
                shaded,
                radiance[row],
                depth[row],
            )


@scalar
def _paint_row(
    rays: RowRays,
    at: Footprints,
    to: Aim,
    origin: Doubles,
    scene: RenderScene,
    light: Light,
    pixel_rad: float,
    most_taps: int,
    shaded: bool,
    radiance: Floats,
    depth: Floats,
) -> None:
    walk_edges(rays, scene.surface, origin)
    n_ground = _paint_sky(
        rays, scene.backdrop, origin, shaded, radiance, depth, at.pixel, at.taps, at.radiance
    )
    if n_ground == 0:
        return
    measure(n_ground, rays, origin[0], origin[1], pixel_rad, most_taps, scene.surface.step_m, at)
    if shaded:
        read_surface(n_ground, at, to, scene, origin)
        shade(n_ground, at, light.in_shade, light.haze_m)
        if _is_special(n_ground, at, rays, origin, light, at.taps):
            add_shadow_and_water(n_ground, at, at.taps, rays, origin, light, scene.backdrop)
    for k in range(n_ground):
        radiance[at.pixel[k]] = at.radiance[k]
        depth[at.pixel[k]] = at.path_m[k]


@scalar
def walk_edges(rays: RowRays, surface: Surface, origin: Doubles) -> None:
    """Compute the exact range, or the sky, of pixels that the table cannot decide."""
    for c in range(rays.fate.size):
        if rays.fate[c] != EDGE and rays.fate[c] != OUTSIDE:
            continue
        start, end = 0.0, _FARTHEST_M
        if rays.fate[c] == EDGE:
            start = max(0.7 / rays.nearest[c] - 2.5, 0.0)
            if rays.farthest[c] > 0.0:
                end = 1.03 / rays.farthest[c] + 0.1
        ux, uy, slope = float(rays.ux[c]), float(rays.uy[c]), float(rays.slope[c])
        r = first_hit(surface, origin, ux, uy, slope, start, end)
        if r < 0.0:
            rays.fate[c] = i32(SKY)
            continue
        x, y = origin[0] + ux * r, origin[1] + uy * r
        z, gx, gy = height_and_gradient(surface.height, 1.0 / surface.step_m, x, y)
        rays.range_m[c], rays.z[c], rays.gx[c], rays.gy[c] = f32(r), f32(z), f32(gx), f32(gy)
        rays.fate[c] = i32(FOUND)


@scalar
def _paint_sky(
    rays: RowRays,
    scenery: Backdrop,
    origin: Doubles,
    shaded: bool,
    radiance: Floats,
    depth: Floats,
    ground: Ints,
    sky: Ints,
    painted: Floats,
) -> int:
    """Paint the sky's pixels, list the others, and return how many those are."""
    n = 0
    for c in range(rays.fate.size):
        if rays.fate[c] != SKY:
            ground[n] = c
            n += 1
        else:
            sky[c - n] = c
    # A counter that starts at the literal 0 would have `backdrop_row` compiled twice.
    n_sky = rays.fate.size - n
    for k in range(n_sky):
        depth[u32(sky[k])] = f32(-1)
    if shaded and n_sky:
        x, y = origin[0] - scenery.centre_x, origin[1] - scenery.centre_y
        faces = scenery.faces
        backdrop_row(
            n_sky, sky, rays.ux, rays.uy, rays.slope, faces.ravel(), faces.shape[1], faces.shape[2],
            scenery.distance_m, x, y, origin[2], painted,
        )  # fmt: skip
        for k in range(n_sky):
            radiance[u32(sky[k])] = painted[k]
    return n


@scalar
def read_surface(n: int, at: Footprints, to: Aim, scene: RenderScene, origin: Doubles) -> None:
    """Read light and texture over the footprints."""
    ground, snow, grain = scene.ground, scene.snow, scene.grain
    longest, narrowest = _extremes(n, at)
    lattice(n, at)
    for tap in range(2 if longest > 0.6 else 1):
        read_map(
            tap, n, at, origin[0], origin[1], ground.words, ground.starts, ground.widths, ground.heights,
            scene.surface.step_m,
        )  # fmt: skip
    aim(
        n, at, at.weight0, at.jump0, at.taps, at.level, snow.starts, snow.mask, snow.per_m, snow.gain,
        to, to.x0, to.y0, to.share0,
    )  # fmt: skip
    aim(
        n, at, at.weight1, at.jump1, at.taps, at.level, snow.starts, snow.mask, snow.per_m, snow.gain,
        to, to.x1, to.y1, to.share1,
    )  # fmt: skip
    read_tile(n, at, at.taps, to, snow.words)
    if narrowest >= GRAIN_FROM_M:
        return
    aim(
        n, at, at.grain0, at.jump0, at.grain_taps, at.grain_level, grain.starts, grain.mask, grain.per_m, grain.gain,
        to, to.x0, to.y0, to.share0,
    )  # fmt: skip
    aim(
        n, at, at.grain1, at.jump1, at.grain_taps, at.grain_level, grain.starts, grain.mask, grain.per_m, grain.gain,
        to, to.x1, to.y1, to.share1,
    )  # fmt: skip
    read_tile(n, at, at.grain_taps, to, grain.words)


@row_loop
def _extremes(n: int, at: Footprints) -> tuple[float, float]:
    """Return the longest footprint and narrowest tap of a row."""
    longest, narrowest = f32(0), f32(1e9)
    for k in range(n):
        longest = max(longest, at.length_m[k])
        narrowest = min(narrowest, at.width_m[k])
    return longest, narrowest


@row_loop
def _is_special(n: int, at: Footprints, rays: RowRays, origin: Doubles, light: Light, special: Ints) -> bool:
    """Mark the pixels with a possible shadow of the rover or water; return whether there are any."""
    sx, sy, sz = f32(light.sun[0]), f32(light.sun[1]), f32(light.sun[2])
    ox, oy = f32(origin[0] - light.box_centre[0]), f32(origin[1] - light.box_centre[1])
    oz, wide = f32(light.box_centre[2]), f32(shadow_width_m2(light) + _ROUNDED_M2)
    reach = f32(OWN_SHADOW_REACH_M) if light.box_half_m[0] > 0.0 else f32(-1)
    found = i32(0)
    for k in range(n):
        r = at.range_m[k]
        x, y, z = ox + at.ux[k] * r, oy + at.uy[k] * r, rays.z[u32(at.pixel[k])] - oz
        along = x * sx + y * sy + z * sz
        may_be_shaded = (x * x + y * y + z * z - along * along < wide) & (r < reach)
        special[k] = i32(1) if may_be_shaded | (at.water[k] >= f32(0.001)) else i32(0)
    for k in range(n):
        found = max(found, special[k])
    return found > i32(0)
