"""Glacier hazards carved into fine terrain: crevasses, melt channels, pools, dirt cones and boulders."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import shapely
from rasterio.features import shapes
from rasterio.transform import Affine
from scipy.spatial import cKDTree

from sim.world.boulders import draw_blocks, lay_blocks, number_above
from survey.core import FloatArray

FloatGrid = npt.NDArray[np.float32]
HazardKind = Literal["crevasse", "bridged crevasse", "melt channel", "melt pool", "dirt cone", "boulder"]

_LINE_STEP_M = 0.1
_ICE_TONE = 0.80


@dataclass(frozen=True)
class Hazard:
    """Hazard and its outline.

    `kind`: "crevasse" (open), "bridged crevasse", "melt channel", "melt pool", "dirt cone" or
    "boulder". `outline`: where it is, easting and northing [m].
    """

    kind: HazardKind
    outline: shapely.Polygon


@dataclass(frozen=True)
class Ground:
    """Grids of the fine terrain while hazards are carved; the first row is the northern one.

    Coordinates within are metres east and south of the north-western node, so that columns
    and rows are `x / step_m` and `y / step_m`.
    """

    height: FloatGrid
    """Elevation [m]."""
    tone: FloatGrid
    """Reflectance as a share of clean snow's."""
    water: FloatGrid
    """Share of the surface that is open water."""
    openness: FloatGrid
    """Visible share of the sky."""
    step_m: float

    @property
    def size_m(self) -> FloatArray:
        """Extent to the east and to the south [m]."""
        rows, columns = self.height.shape
        return np.array([columns - 1, rows - 1]) * self.step_m

    def place(self, rng: np.random.Generator, margin_m: float) -> FloatArray:
        """Draw a place at least `margin_m` (or a quarter of the site) from the edges."""
        margin = np.minimum(margin_m, 0.25 * self.size_m)
        place: FloatArray = rng.uniform(margin, self.size_m - margin)
        return place

    def window(self, low: FloatArray, high: FloatArray) -> tuple[slice, slice]:
        """Return the rows and columns of the nodes between two corners."""
        first = np.clip(np.floor(low / self.step_m), 0, None).astype(int)
        last = np.clip(np.ceil(high / self.step_m) + 1, 0, self.height.shape[::-1]).astype(int)
        return slice(first[1], last[1]), slice(first[0], last[0])

    def nodes(self, window: tuple[slice, slice]) -> FloatArray:
        """Return x and y of the nodes of a window, (rows, columns, 2) [m]."""
        y, x = np.mgrid[window].astype(np.float64) * self.step_m
        return np.stack([x, y], axis=-1)


@dataclass(frozen=True)
class Slot:
    """Plan of a crevasse or a channel: a line with a width."""

    line: FloatArray
    half_width_m: FloatArray

    def across(self, ground: Ground) -> tuple[tuple[slice, slice], FloatArray, FloatArray]:
        """Return the window around the slot, each node's distance from the line and the half width there [m]."""
        reach = float(self.half_width_m.max()) + ground.step_m
        window = ground.window(self.line.min(axis=0) - reach, self.line.max(axis=0) + reach)
        distance, nearest = cKDTree(self.line).query(ground.nodes(window), distance_upper_bound=reach)
        return window, np.asarray(distance), np.append(self.half_width_m, 0.0)[nearest]

    def outline(self) -> shapely.Polygon:
        """Return the outline in the ground's own metres."""
        along = np.gradient(self.line, axis=0)
        side = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
        offset = self.half_width_m[:, None] * side
        ring = shapely.Polygon(np.vstack([self.line + offset, (self.line - offset)[::-1]]))
        return _largest(shapely.make_valid(ring))


def crevasse(ground: Ground, rng: np.random.Generator, depth_m: float) -> Hazard:
    """Cut an open crevasse, 0.5 to 1 m wide, into the ground."""
    slot = _winding(ground, rng, width_m=(0.5, 1.0))
    window, distance, half_width = slot.across(ground)
    # Walls are one cell wide: steeper ones a height field cannot hold.
    opened = np.clip((half_width - distance) / ground.step_m + 0.5, 0.0, 1.0)
    opened[half_width == 0.0] = 0.0
    ground.height[window] -= depth_m * opened
    ground.openness[window] = np.minimum(ground.openness[window], 1.0 - 0.9 * opened)
    ground.tone[window] *= 1.0 - (1.0 - _ICE_TONE) * opened
    ground.water[window] *= 1.0 - opened
    return Hazard("crevasse", slot.outline())


