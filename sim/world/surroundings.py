"""Ground around a site, from an elevation raster: heights, snow and rock, sunlight, and the horizon.

`SiteSurroundings` holds nodes on a square grid about the site, lowered by the curvature of the earth and raised by
refraction. Where the fine terrain is known the nodes lie below it, and at its edge they continue it. `horizon_deg`
gives the elevation angle of the horizon by azimuth.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from sim.config.mission import MissionConfig
from sim.config.world import AppearanceConfig, DemTerrain, SampleTerrain
from sim.world.appearance import ROUGH_ALBEDO, sun_direction
from sim.world.fine_terrain import FineTerrain, band_limited_field
from sim.world.hazards import FloatGrid
from survey import Dem, InputError
from survey.core import BoolArray, FloatArray, stream
from survey.core.transformation import transformed
from survey.terrain.real import real_sample

REACH_M = 15000.0
"""Half the side of the square that is read [m]."""
_MOST_NODES = 1536
_LEAST_STEP_M = 4.0
_EARTH_RADIUS_M = 6.371e6
_REFRACTION = 0.13
_FADE_M = 200.0
_BELOW_M = 0.5
_NOWHERE_M = -2000.0
"""Height of nodes beyond the raster, relative to the site [m]."""


@dataclass(frozen=True, eq=False)
class SiteSurroundings:
    """Nodes around a site; the first row is the southern one.

    Parameters
    ----------
    height : (H, W) ndarray of float32
        Height above the datum, lowered by (1 - k) d² / (2 R) at distance d from the site's middle: the earth's radius R
        and the coefficient of refraction k = 0.13 [m].
    rock : (H, W) ndarray of float32
        Share of rock; the rest is snow, or the surface of the site near its height.
    albedo : (H, W) ndarray of float32
        Reflectance as a share of clean snow's.
    origin : (2,) ndarray
        Place of the south-western node relative to that of the fine terrain [m].
    middle : (2,) ndarray
        Middle of the site relative to the south-western node of the surroundings [m].
    step_m : float
        Distance between the nodes [m].
    """

    height: FloatGrid
    rock: FloatGrid
    albedo: FloatGrid
    origin: FloatArray
    middle: FloatArray
    step_m: float


def mission_surroundings(mission: MissionConfig, terrain: FineTerrain, name: str) -> Dem:
    """Read the raster whose ground is seen around the site of a mission.

    Parameters
    ----------
    mission : MissionConfig
        Its terrain, and the folder from which relative paths count.
    terrain : FineTerrain
        The site.
    name : str
        A file, or "terrain" for the raster of the mission's terrain.

    Returns
    -------
    Dem
        In its own CRS.

    Raises
    ------
    InputError
        The terrain is drawn at random and has no raster, or the file cannot be read.
    """
    if name != "terrain":
        return Dem.read(mission.path(name))
    match mission.terrain:
        case SampleTerrain():
            return real_sample()
        case DemTerrain() as config:
            return Dem.read(mission.path(config.file), crs=config.crs, vertical_datum=config.vertical_datum)
        case _:
            raise InputError(
                f"appearance.horizon is 'terrain', and the terrain of {terrain.bounds} is drawn at random and has no ground "
                "around it; name a raster, or leave appearance.horizon out."
            )


def surroundings_of(
    dem: Dem, terrain: FineTerrain, datum_m: float, look: AppearanceConfig, seed: int
) -> SiteSurroundings:
    """Return the ground around a site from a terrain model.

    The model is moved up or down to continue the fine terrain, by the difference at the nearest place of it, which turns
    into the mean difference over 200 m. Relief finer than its cells is added, in proportion to the slope.

    Parameters
    ----------
    dem : Dem
        Terrain model in any projected CRS; it must cover the middle of the site.
    terrain : FineTerrain
        The site.
    datum_m : float
        Height that counts as 0 [m].
    look : AppearanceConfig
        The settings of the scene; contrast scales the patches.
    seed : int
        Seed of the site.

    Returns
    -------
    SiteSurroundings
        At most 1536 × 1536 nodes up to 15 km from the middle.

    Raises
    ------
    InputError
        The model does not reach the site.
    """
    nodes = _nodes(dem, terrain)
    coarse = _heights(dem, terrain, nodes) - np.float32(datum_m)
    known = np.isfinite(coarse)
    site = _site(terrain, nodes) - np.float32(datum_m)
    inside = np.isfinite(site)
    if not (known & inside).any():
        raise InputError(
            f"the raster of the horizon has no height at the site, whose bounds are {terrain.bounds}; name one that covers it."
        )
    width = max(0.5 * dem.step_m / nodes.step_m, 0.3)
    height = np.asarray(cv2.GaussianBlur(np.where(known, coarse, 0.0), (0, 0), width), np.float32)
    height += _fine_relief(height, dem, nodes, seed)
    steep = np.hypot(*np.gradient(cv2.GaussianBlur(height, (0, 0), 1.0), nodes.step_m))
    height += _difference(site - height, known & inside)
    height = np.where(known, height, np.float32(_NOWHERE_M))
    rock, albedo = _cover(height, steep, terrain.surface, look, nodes.step_m, seed=seed)
    reach = max(int(np.ceil(nodes.step_m / terrain.step_m)), 1)
    height = np.where(inside, _site(terrain, nodes, reach) - np.float32(datum_m + _BELOW_M), height)
    x, y = nodes.axes
    far = (x[None] - nodes.middle[0]) ** 2 + (y[:, None] - nodes.middle[1]) ** 2
    height = height - np.float32(0.5 * (1.0 - _REFRACTION) / _EARTH_RADIUS_M) * far.astype(np.float32)
    return SiteSurroundings(
        np.ascontiguousarray(height, np.float32), rock, albedo, nodes.origin, nodes.middle, nodes.step_m
    )


class _Nodes(NamedTuple):
    """Square grid about a site: origin relative to the site's south-western node, its middle relative to the origin [m]."""

    origin: FloatArray
    middle: FloatArray
    step_m: float
    shape: tuple[int, int]

    @property
    def axes(self) -> tuple[FloatArray, FloatArray]:
        rows, columns = self.shape
        return self.step_m * np.arange(float(columns)), self.step_m * np.arange(float(rows))


