"""Light of a rendered image: sky and mountains, light on the ground, shading, and the image sensor.

`Backdrop` is a wide cylinder with the sky and the mountains around the site. `GroundMap` holds sunlight, cast shadows and
skylight of every node, with a mipmap. `shade` gives the radiance of surface samples by sun, sky, haze, open water and
the rover's shadow. `ImageSensor` turns radiance into 8-bit grey levels with lens blur, vignetting, gain, shot and read
noise, and JPEG compression.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from sim.config.world import AppearanceConfig, ImagingConfig
from sim.rendering.compiled import (
    Doubles,
    Floats,
    Ints,
    Words,
    by_share,
    entry,
    f32,
    hash32,
    i32,
    row_loop,
    scalar,
    share_out,
    u32,
)
from sim.rendering.footprint import Footprints
from sim.rendering.visibility import RowRays
from sim.world.appearance import sun_direction
from sim.world.fine_terrain import FineTerrain, band_limited_field
from survey import Camera
from survey.core import FloatArray, stream
from survey.data.frames import Image

HAZE_RADIANCE = 0.92
_COLUMNS, _ROWS = 1024, 640
_SLOPES = -0.15, 1.2
_WAVES = ((4, 0.35), (6, 0.35), (10, 0.3), (18, 0.2), (34, 0.12), (66, 0.07), (140, 0.04), (300, 0.02))
"""Number of half waves around the horizon, and their share of the mean height."""


class Backdrop(NamedTuple):
    """Radiance on a cylinder around the site's centre, in four faces of 90° (east, north, west, south)."""

    faces: Floats
    """(4, rows, columns): the columns are the tangent of the azimuth within the face, the rows the slope."""
    is_open: Floats
    """Share of open sky, in the same layout; one texel where there are no clouds."""
    distance_m: float
    centre_x: float
    centre_y: float


def backdrop(config: AppearanceConfig, centre: FloatArray, seed: int, albedo: float = 1.0) -> Backdrop:
    """Return the cylinder's radiance, beyond the map's edge by that albedo; ridge lines are smoothed over a texel."""
    rng = stream(seed, "appearance", "backdrop")
    tangent = (np.arange(_COLUMNS) + 0.5) / _COLUMNS * 2.0 - 1.0
    azimuth = np.concatenate([0.5 * np.pi * face + np.arctan(tangent) for face in range(4)])
    elevation = np.degrees(np.arctan(np.linspace(*_SLOPES, _ROWS))).astype(np.float32)[:, None]
    crest = _crest(azimuth, config.ridges_deg, rng)
    rock = _mountainside(azimuth, elevation, crest, rng)
    clear = math.exp(-config.ridges_distance_m / (6.0 * config.haze_m))
    sky = np.broadcast_to(0.62 + 0.30 * np.exp(-np.maximum(elevation, 0.0) / 18.0), rock.shape)
    mountain = np.clip((crest - elevation) / 0.12 + 0.5, 0.0, 1.0) * (config.ridges_deg > 0.0)
    picture = mountain * (rock * clear + 0.9 * (1.0 - clear)) + (1.0 - mountain) * sky
    plain = np.clip(-elevation / 0.2, 0.0, 1.0)  # ground beyond the map's edge
    picture = plain * (0.88 * albedo * clear + 0.9 * (1.0 - clear)) + (1.0 - plain) * picture
    faces = np.ascontiguousarray(picture.reshape(_ROWS, 4, _COLUMNS).transpose(1, 0, 2), np.float32)
    is_open = np.ones((4, 1, 1), np.float32)
    if config.clouds > 0.0:
        sky_share = ((1.0 - plain) * (1.0 - mountain)).reshape(_ROWS, 4, _COLUMNS)
        is_open = np.ascontiguousarray(sky_share.transpose(1, 0, 2), np.float32)
    return Backdrop(faces, is_open, config.ridges_distance_m, float(centre[0]), float(centre[1]))