def bridged_crevasse(ground: Ground, rng: np.random.Generator) -> Hazard:
    """Carve a snow bridge, 0.8 to 1.8 m wide, that sags by 5 to 20 cm over a crevasse."""
    slot = _winding(ground, rng, width_m=(0.8, 1.8))
    window, distance, half_width = slot.across(ground)
    sag = _bowl(distance, half_width)
    ground.height[window] -= rng.uniform(0.05, 0.20) * sag
    ground.tone[window] *= 1.0 - 0.03 * sag
    return Hazard("bridged crevasse", slot.outline())


def melt_channel(
    ground: Ground, rng: np.random.Generator, width_m: tuple[float, float] = (0.4, 1.0)
) -> Hazard:
    """Cut a channel that meanders downhill with water on its bed."""
    line = _downhill(ground, rng, length_m=float(rng.uniform(30.0, 120.0)))
    slot = Slot(line, 0.5 * _tapered(len(line), rng.uniform(*width_m)))
    window, distance, half_width = slot.across(ground)
    cut = _bowl(distance, half_width)
    ground.height[window] -= rng.uniform(0.15, 0.40) * cut
    ground.openness[window] *= 1.0 - 0.35 * cut
    ground.tone[window] *= 1.0 - (1.0 - _ICE_TONE) * np.sqrt(cut)
    ground.water[window] = np.maximum(ground.water[window], np.clip(3.0 * cut - 1.5, 0.0, 1.0))
    return Hazard("melt channel", slot.outline())


def melt_pool(ground: Ground, rng: np.random.Generator) -> Hazard | None:
    """Fill a hollow, up to 13 m across, with water to a level; None where the ground is too steep for one."""
    reach = 8.0
    start = ground.place(rng, 2.0 * reach)
    window = ground.window(start - reach, start + reach)
    lowest = np.unravel_index(np.argmin(ground.height[window]), ground.height[window].shape)
    centre = ground.nodes(window)[lowest]
    window = ground.window(centre - reach, centre + reach)
    distance = np.linalg.norm(ground.nodes(window) - centre, axis=-1)
    radius = rng.uniform(3.0, 6.5)
    height = ground.height[window] - 0.5 * np.clip(1.0 - (distance / radius) ** 2, 0.0, None)
    level = height.min() + rng.uniform(0.15, 0.30)
    wet = (height < level) & (distance < 1.2 * radius)
    if wet.sum() * ground.step_m**2 < 1.0:
        return None
    shore = np.clip((level - height) / 0.05 + 0.5, 0.0, 1.0) * (distance < 1.2 * radius)
    ground.height[window] = np.where(wet, level, height)
    ground.water[window] = np.maximum(ground.water[window], shore)
    ground.tone[window] *= 1.0 - 0.1 * shore
    outlines = [shapely.geometry.shape(ring) for ring, _ in shapes(wet.astype(np.uint8), mask=wet)]
    corner = np.array([window[1].start, window[0].start]) - 0.5
    outline = shapely.transform(
        _largest(shapely.union_all(outlines)), lambda uv: (uv + corner) * ground.step_m
    )
    return Hazard("melt pool", outline)


def dirt_cone(ground: Ground, rng: np.random.Generator) -> Hazard:
    """Add a dirt-covered cone of ice, 0.3 to 1 m high."""
    centre = ground.place(rng, 3.0)
    tall = rng.uniform(0.3, 1.0)
    radius = tall * rng.uniform(1.2, 1.8)
    window = ground.window(centre - radius, centre + radius)
    offset = ground.nodes(window) - centre
    bearing = np.arctan2(offset[..., 1], offset[..., 0])
    ragged = radius * (1.0 + 0.15 * np.sin(3.0 * bearing + rng.uniform(0.0, 2.0 * np.pi)))
    near = 1.0 - np.linalg.norm(offset, axis=-1) / ragged
    ground.height[window] += tall * np.clip(near, 0.0, None)
    ground.tone[window] *= 1.0 - rng.uniform(0.45, 0.65) * np.clip(3.0 * near, 0.0, 1.0)
    return Hazard("dirt cone", shapely.Point(centre).buffer(radius, quad_segs=8))


