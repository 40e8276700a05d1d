"""The sky and the mountains around the site, painted on a wide cylinder."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from sim.rendering.compiled import Doubles, Floats, scalar
from sim.scene_config import AppearanceConfig
from sim.scenery import wavy
from survey.arrays import FloatArray
from survey.streams import stream

HAZE_RADIANCE = 0.92
_COLUMNS, _ROWS = 1024, 640
_SLOPES = -0.15, 1.2
_WAVES = ((2, 1.5), (3, 1.5), (5, 1.2), (9, 0.8), (17, 0.5), (33, 0.3), (70, 0.18), (150, 0.08))


class Backdrop(NamedTuple):
    """Radiance on a cylinder around the site's centre, in four faces of 90° (east, north, west, south)."""

    faces: Floats
    """(4, rows, columns): the columns are the tangent of the azimuth within the face, the rows the slope."""
    distance_m: float
    centre_x: float
    centre_y: float


def backdrop(config: AppearanceConfig, centre: FloatArray, seed: int) -> Backdrop:
    """Paint the cylinder; ridge lines are smoothed over a texel, the haze is in the picture."""
    rng = stream(seed, "appearance", "backdrop")
    tangent = (np.arange(_COLUMNS) + 0.5) / _COLUMNS * 2.0 - 1.0
    azimuth = np.concatenate([0.5 * np.pi * face + np.arctan(tangent) for face in range(4)])
    elevation = np.degrees(np.arctan(np.linspace(*_SLOPES, _ROWS)))[:, None]
    crest = _crest(azimuth, config.ridges_deg, rng)
    rock = _mountainside(azimuth, elevation, crest, rng)
    clear = math.exp(-config.ridges_distance_m / (6.0 * config.haze_m))
    sky = np.broadcast_to(0.90 - 0.004 * np.maximum(elevation, 0.0), rock.shape)
    mountain = np.clip((crest - elevation) / 0.12 + 0.5, 0.0, 1.0) * (config.ridges_deg > 0.0)
    picture = mountain * (rock * clear + 0.9 * (1.0 - clear)) + (1.0 - mountain) * sky
    plain = np.clip(-elevation / 0.2, 0.0, 1.0)  # snow beyond the map's edge
    picture = plain * (0.88 * clear + 0.9 * (1.0 - clear)) + (1.0 - plain) * picture
    faces = np.ascontiguousarray(picture.reshape(_ROWS, 4, _COLUMNS).transpose(1, 0, 2), np.float32)
    return Backdrop(faces, config.ridges_distance_m, float(centre[0]), float(centre[1]))


def _crest(azimuth: Doubles, mean_deg: float, rng: np.random.Generator) -> Doubles:
    """Elevation of the ridge line at each azimuth [deg]."""
    waves = sum(a * np.cos(k * azimuth + rng.uniform(0.0, 2.0 * np.pi)) for k, a in _WAVES)
    crest: Doubles = np.maximum(mean_deg * (1.0 + 0.2 * waves), 0.14 * mean_deg)
    return crest


def _mountainside(azimuth: Doubles, elevation: Doubles, crest: Doubles, rng: np.random.Generator) -> Doubles:
    """Radiance of rock with snow on it, more of it higher up."""
    texel_deg = 0.1
    rock = wavy((256, 3600), texel_deg, (0.3, 12.0), 1.0, rng, periodic=True)
    snow = wavy((256, 3600), texel_deg, (0.4, 8.0), 0.8, rng, periodic=True)
    x = np.broadcast_to(np.degrees(azimuth) % 360.0 / texel_deg, (len(elevation), len(azimuth))).astype(
        np.float32
    )
    y = np.broadcast_to(elevation / texel_deg + 60.0, x.shape).astype(np.float32)
    rock, snow = (cv2.remap(t, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP) for t in (rock, snow))
    cover = 1.0 / (1.0 + np.exp(-3.0 * (snow + 2.0 * elevation / np.maximum(crest, 0.1) - 0.7)))
    side: Doubles = (
        np.clip(0.42 + 0.10 * rock, 0.15, 0.7) * (1.0 - cover) + np.clip(0.84 + 0.06 * rock, 0.6, 1.0) * cover
    )
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
