"""Shading: radiance from surface samples by sun, sky, haze, open water and the rover's shadow."""

import math
from typing import NamedTuple

from sim.rendering.backdrop import HAZE_RADIANCE, Backdrop, backdrop_radiance
from sim.rendering.compiled import Doubles, Ints, f32, row_loop, scalar
from sim.rendering.footprint import Footprints
from sim.rendering.ground_map import AMBIENT_UNIT, DIRECT_UNIT
from sim.rendering.rays import RowRays

OWN_SHADOW_REACH_M = 12.0


class Light(NamedTuple):
    """Sun, air, and the box whose shadow falls on the ground."""

    sun: Doubles
    """Unit vector towards the sun."""
    sky_share: float
    in_shade: float
    """Radiance that texture adds under the sky alone: albedo shows there, the sun's shading does not."""
    haze_m: float
    box_half_m: Doubles
    """Half the sides of the rover's box [m]; zeros for none."""
    box_rotation: Doubles
    """From the box's axes to the world's, (3, 3)."""
    box_centre: Doubles


@scalar
def hazed(radiance: float, path_m: float, haze_m: float) -> float:
    """Apply haze: exp(-path / haze) of the radiance remains (a rational cubic approximates the exponential)."""
    t = f32(path_m) / f32(haze_m)
    clear = f32(1) / (f32(1) + t * (f32(1) + t * (f32(0.5) + t * f32(0.166667))))
    return f32(radiance) * clear + f32(HAZE_RADIANCE) * (f32(1) - clear)


@row_loop
def shade(n: int, at: Footprints, in_shade: float, haze_m: float) -> None:
    """Compute the radiance of dry ground in sun, skylight and haze."""
    in_shade, per_haze = f32(in_shade), f32(1.0 / haze_m)
    for k in range(n):
        water = at.water[k] * f32(1.0 / 255.0)
        texture = at.texture[k] * (f32(1) - water)
        direct, ambient = at.direct[k] * f32(1.0 / DIRECT_UNIT), at.ambient[k] * f32(1.0 / AMBIENT_UNIT)
        at.direct[k], at.ambient[k], at.water[k], at.texture[k] = direct, ambient, water, texture
        t = at.path_m[k] * per_haze
        clear = f32(1) / (f32(1) + t * (f32(1) + t * (f32(0.5) + t * f32(0.166667))))
        ground = direct * max(f32(0), f32(1) + texture) + ambient * max(f32(1) + in_shade * texture, f32(0))
        at.radiance[k] = ground * clear + f32(HAZE_RADIANCE) * (f32(1) - clear)


@scalar
def add_shadow_and_water(
    n: int,
    at: Footprints,
    special: Ints,
    rays: RowRays,
    origin: Doubles,
    light: Light,
    scenery: Backdrop,
) -> None:
    """Correct the marked pixels for the rover's shadow and water."""
    has_box = light.box_half_m[0] > 0.0
    around = shadow_width_m2(light)
    for k in range(n):
        if special[k] == 0:
            continue
        c, shadow = at.pixel[k], 0.0
        if has_box and at.range_m[k] < OWN_SHADOW_REACH_M:
            # Only what lies near the line from the sun through the box can be in its shadow.
            x = origin[0] + rays.ux[c] * at.range_m[k] - light.box_centre[0]
            y = origin[1] + rays.uy[c] * at.range_m[k] - light.box_centre[1]
            z = rays.z[c] - light.box_centre[2]
            along = x * light.sun[0] + y * light.sun[1] + z * light.sun[2]
            if x * x + y * y + z * z - along * along < around:
                shadow = _box_shadow(x, y, z, light)
        if shadow <= 0.0 and at.water[k] < 0.001:
            continue
        direct = at.direct[k] * (1.0 - shadow)
        texture = float(at.texture[k])
        shaded = max(at.ambient[k] + light.in_shade * at.ambient[k] * texture, 0.0)
        radiance = direct * max(0.0, 1.0 + texture) + shaded
        if at.water[k] >= 0.001:
            body = 0.42 * (direct + at.ambient[k])
            pool = _water(
                float(rays.ux[c]), float(rays.uy[c]), float(rays.slope[c]), body, origin, light, scenery
            )
            radiance += (pool - radiance) * at.water[k]
        at.radiance[k] = hazed(radiance, at.path_m[k], light.haze_m)


@scalar
def shadow_width_m2(light: Light) -> float:
    """Return the square of the distance from the line through the box to the sun within which all of its shadow lies."""
    return (light.box_half_m**2).sum() + 0.1


@scalar
def _box_shadow(px: float, py: float, pz: float, light: Light) -> float:
    """Return the share of the sun that the box hides from a place relative to its middle, with soft edges."""
    rotation, sun = light.box_rotation, light.sun
    enters, leaves = -1e9, 1e9
    for axis in range(3):
        speed = rotation[0, axis] * sun[0] + rotation[1, axis] * sun[1] + rotation[2, axis] * sun[2]
        place = rotation[0, axis] * px + rotation[1, axis] * py + rotation[2, axis] * pz
        inverse = 1.0 / (speed if abs(speed) > 1e-6 else 1e-6)
        first, second = (
            (-light.box_half_m[axis] - place) * inverse,
            (light.box_half_m[axis] - place) * inverse,
        )
        enters, leaves = max(enters, min(first, second)), min(leaves, max(first, second))
    if leaves <= 0.0:
        return 0.0
    return min(max((leaves - enters) * 12.0 + 0.5, 0.0), 1.0)


@scalar
def _water(
    ux: float, uy: float, slope: float, body: float, origin: Doubles, light: Light, scenery: Backdrop
) -> float:
    """Return the radiance of a still pool: dark body, sky and mountains mirrored by Schlick's formula, sun glint."""
    stretch = 1.0 / math.sqrt(1.0 + slope * slope)
    facing = min(max(-slope * stretch, 0.0), 1.0)
    mirrored = 0.02 + 0.98 * (1.0 - facing) ** 5
    sky = backdrop_radiance(
        scenery.faces,
        scenery.distance_m,
        origin[0] - scenery.centre_x,
        origin[1] - scenery.centre_y,
        origin[2],
        ux,
        uy,
        abs(slope),
    )
    towards = max((ux * light.sun[0] + uy * light.sun[1] + abs(slope) * light.sun[2]) * stretch, 0.0)
    glint = (1.0 - light.sky_share) * 1.5 * towards**256
    return body * (1.0 - mirrored) + mirrored * sky + glint