def _nodes(dem: Dem, terrain: FineTerrain) -> _Nodes:
    """Return nodes over what the model covers, as dense as memory and its cells allow."""
    xmin, ymin, xmax, ymax = dem.bounds
    edge = np.array([[xmin, ymin], [xmax, ymin], [xmin, ymax], [xmax, ymax]])
    edge = transformed(edge, dem.crs, terrain.crs, "the raster of the horizon")
    west, south, east, north = terrain.bounds
    middle = np.array([0.5 * (west + east), 0.5 * (south + north)])
    low, high = np.maximum(edge.min(0), middle - REACH_M), np.minimum(edge.max(0), middle + REACH_M)
    low, high = np.minimum(low, terrain.origin), np.maximum(high, [east, north])
    step = max(float((high - low).max()) / (_MOST_NODES - 1), _LEAST_STEP_M, dem.step_m / 4.0)
    columns, rows = (int(n) + 2 for n in (high - low) / step)
    return _Nodes(low - terrain.origin, middle - low, step, (rows, columns))


def _heights(dem: Dem, terrain: FineTerrain, nodes: _Nodes) -> FloatGrid:
    """Interpolate the model at the nodes; NaN beyond it [m]."""
    x, y = nodes.axes
    heights = np.empty(nodes.shape, np.float32)
    x0, y0 = nodes.origin + terrain.origin
    for first in range(0, len(y), 128):  # strips keep the copies in double precision small
        part = np.meshgrid(x + x0, y[first : first + 128] + y0)
        places = np.column_stack([axis.ravel() for axis in part])
        places = transformed(places, terrain.crs, dem.crs, "the nodes around the site")
        heights[first : first + 128] = dem.at(places).reshape(part[0].shape)
    return heights