def _crest(azimuth: Doubles, mean_deg: float, rng: np.random.Generator) -> Floats:
    """Return the elevation of the ridge line at each azimuth [deg]: peaks with concave sides."""
    waves = sum(a * np.abs(np.sin(0.5 * k * azimuth + rng.uniform(0.0, np.pi))) for k, a in _WAVES)
    return np.asarray(np.maximum(mean_deg * (1.75 - waves), 0.15 * mean_deg), dtype=np.float32)


def _mountainside(azimuth: Doubles, elevation: Floats, crest: Floats, rng: np.random.Generator) -> Floats:
    """Return the radiance of sunlit rock and snow, with more snow higher up."""
    texel_deg = 0.1
    relief = band_limited_field((512, 3600), texel_deg, (0.3, 25.0), 2.0, rng, stretch=0.6, periodic=True)
    shade = np.roll(relief, 2, axis=1) - relief + 0.5 * (np.roll(relief, 2, axis=0) - relief)
    shade /= shade.std()
    snow = band_limited_field((512, 3600), texel_deg, (0.5, 25.0), 1.7, rng, periodic=True)
    x = np.broadcast_to(np.degrees(azimuth) % 360.0 / texel_deg, (len(elevation), len(azimuth))).astype(
        np.float32
    )
    y = np.broadcast_to(elevation / texel_deg + 120.0, x.shape).astype(np.float32)
    shade, snow = (cv2.remap(t, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP) for t in (shade, snow))
    below = np.clip((crest - elevation) / np.maximum(crest, 0.1), -2.0, 2.0)
    cover = 1.0 / (1.0 + np.exp(-6.0 * (snow + 0.6 * shade + 0.8 - 1.6 * below)))
    rock, white = np.clip(0.40 + 0.09 * shade, 0.15, 0.7), np.clip(0.80 + 0.07 * shade, 0.5, 1.0)
    side: Floats = rock * (1.0 - cover) + white * cover
    return side


@scalar
def backdrop_radiance(
    faces: Floats, distance: float, x: float, y: float, z: float, ux: float, uy: float, slope: float
) -> float:
    """Return the radiance where a ray meets the cylinder; x and y count from its axis."""
    rows, columns = faces.shape[1], faces.shape[2]
    along = x * ux + y * uy
    reach = math.sqrt(max(distance * distance - x * x - y * y + along * along, 0.0)) - along
    px, py = x + reach * ux, y + reach * uy
    rise = z / distance + slope * reach / distance
    if abs(px) > abs(py):
        face, tangent = (0 if px > 0 else 2), py / px
    else:
        face, tangent = (1 if py > 0 else 3), -px / py
    u = min(max((tangent + 1.0) * 0.5 * columns - 0.5, 0.0), columns - 1.001)
    v = min(max((rise - _SLOPES[0]) * (rows - 1) / (_SLOPES[1] - _SLOPES[0]), 0.0), rows - 1.001)
    i, j = int(u), int(v)
    a, b = u - i, v - j
    low = faces[face, j, i] + (faces[face, j, i + 1] - faces[face, j, i]) * a
    high = faces[face, j + 1, i] + (faces[face, j + 1, i + 1] - faces[face, j + 1, i]) * a
    return low + (high - low) * b