def scatter_boulders(ground: Ground, rng: np.random.Generator, above_1_m: float) -> list[Hazard]:
    """Lay boulders up to 5 m wide on the ground, of which so many are wider than 1 m; the nodes can hold no small ones."""
    least_m = 2.5 * ground.step_m
    number = int(number_above(least_m, above_1_m) + rng.random())
    blocks = draw_blocks(rng, number, (least_m, 5.0), ground.size_m, tone_sd=0.25)
    lay_blocks(ground.height, ground.tone, ground.step_m, blocks, periodic=False)
    circles = shapely.buffer(shapely.points(blocks.place_m), 0.5 * blocks.size_m, quad_segs=2)
    return [Hazard("boulder", circle) for circle in circles]


def carve_hazards(ground: Ground, count: int, carve: Callable[[], Hazard | None]) -> list[Hazard]:
    """Put `count` hazards of one kind on the ground."""
    found = (carve() for _ in range(count if min(ground.size_m) > 4.0 else 0))
    return [hazard for hazard in found if hazard is not None]


def place_hazard(hazard: Hazard, transform: Affine) -> Hazard:
    """Return a hazard in the world's easting and northing; `transform` is the ground's, of its cells."""
    step = float(transform.a)
    corner = np.array([transform.c + 0.5 * step, transform.f - 0.5 * step])
    return Hazard(hazard.kind, shapely.transform(hazard.outline, lambda xy: corner + xy * (1.0, -1.0)))


def _bowl(distance: FloatArray, half_width: FloatArray) -> FloatArray:
    """Return a cross-section: 1 in the middle, 0 from the half width on."""
    share = np.divide(distance, half_width, out=np.ones_like(distance), where=half_width > 0.0)
    bowl: FloatArray = np.clip(1.0 - share**2, 0.0, 1.0)
    return bowl


def _tapered(n: int, width_m: float) -> FloatArray:
    """Return widths along a line that ends in points [m]."""
    from_end = np.minimum(np.arange(n), np.arange(n)[::-1]) * _LINE_STEP_M
    widths: FloatArray = width_m * np.clip(from_end / 4.0, 0.2, 1.0)
    return widths


def _winding(ground: Ground, rng: np.random.Generator, width_m: tuple[float, float]) -> Slot:
    """Draw the plan of a crevasse: nearly straight, the neighbours nearly parallel."""
    length = min(float(rng.uniform(25.0, 90.0)), 0.8 * float(ground.size_m.min()))
    s = np.arange(0.0, length, _LINE_STEP_M)
    aside = 1.2 * np.sin(s / 9.0 + rng.uniform(0.0, 6.0)) + 0.4 * np.sin(s / 3.1 + rng.uniform(0.0, 6.0))
    bearing = 1.2 + rng.uniform(-0.4, 0.4)
    cos, sin = np.cos(bearing), np.sin(bearing)
    along = s - 0.5 * length
    line = ground.place(rng, 20.0) + np.stack([along * cos - aside * sin, along * sin + aside * cos], axis=1)
    inside = ((line > 2.0 * ground.step_m) & (line < ground.size_m - 2.0 * ground.step_m)).all(axis=1)
    line = line[inside]
    return Slot(line, 0.5 * _tapered(len(line), rng.uniform(*width_m)))


def _downhill(ground: Ground, rng: np.random.Generator, length_m: float) -> FloatArray:
    """Return a meandering line down the slope of the larger relief."""
    place = ground.place(rng, 10.0)
    phase, wave = rng.uniform(0.0, 6.0), rng.uniform(2.0, 4.0)
    line = []
    for k in range(int(length_m / _LINE_STEP_M)):
        if k % 20 == 0:
            bearing = _fall_line(ground, place)
        turned = bearing + 0.7 * np.sin(k * _LINE_STEP_M / wave + phase)
        place = place + _LINE_STEP_M * np.array([np.cos(turned), np.sin(turned)])
        if (place < 1.0).any() or (place > ground.size_m - 1.0).any():
            break
        line.append(place)
    return np.array(line)


def _fall_line(ground: Ground, place: FloatArray, reach_m: float = 6.0) -> float:
    """Return the direction in which the ground falls over some metres."""
    window = ground.window(place - reach_m, place + reach_m)
    offset = (ground.nodes(window) - place)[::4, ::4]
    height = ground.height[window][::4, ::4, None]
    slope = (offset * (height - height.mean())).mean(axis=(0, 1))
    return float(np.arctan2(-slope[1], -slope[0]))


def _largest(geometry: Any) -> shapely.Polygon:
    """Return the largest polygon of a geometry."""
    parts = [part for part in shapely.get_parts(geometry) if part.geom_type == "Polygon"]
    return max(parts, key=lambda part: part.area)