def _site(terrain: FineTerrain, nodes: _Nodes, reach: int = 0) -> FloatGrid:
    """Return the fine terrain at the nodes, NaN elsewhere; with a reach, its least height within so many fine nodes [m]."""
    if reach:
        around = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
        height: Any = cv2.erode(np.ascontiguousarray(terrain.height[::-1]), around)
    else:
        width = max(0.5 * nodes.step_m / terrain.step_m, 0.5)
        height = cv2.GaussianBlur(terrain.height[::-1], (0, 0), width)
    x, y = nodes.axes
    column, row = ((axis + start) / terrain.step_m for axis, start in zip((x, y), nodes.origin, strict=True))
    at = np.meshgrid(column.astype(np.float32), row.astype(np.float32))
    outside = (at[0] < 0) | (at[1] < 0) | (at[0] > height.shape[1] - 1) | (at[1] > height.shape[0] - 1)
    south_up = np.ascontiguousarray(height)
    found = cv2.remap(south_up, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(outside, np.float32(np.nan), found)


def _difference(site_minus_model: FloatGrid, inside: BoolArray) -> FloatGrid:
    """Continue the difference at the edge of the site outwards; it turns into its mean with the distance [m]."""
    nearest_inside: Any = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    row, column = nearest_inside
    mean = float(site_minus_model[inside].mean())
    nearest = site_minus_model[row, column]
    away = np.hypot(row - np.arange(len(row))[:, None], column - np.arange(row.shape[1])[None])
    share = np.exp(-away * np.float32(1.0 / _FADE_M)).astype(np.float32)
    return np.asarray(mean + share * (nearest - mean), dtype=np.float32)


def _fine_relief(height: FloatGrid, dem: Dem, nodes: _Nodes, seed: int) -> FloatGrid:
    """Draw relief with wavelengths between two nodes and two cells of the model, in proportion to the slope [m]."""
    shortest, longest = 2.0 * nodes.step_m, 2.5 * dem.step_m
    if longest < 1.5 * shortest:
        return np.zeros_like(height)
    rng = stream(seed, "appearance", "surroundings")
    field = band_limited_field(height.shape, nodes.step_m, (shortest, longest), 1.2, rng, periodic=True)
    # Creases are sharper than waves.
    gullies = -np.abs(
        band_limited_field(height.shape, nodes.step_m, (shortest, longest), 1.6, rng, periodic=True)
    )
    steep = np.hypot(*np.gradient(height, nodes.step_m))
    scale = np.float32(0.05 * dem.step_m) * np.minimum(steep, 1.0) ** 2
    return np.asarray(scale * (field + np.float32(2.0) * gullies), dtype=np.float32)


def _cover(
    height: FloatGrid, steep: FloatGrid, surface: str, look: AppearanceConfig, step_m: float, *, seed: int
) -> tuple[FloatGrid, FloatGrid]:
    """Return the share of rock, on steep ground, and the reflectance of each node."""
    rng = stream(seed, "appearance", "cover")
    longest = max(600.0, 4.0 * step_m)
    patches = band_limited_field(height.shape, step_m, (2.0 * step_m, longest), 0.6, rng, periodic=True)
    # Snow slides from slopes above 40°; where it stays on steeper ground is a matter of chance.
    rock = np.clip((steep + 0.16 * patches - 0.68) / 0.1, 0.0, 1.0)
    site = ROUGH_ALBEDO.get(surface, 1.0)
    low = site + (1.0 - site) * np.clip((height - 100.0) / 150.0 + 0.3 * patches, 0.0, 1.0)
    old = 1.0 - 0.06 * min(look.patches, 3.0) * np.clip(patches, 0.0, 2.0)
    albedo = (1.0 - rock) * low * old + rock * np.clip(0.33 + 0.07 * patches, 0.15, 0.6)
    return rock.astype(np.float32), albedo.astype(np.float32)


def sunlight_on(around: SiteSurroundings, look: AppearanceConfig) -> FloatGrid:
    """Return the sunlight on each node over that on level ground, by Lambert's law and with cast shadows.

    Parameters
    ----------
    around : SiteSurroundings
        Ground around the site.
    look : AppearanceConfig
        The sun.

    Returns
    -------
    (H, W) ndarray of float32
        0 in shadow, 1 on level ground in the sun.
    """
    height, step = around.height, around.step_m
    east, north, up = sun_direction(look)
    to_north, to_east = np.gradient(height, step)
    lit = (up - to_east * east - to_north * north) / (up * np.sqrt(1.0 + to_east**2 + to_north**2))
    level = max(float(np.hypot(east, north)), 1e-6)
    above, reach = np.full_like(height, -1e9), step
    highest = float(np.ptp(height[height > 0.5 * _NOWHERE_M]))
    while reach * up / level < highest:
        # The value at a node becomes that of the place so far towards the sun.
        shift = np.array([[1.0, 0.0, reach / step * east / level], [0.0, 1.0, reach / step * north / level]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        there = cv2.warpAffine(height, shift, height.shape[::-1], flags=flags, borderValue=_NOWHERE_M)
        np.maximum(above, (there - height) / np.float32(reach), out=above)
        reach += max(step, 0.04 * reach)
    sunlit = np.clip(0.5 - (above - up / level) / 0.02, 0.0, 1.0)
    return np.asarray(np.clip(lit, 0.0, 1.6) * sunlit, dtype=np.float32)


def horizon_deg(around: SiteSurroundings, azimuth_deg: FloatArray) -> FloatArray:
    """Return the elevation angle of the horizon seen from the ground in the middle of a site.

    Parameters
    ----------
    around : SiteSurroundings
        Ground around the site.
    azimuth_deg : (N,) array_like
        Directions, clockwise from north [deg].

    Returns
    -------
    (N,) ndarray
        Largest angle along each direction, curvature and refraction included [deg].

    Examples
    --------
    >>> ridge = np.zeros((101, 101), np.float32)
    >>> ridge[90] = 100.0  # 400 m to the north
    >>> nothing = np.zeros_like(ridge)
    >>> around = SiteSurroundings(ridge, nothing, nothing, np.zeros(2), np.array([500.0, 500.0]), 10.0)
    >>> horizon_deg(around, np.array([0.0, 180.0])).round(1).tolist()
    [14.0, -0.1]
    """
    azimuth = np.radians(azimuth_deg)
    farthest = float(np.hypot(*around.height.shape)) * around.step_m
    ranges = np.arange(2.0 * around.step_m, farthest, 0.5 * around.step_m)
    x = around.middle[0] + np.sin(azimuth)[:, None] * ranges
    y = around.middle[1] + np.cos(azimuth)[:, None] * ranges
    column, row = (np.asarray(part / around.step_m, dtype=np.float32) for part in (x, y))
    heights = cv2.remap(
        around.height, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1e6
    )
    column_here, row_here = np.rint(around.middle / around.step_m).astype(int)
    eye_m = around.height[row_here, column_here] + _BELOW_M
    return np.asarray(np.degrees(np.arctan(((heights - eye_m) / ranges).max(axis=1))))