@row_loop
def backdrop_row(
    n: int,
    pixel: Ints,
    ux: Floats,
    uy: Floats,
    slope: Floats,
    faces: Floats,
    rows: int,
    columns: int,
    distance: float,
    x: float,
    y: float,
    z: float,
    painted: Floats,
) -> None:
    """Look up the radiance of the `n` listed rays of a row; `faces` without its axes."""
    zero, half, one = f32(0), f32(0.5), f32(1)
    x, y, per_far = f32(x), f32(y), f32(1.0 / distance)
    beside, base = f32(distance * distance - x * x - y * y), f32(z / distance - _SLOPES[0])
    per_slope, width = f32((rows - 1) / (_SLOPES[1] - _SLOPES[0])), f32(columns)
    u_end, v_end, rows, columns = f32(columns - 1.001), f32(rows - 1.001), i32(rows), i32(columns)
    for k in range(n):
        c = entry(pixel[k])
        east, north = ux[c], uy[c]
        along = x * east + y * north
        reach = np.sqrt(max(beside + along * along, zero)) - along
        px, py = x + reach * east, y + reach * north
        is_across = abs(px) > abs(py)
        face = (i32(0) if px > zero else i32(2)) if is_across else (i32(1) if py > zero else i32(3))
        tangent = (py if is_across else -px) / (px if is_across else py)
        u = min(max((tangent + one) * half * width - half, zero), u_end)
        v = min(max((base + slope[c] * reach * per_far) * per_slope, zero), v_end)
        i, j = i32(u), i32(v)
        a, b = u - f32(i), v - f32(j)
        p = i32(i32(i32(i32(face * rows) + j) * columns) + i)
        low = faces[entry(p)]
        low += (faces[entry(i32(p + i32(1)))] - low) * a
        p = i32(p + columns)
        high = faces[entry(p)]
        high += (faces[entry(i32(p + i32(1)))] - high) * a
        painted[k] = low + (high - low) * b


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
    columns: int
    """Of the finest level; each coarser level has half as many, at least 2."""
    rows: int


def ground_map(terrain: FineTerrain, height: Floats, patches: Floats, config: AppearanceConfig) -> GroundMap:
    """Return the map of a lit terrain; `height` and `patches` (share of clean snow's reflectance) begin in the south."""
    south_up = (np.ascontiguousarray(grid[::-1]) for grid in (terrain.tone, terrain.openness, terrain.water))
    words = np.empty(height.shape, np.uint32)
    share_out(
        _light, height, *south_up, patches, terrain.step_m, sun_direction(config), config.sky_share, words
    )
    return mipmap(words)


def mipmap(words: Words) -> GroundMap:
    """Return the map of nodes (rows, columns) with its coarser levels."""
    levels: list[Words] = [words]
    while len(levels) < _LEVELS:
        rows, columns = (max(int(n) // 2, 2) for n in levels[-1].shape)
        coarser = np.empty((rows, columns), np.uint32)
        share_out(_halve, levels[-1], coarser)
        levels.append(coarser)
    starts = np.cumsum([0] + [level.size for level in levels[:-1]]).astype(np.int32)
    rows, columns = words.shape
    return GroundMap(np.concatenate([level.ravel() for level in levels]), starts, int(columns), int(rows))


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
    drift_m: Doubles
    """How far the clouds have moved to the east and north, (2,)."""
    bare_below: float
    """Texture darker than minus this has the colour of bare ground."""
    is_ice: bool
    """Whether bare ground is ice."""


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
    n: int, at: Footprints, special: Ints, rays: RowRays, origin: Doubles, light: Light, scenery: Backdrop
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
        at.direct[k] = direct
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


# Normal numbers, drawn once. Each row of a frame reads a window that the frame and the row choose, so that the bytes do
# not depend on the number of threads.
_DRAWS = 1 << 21
_NEXT_CHANNEL = 1 << 27


class ImageSensor:
    """Image sensor of one channel or of blue, green and red; the noise depends on the seed and the frame's number alone."""

    def __init__(self, config: ImagingConfig, camera: Camera, seed: int) -> None:
        self._config = config
        self._draws = stream(seed, "camera", "noise").standard_normal(_DRAWS, np.float32)
        self._seed = int(stream(seed, "camera", "frames").integers(1 << 30))
        self._transmission = _vignette(camera, config.vignetting)
        self._scattered = _drops(camera, config.drops, stream(seed, "camera", "drops"))

    def image(self, radiance: Floats, frame_index: int) -> Image:
        """Return the 8-bit image (H, W) or (H, W, 3) of a frame."""
        config, is_grey = self._config, radiance.ndim == 2
        if config.drops:
            scattered = self._scattered if is_grey else self._scattered[..., None]
            radiance = radiance + scattered * (_hazy(radiance) - radiance)
        if config.blur_px > 0.0:
            radiance = cv2.GaussianBlur(radiance, (0, 0), config.blur_px)
        if is_grey:
            image = self._exposed(radiance, self._gain(radiance), self._seed + frame_index)
        else:
            gain = self._gain(np.asarray(cv2.cvtColor(radiance, cv2.COLOR_BGR2GRAY), np.float32))
            numbers = (self._seed + frame_index + k * _NEXT_CHANNEL for k in range(3))
            channels = zip(np.moveaxis(radiance, -1, 0), numbers, strict=True)
            image = np.dstack([self._exposed(np.ascontiguousarray(one), gain, k) for one, k in channels])
        if config.jpeg_quality is None:
            return image
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality])
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), np.uint8)

    def _exposed(self, radiance: Floats, gain: float, number: int) -> Image:
        """Return the grey levels of one channel, with the noise of a number."""
        config, noisy = self._config, self._config.noise == "on"
        image = np.empty(radiance.shape, np.uint8)
        share_out(
            _expose,
            radiance,
            self._transmission,
            gain,
            config.read_noise * noisy,
            config.shot_noise * noisy,
            self._draws,
            number,
            image,
        )
        return image

    def _gain(self, radiance: Floats) -> float:
        """Return the grey levels per unit of radiance: the stated ones, or those that suit the frame."""
        config = self._config
        if config.gain is not None:
            return config.gain
        gain = config.brightness / max(float(np.percentile(radiance[::6, ::6], 90)), 0.1)
        if config.gain_step_ev == 0.0:
            return gain
        return 2.0 ** (config.gain_step_ev * round(math.log2(gain) / config.gain_step_ev))


