"""Backdrop: sky and mountains around the site on a wide cylinder."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from sim.config.scene import AppearanceConfig
from sim.rendering.compiled import Doubles, Floats, Ints, entry, i32, row_loop, scalar, u32
from sim.world.band_limited import band_limited_field
from survey.core.arrays import FloatArray
from survey.core.streams import stream

HAZE_RADIANCE = 0.92
_COLUMNS, _ROWS = 1024, 640
_SLOPES = -0.15, 1.2
_WAVES = ((4, 0.35), (6, 0.35), (10, 0.3), (18, 0.2), (34, 0.12), (66, 0.07), (140, 0.04), (300, 0.02))
"""Number of half waves around the horizon, and their share of the mean height."""


class Backdrop(NamedTuple):
    """Radiance on a cylinder around the site's centre, in four faces of 90° (east, north, west, south)."""

    faces: Floats
    """(4, rows, columns): the columns are the tangent of the azimuth within the face, the rows the slope."""
    distance_m: float
    centre_x: float
    centre_y: float


def backdrop(config: AppearanceConfig, centre: FloatArray, seed: int) -> Backdrop:
    """Return the cylinder's radiance; ridge lines are smoothed over a texel, haze is included."""
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
    plain = np.clip(-elevation / 0.2, 0.0, 1.0)  # snow beyond the map's edge
    picture = plain * (0.88 * clear + 0.9 * (1.0 - clear)) + (1.0 - plain) * picture
    faces = np.ascontiguousarray(picture.reshape(_ROWS, 4, _COLUMNS).transpose(1, 0, 2), np.float32)
    return Backdrop(faces, config.ridges_distance_m, float(centre[0]), float(centre[1]))


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
    for k in range(n):
        c = u32(pixel[k])
        east, north = float(ux[c]), float(uy[c])
        along = x * east + y * north
        reach = math.sqrt(max(distance * distance - x * x - y * y + along * along, 0.0)) - along
        px, py = x + reach * east, y + reach * north
        rise = z / distance + float(slope[c]) * reach / distance
        is_across = abs(px) > abs(py)
        face = (i32(0) if px > 0 else i32(2)) if is_across else (i32(1) if py > 0 else i32(3))
        tangent = (py if is_across else -px) / (px if is_across else py)
        u = min(max((tangent + 1.0) * 0.5 * columns - 0.5, 0.0), columns - 1.001)
        v = min(max((rise - _SLOPES[0]) * (rows - 1) / (_SLOPES[1] - _SLOPES[0]), 0.0), rows - 1.001)
        i, j = i32(u), i32(v)
        a, b = u - i, v - j
        p = i32(i32(i32(i32(face * i32(rows)) + j) * i32(columns)) + i)
        low = faces[entry(p)]
        low += (faces[entry(i32(p + i32(1)))] - low) * a
        p = i32(p + i32(columns))
        high = faces[entry(p)]
        high += (faces[entry(i32(p + i32(1)))] - high) * a
        painted[k] = low + (high - low) * b
