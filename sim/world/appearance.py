"""Surface appearance of snow, bare ice and debris: periodic texture tiles, patches, direction of the sun."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from sim.config.world import AppearanceConfig
from sim.world.boulders import draw_blocks, lay_blocks
from sim.world.fine_terrain import band_limited_field
from sim.world.hazards import FloatGrid
from survey.core import FloatArray, stream

SURFACE_TEXEL_M = 0.01
SURFACE_TEXELS = 2048
ROUGH_TEXEL_M = 0.005
GRAIN_TEXEL_M = 0.0025
GRAIN_TEXELS = 1024


@dataclass(frozen=True)
class Tile:
    """Periodic texture with its mipmap; each word packs the 2 × 2 texels of one bilinear sample.

    `words` (n,): all levels one after the other, the finest first, each in blocks of 4 × 4 words, which are one line of a
    processor's cache. `starts` (L,): index of each level's first
    word. `texels`: side of the finest level, a power of 2. `texels_per_m`: of the finest level. `amplitude`:
    relative change of brightness that the largest byte stands for.
    """

    words: npt.NDArray[np.uint32]
    starts: npt.NDArray[np.int32]
    texels: int
    texels_per_m: float
    amplitude: float


def sun_direction(config: AppearanceConfig) -> FloatArray:
    """Return the unit vector towards the sun (east, north, up).

    >>> sun_direction(AppearanceConfig(sun_elevation_deg=30.0, sun_from_deg=90.0)).round(3).tolist()
    [0.866, 0.0, 0.5]
    """
    up, east = np.radians(config.sun_elevation_deg), np.radians(90.0 - config.sun_from_deg)
    return np.array([np.cos(up) * np.cos(east), np.cos(up) * np.sin(east), np.sin(up)])


def snow_patches(shape: tuple[int, int], step_m: float, config: AppearanceConfig, seed: int) -> FloatGrid:
    """Return the reflectance of a site as a share of clean snow's: old snow and dust lie in patches."""
    rng = stream(seed, "appearance", "patches")
    coarse = [int(np.ceil((n - 1) * step_m)) + 1 for n in shape]  # nodes a metre apart hold the patches
    grey = np.clip(band_limited_field((coarse[0], coarse[1]), 1.0, (4.0, 120.0), 1.0, rng), 0.0, 2.0)
    share = np.clip(1.0 - 0.05 * config.patches * grey, 0.3, 1.0) * (1.0 - 0.55 * config.stones)
    fine = cv2.resize(share.astype(np.float32), shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(fine, dtype=np.float32)


def snow_on_rough_ground(height: FloatGrid, step_m: float, share: float, seed: int) -> FloatGrid:
    """Return the share of each node that lies under snow: patches 1 to 40 m wide, none on the sides of boulders.

    Parameters
    ----------
    height : (H, W) ndarray
        Heights, the first row in the north [m].
    step_m : float
        Distance between the nodes [m].
    share : float
        Share of the ground under patches.
    seed : int
        Seed of the site.

    Returns
    -------
    (H, W) ndarray of float32
        Share of snow, 0 to 1, the first row in the north.
    """
    deep = band_limited_field(height.shape, step_m, (1.0, 40.0), 1.3, stream(seed, "appearance", "snow"))
    patches = np.clip((deep - np.quantile(deep[::4, ::4], 1.0 - share)) / 0.2 + 0.5, 0.0, 1.0)
    steep = np.hypot(*np.gradient(height, step_m))
    covered: FloatGrid = (share > 0.0) * patches * np.clip(2.0 - 1.5 * steep, 0.0, 1.0)
    return covered


def downhill_rad(height: FloatGrid) -> float:
    """Return the direction, from east to north, in which a site (first row in the north) falls on average [rad]."""
    east, north = (height[:, 0] - height[:, -1]).mean(), (height[-1] - height[0]).mean()
    return float(np.arctan2(north, east))


@lru_cache(maxsize=2)
def surface_tile(config: AppearanceConfig, wind_from_deg: float, seed: int) -> Tile:
    """Return the 20 m tile of sastrugi, crust, specks and stones at 1 cm."""
    shape = SURFACE_TEXELS, SURFACE_TEXELS
    rng = stream(seed, "appearance", "surface")
    snow = _sunlit_relief(rng, wind_from_deg, config)
    snow += np.float32(0.02) * band_limited_field(
        shape, SURFACE_TEXEL_M, (0.02, 0.12), 0.6, rng, periodic=True
    )
    snow += np.float32(0.02) * band_limited_field(shape, SURFACE_TEXEL_M, (0.2, 5.0), 1.2, rng, periodic=True)
    snow -= np.float32(0.35) * _specks(rng, config.debris)
    texture = np.float32(1.0 - config.stones) * snow
    if config.stones > 0.0:
        texture += np.float32(config.stones) * _stones(stream(seed, "appearance", "stones"), config)
    return pack_tile(np.float32(config.contrast) * texture, 1.0 / SURFACE_TEXEL_M)


ROUGH_ALBEDO = {"bare ice": 0.45, "debris": 0.32}
"""Reflectance of ground without snow as a share of clean snow's."""


@lru_cache(maxsize=2)
def rough_tile(surface: str, config: AppearanceConfig, downhill_rad: float, seed: int) -> Tile:
    """Return the 10 m tile of debris or bare ice at 5 mm: reflectance times the light on relief of centimetres.

    Parameters
    ----------
    surface : {"bare ice", "debris"}
        What the tile shows.
    config : AppearanceConfig
        Sun, sky and contrast.
    downhill_rad : float
        Direction of the slope, from east to north: bands and rills of ice follow it [rad].
    seed : int
        Seed of the site.

    Returns
    -------
    Tile
        Relative change of brightness.
    """
    rng = stream(seed, "appearance", surface)
    height, tone = _stony(rng) if surface == "debris" else _icy(rng, downhill_rad)
    texture = tone * light_on(height, ROUGH_TEXEL_M, config)
    return pack_tile(np.float32(config.contrast) * (texture / texture.mean()), 1.0 / ROUGH_TEXEL_M)


@lru_cache(maxsize=2)
def gravel_tile(config: AppearanceConfig, seed: int) -> Tile:
    """Return the 2.5 m tile of gravel, stones of 0.8 to 4 cm, at 2.5 mm."""
    height, tone = np.zeros((2, GRAIN_TEXELS, GRAIN_TEXELS), np.float32)
    tone += np.float32(1.0)
    _lay_stones(stream(seed, "appearance", "gravel"), height, tone, GRAIN_TEXEL_M, (0.0075, 0.04), cover=1.0)
    texture = np.float32(0.6 * config.contrast) * tone * light_on(height, GRAIN_TEXEL_M, config)
    return pack_tile(texture, 1.0 / GRAIN_TEXEL_M)


def _noise(
    rng: np.random.Generator, wavelengths_m: tuple[float, float], decay: float, **forms: float
) -> FloatGrid:
    shape = SURFACE_TEXELS, SURFACE_TEXELS
    return band_limited_field(shape, ROUGH_TEXEL_M, wavelengths_m, decay, rng, periodic=True, **forms)


def _stony(rng: np.random.Generator) -> tuple[FloatGrid, FloatGrid]:
    """Return heights [m] and reflectance of a tile of gravel under angular stones, 1.5 to 60 cm wide."""
    height = np.float32(0.005) * _noise(rng, (0.02, 0.3), 0.8) + np.float32(0.03) * _noise(
        rng, (0.3, 5.0), 1.5
    )
    tone = np.exp(
        np.float32(0.12) * _noise(rng, (0.02, 0.08), 0.3) + np.float32(0.12) * _noise(rng, (1.0, 10.0), 1.0)
    )
    _lay_stones(rng, height, tone, ROUGH_TEXEL_M, (0.015, 0.6), cover=1.0)
    return height, tone


def _lay_stones(
    rng: np.random.Generator,
    height: FloatGrid,
    tone: FloatGrid,
    texel_m: float,
    sizes_m: tuple[float, float],
    *,
    cover: float,
) -> None:
    """Lay stones on a tile; at a cover of 1 those of the least width lie two to three widths apart."""
    number = round(0.045 * cover * height.size * (3.0 * texel_m / sizes_m[0]) ** 2)
    stones = draw_blocks(rng, number, sizes_m, np.array(height.shape[::-1]) * texel_m, tone_sd=0.3)
    lay_blocks(height, tone, texel_m, stones, periodic=True)


def _icy(rng: np.random.Generator, downhill_rad: float) -> tuple[FloatGrid, FloatGrid]:
    """Return heights [m] and reflectance of a tile of weathered ice: crust, dust in bands, rills, holes, single stones."""
    along = {"stretch": 6.0, "angle": downhill_rad}
    rill = np.exp(-((_noise(rng, (0.4, 2.0), 1.5, stretch=12.0, angle=downhill_rad) / np.float32(0.06)) ** 2))
    dust = _noise(rng, (0.1, 6.0), 1.2) + np.float32(0.6) * _noise(rng, (0.1, 2.0), 1.0, **along)
    weathered = np.exp(np.float32(0.8) * _noise(rng, (0.5, 8.0), 1.2))  # rough here, smooth there
    hole = _specks(rng, 1.5) * (dust > 0.0)
    height = weathered * np.float32(0.004) * _noise(rng, (0.03, 0.5), 1.3) - np.float32(0.02) * (rill + hole)
    tone = np.exp(np.float32(-0.22) * np.maximum(dust, -1.0) - np.float32(0.35) * rill)
    tone *= np.exp(np.float32(0.03) * weathered * _noise(rng, (0.02, 0.1), 0.5)) * (
        1.0 - np.float32(0.6) * hole
    )
    _lay_stones(rng, height, tone, ROUGH_TEXEL_M, (0.015, 0.4), cover=0.03)
    return height, tone


def light_on(height: FloatGrid, texel_m: float, config: AppearanceConfig) -> FloatGrid:
    """Return the light on a periodic relief (rows to the north) over that on level ground, with cast shadows."""
    east, north, up = sun_direction(config)
    to_east, to_north = (
        (np.roll(height, -1, axis) - np.roll(height, 1, axis)) / (2.0 * texel_m) for axis in (1, 0)
    )
    lit = (up - to_east * east - to_north * north) / (up * np.sqrt(1.0 + to_east**2 + to_north**2))
    level = max(float(np.hypot(east, north)), 1e-6)
    above = np.full_like(height, -1e9)
    for reach in (1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64):
        shift = round(-reach * north / level), round(-reach * east / level)
        distance = texel_m * float(np.hypot(*shift))
        np.maximum(above, (np.roll(height, shift, (0, 1)) - height) / distance, out=above)
    sunlit = np.clip(0.5 - (above - up / level) / 0.3, 0.0, 1.0)
    hollow = sum(cv2.GaussianBlur(height, (0, 0), size_px) - height for size_px in (3.0, 10.0))
    sky = np.clip(1.0 - 0.06 / texel_m * hollow, 0.35, 1.1)
    light = (1.0 - config.sky_share) * np.clip(lit, 0.0, 2.5) * sunlit + config.sky_share * sky
    return np.asarray(light, dtype=np.float32)


@lru_cache(maxsize=2)
def grain_tile(config: AppearanceConfig, seed: int) -> Tile:
    """Return the 2.5 m tile of snow grains at 2.5 mm."""
    rng = stream(seed, "appearance", "grain")
    grain = band_limited_field(
        (GRAIN_TEXELS, GRAIN_TEXELS), GRAIN_TEXEL_M, (0.006, 0.06), 0.6, rng, periodic=True
    )
    strength = config.contrast * (0.05 + 0.10 * config.stones)  # gravel is rougher than snow
    return pack_tile(np.float32(strength) * grain, 1.0 / GRAIN_TEXEL_M)


def pack_tile(texture: FloatGrid, texels_per_m: float) -> Tile:
    """Return a periodic square texture with mean 0 as a tile."""
    texture = texture - texture.mean()
    amplitude = max(float(np.quantile(np.abs(texture[::4, ::4]), 0.9999)), 1e-6)
    words, starts, start = [], [], 0
    level = texture
    while len(level) >= 8:
        corner = np.clip(np.rint(level * np.float32(127.0 / amplitude) + np.float32(128.0)), 0, 255).astype(
            np.uint32
        )
        pair = corner | np.roll(corner, -1, axis=1) << np.uint32(8)
        quad = pair | np.roll(pair, -1, axis=0) << np.uint32(16)
        words.append(quad.reshape(len(quad) // 4, 4, -1, 4).swapaxes(1, 2).ravel())
        starts.append(start)
        start += level.size
        level = 0.25 * (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2])
    return Tile(
        np.concatenate(words), np.array(starts, np.int32), len(texture), texels_per_m, amplitude / 127.0
    )


def _sunlit_relief(rng: np.random.Generator, wind_from_deg: float, config: AppearanceConfig) -> FloatGrid:
    """Return the relative change of sunlight on relief finer than the terrain's nodes: drifts, edges and ripples.

    The slopes of each form have the same variance in every octave, as wind-worked snow nearly has.
    """
    shape, wind = (SURFACE_TEXELS, SURFACE_TEXELS), float(np.radians(270.0 - wind_from_deg))

    def form(shortest_m: float, longest_m: float, stretch: float) -> FloatGrid:
        lengths_m = shortest_m, longest_m
        return band_limited_field(
            shape, SURFACE_TEXEL_M, lengths_m, 2.0, rng, stretch=stretch, angle=wind, periodic=True
        )

    shading = np.float32(0.055) * _shading(form(0.15, 3.0, 3.0), config)  # drifts
    shading += np.float32(0.035) * _shading(-np.abs(form(0.25, 4.0, 4.0)), config)  # creased edges
    shading += np.float32(0.035) * _shading(form(0.03, 0.4, 1.6), config)  # ripples
    low_sun = np.tan(np.radians(25.0)) / np.tan(np.radians(config.sun_elevation_deg))
    sunlit: FloatGrid = np.clip(min(low_sun, 2.0) * shading, -0.9, 1.0).astype(np.float32)
    return sunlit


def _shading(relief: FloatGrid, config: AppearanceConfig) -> FloatGrid:
    """Return the slope towards the sun, with standard deviation 1."""
    to_east, to_north = (np.roll(relief, -1, axis) - np.roll(relief, 1, axis) for axis in (1, 0))
    sun = sun_direction(config)
    slope = -(to_east * np.float32(sun[0]) + to_north * np.float32(sun[1]))
    return np.asarray(slope / max(float(slope.std()), 1e-9), dtype=np.float32)


def _specks(rng: np.random.Generator, per_area: float) -> FloatGrid:
    """Return specks of dust, cryoconite and small stones: 6 per square metre, radii by a power law from 0.5 to 6 cm."""
    n = int(2500 * per_area)
    dark = np.zeros((SURFACE_TEXELS, SURFACE_TEXELS), np.float32)
    radius = np.clip(np.rint(0.5 * (1.0 - rng.random(n)) ** -0.6), 1, 6).astype(int)
    places = rng.integers(0, SURFACE_TEXELS, (n, 2))
    tones = rng.uniform(0.3, 1.0, n)
    for place, r, tone in zip(places, radius.tolist(), tones.tolist(), strict=True):
        for copy in _copies(place, r):
            cv2.circle(dark, copy.tolist(), r, tone, -1, cv2.LINE_AA)
    return np.asarray(cv2.GaussianBlur(dark, (0, 0), 0.8), dtype=np.float32)


def _stones(rng: np.random.Generator, config: AppearanceConfig) -> FloatGrid:
    """Return debris: stones of 2 to 40 cm in all tones, bright towards the sun, dark on their far side."""
    n = SURFACE_TEXELS
    gravel = band_limited_field((n, n), SURFACE_TEXEL_M, (0.02, 2.0), 0.7, rng, periodic=True)
    coarseness = np.exp(
        0.6 * band_limited_field((n, n), SURFACE_TEXEL_M, (0.3, 5.0), 1.5, rng, periodic=True)
    )
    tone = np.float32(0.20) * gravel * coarseness  # sand here, cobbles there
    sun = sun_direction(config)
    aside = sun[:2] / max(float(np.hypot(sun[0], sun[1])), 1e-6)
    count = 20000
    radius = np.sort(np.clip(1.2 * (1.0 - rng.random(count)) ** -0.55, 1.2, 20.0))
    places = rng.uniform(0.0, n, (count, 2))
    flatness, turn = rng.uniform(0.5, 1.0, count), rng.uniform(0.0, 180.0, count)
    shade = np.clip(rng.normal(0.05, 0.40, count), -0.7, 1.0)
    for k in range(count):
        for shift, value in ((-0.35, shade[k] - 0.55), (0.0, shade[k]), (0.3, shade[k] + 0.15)):
            size = radius[k] * (1.0 if shift <= 0.0 else 0.6)
            for place in _copies(places[k] + shift * radius[k] * aside, size):
                cv2.ellipse(
                    tone, (place.tolist(), (2 * size, 2 * size * flatness[k]), turn[k]), float(value), -1
                )
    return np.asarray(cv2.GaussianBlur(tone, (0, 0), 0.7), dtype=np.float32)


def _copies(place: FloatArray, reach: float) -> list[FloatArray]:
    """Return the places at which a shape is drawn so that the tile is periodic."""
    n = SURFACE_TEXELS
    shifts = [[0] + [n] * bool(p < reach + 2) + [-n] * bool(p > n - reach - 2) for p in place.tolist()]
    return [place + np.array([east, north]) for east in shifts[0] for north in shifts[1]]