def _vignette(camera: Camera, loss: float) -> Floats:
    """Return the share of light at each pixel, which falls with the square of the distance from the middle."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    squared = (u - camera.matrix[0, 2]) ** 2 + (v - camera.matrix[1, 2]) ** 2
    return (1.0 - loss * squared / squared.max()).astype(np.float32)


_DROP_RADII = 0.02, 0.08
"""Radius of a drop's image, which is out of focus, as a share of the image's width."""
_SCATTER_WIDTH = 0.15


def _drops(camera: Camera, number: int, rng: np.random.Generator) -> Floats:
    """Return the share of light (H, W) that drops on the lens scatter: each covers a part of the aperture."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float32)
    clear = np.ones((camera.height, camera.width), np.float32)
    for _ in range(number):
        x, y = rng.uniform(0.0, camera.width), rng.uniform(0.0, camera.height)
        radius = camera.width * rng.uniform(*_DROP_RADII)
        inside = np.clip(2.0 * (1.0 - np.hypot(u - x, v - y) / radius), 0.0, 1.0)
        clear *= np.float32(1.0) - np.float32(rng.uniform(0.5, 0.9)) * inside
    return np.float32(1.0) - clear


def _hazy(radiance: Floats) -> Floats:
    """Return the light that a drop brings to each pixel: that from around it."""
    width = _SCATTER_WIDTH * radiance.shape[1]
    small = cv2.resize(radiance, None, fx=0.125, fy=0.125, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(small, (0, 0), width / 8.0)
    return np.asarray(cv2.resize(soft, radiance.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


@by_share
def _expose(
    worker: int,
    n_workers: int,
    radiance: Floats,
    transmission: Floats,
    gain: float,
    read_sd: float,
    shot_sd: float,
    draws: Floats,
    frame: int,
    image: Image,
) -> None:
    """Compute grey levels: signal plus noise of variance read² + shot² signal, from one window of draws per row."""
    rows, columns = radiance.shape
    gain, read, shot = f32(gain), f32(read_sd * read_sd), f32(shot_sd * shot_sd)
    for row in range(worker, rows, n_workers):
        start = hash32(frame, row) % u32(draws.size - columns)
        for c in range(columns):
            signal = radiance[row, c] * transmission[row, c] * gain
            level = signal + draws[start + c] * np.sqrt(read + shot * max(signal, f32(0)))
            image[row, c] = np.uint8(min(max(level + f32(0.5), f32(0)), f32(255)))
