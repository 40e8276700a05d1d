"""Ruts of the rover's tracks: two bands with the pattern of the cleats along the way that it has driven.

They are shading, not geometry: the depth image and the physics do not know them. The profile of a rut is computed at
each pixel from the pose of the rover that pressed it last, and averaged over the pixel's footprint, so that cleats
vanish with distance.
"""

import math
from typing import NamedTuple

import numpy as np

from sim.rendering.compiled import Doubles, Floats, Ints, entry, f32, i32, row_loop
from sim.rendering.footprint import Footprints
from sim.rendering.light import Light
from survey.core import FloatArray

SPACING_M = 0.1
"""Largest distance between two imprints [m]."""
_CELL_M = 1.0
_TURNED_RAD = 0.05
_SEEN_TO_M = 40.0
_WALL_M = 0.04
_CLEAT_M = 0.11
_CLEAT_DEPTH_SHARE = 0.22
_PRESSED = 0.05
"""Share of light that pressed snow loses."""


class RutMap(NamedTuple):
    """Imprints for the compiled loops, in lists by cells of 1 m, the newest first."""

    heads: Ints
    """(rows × columns) number of the newest imprint of a cell, -1 for none; one element where ruts are off."""
    columns: int
    nexts: Ints
    """(K,) entries of the lists: the next older entry, -1 at the end."""
    imprints: Floats
    """(K, 5) place east and north of the fine terrain's south-western node, heading's cosine and sine, distance driven."""
    half_gauge_m: float
    half_width_m: float
    depth_m: float
    smooth: float
    """Share of the texture that the tracks press flat."""


class Ruts:
    """Ruts that grow while the rover drives.

    Parameters
    ----------
    size_m : (2,) array_like
        Width and height of the terrain [m].
    gauge_m, width_m : float
        Distance of the middles of the two tracks, and the width of a track [m].
    depth_m : float
        Depth of the ruts [m].
    smooth : float
        Share of the texture that the tracks press flat: 0 on ground without snow.

    Examples
    --------
    >>> ruts = Ruts((10.0, 10.0), gauge_m=0.5, width_m=0.15, depth_m=0.03, smooth=0.5)
    >>> ruts.press(5.0, 5.0, 0.0)
    >>> ruts.press(5.04, 5.0, 0.0)  # less than 0.1 m further
    >>> ruts.press(5.2, 5.0, 0.0)
    >>> sorted({round(float(distance), 1) for distance in ruts.map().imprints[:, 4]})
    [0.0, 0.1, 0.2]
    """

    def __init__(
        self, size_m: FloatArray, *, gauge_m: float, width_m: float, depth_m: float, smooth: float
    ) -> None:
        columns, rows = (int(side / _CELL_M) + 1 for side in size_m)
        self._heads = np.full(rows * columns, -1, np.int32)
        self._shape = rows, columns
        self._nexts, self._imprints = np.zeros(256, np.int32), np.zeros((256, 5), np.float32)
        self._n_entries, self._driven_m = 0, 0.0
        self._last: tuple[float, float, float] | None = None
        self._form = 0.5 * gauge_m, 0.5 * width_m, depth_m, smooth

    def press(self, x: float, y: float, heading_rad: float) -> None:
        """Press the tracks into the ground at a pose, if the rover has moved on.

        Parameters
        ----------
        x, y : float
            Place east and north of the fine terrain's south-western node [m].
        heading_rad : float
            Direction of the body, from east to north [rad].
        """
        if self._last is None:
            self._imprint(x, y, heading_rad)
        else:
            before_x, before_y, before_rad = self._last
            moved = math.hypot(x - before_x, y - before_y)
            turned = math.remainder(heading_rad - before_rad, 2.0 * math.pi)
            if moved < SPACING_M and abs(turned) < _TURNED_RAD:
                return
            n, begin_m = max(math.ceil(moved / SPACING_M), 1), self._driven_m
            for share in (k / n for k in range(1, n + 1)):
                self._driven_m = begin_m + share * moved
                place = before_x + share * (x - before_x), before_y + share * (y - before_y)
                self._imprint(*place, before_rad + share * turned)
        self._last = x, y, heading_rad

    def _imprint(self, x: float, y: float, heading_rad: float) -> None:
        """Enter an imprint into the lists of all cells that it touches."""
        imprint = x, y, math.cos(heading_rad), math.sin(heading_rad), self._driven_m
        reach = self._form[0] + self._form[1] + _WALL_M + SPACING_M
        rows, columns = self._shape
        low_row, high_row = max(int((y - reach) / _CELL_M), 0), min(int((y + reach) / _CELL_M), rows - 1)
        low, high = max(int((x - reach) / _CELL_M), 0), min(int((x + reach) / _CELL_M), columns - 1)
        for row in range(low_row, high_row + 1):
            for column in range(low, high + 1):
                self._enter(row * columns + column, imprint)

    def _enter(self, cell: int, imprint: tuple[float, ...]) -> None:
        """Put an imprint before the others of a cell."""
        if self._n_entries == len(self._nexts):
            self._nexts = np.concatenate([self._nexts, np.zeros_like(self._nexts)])
            self._imprints = np.concatenate([self._imprints, np.zeros_like(self._imprints)])
        self._imprints[self._n_entries], self._nexts[self._n_entries] = imprint, self._heads[cell]
        self._heads[cell] = self._n_entries
        self._n_entries += 1

    def map(self) -> RutMap:
        """Return the imprints so far; they are valid until the next one."""
        return RutMap(self._heads, self._shape[1], self._nexts, self._imprints, *self._form)


def no_ruts() -> RutMap:
    """Return the map of ground on which ruts are not shown."""
    return RutMap(
        np.full(1, -1, np.int32), 1, np.zeros(1, np.int32), np.zeros((1, 5), np.float32), 0.0, 0.0, 0.0, 0.0
    )


@row_loop
def press_ruts(n: int, at: Footprints, origin: Doubles, light: Light, ruts: RutMap) -> None:
    """Change the texture where the rover has driven: slopes of the walls and cleats in the sun, and pressed ground."""
    zero, half, one = f32(0), f32(0.5), f32(1)
    ox, oy = f32(origin[0]), f32(origin[1])
    sun_x, sun_y = f32(light.sun[0] / light.sun[2]), f32(light.sun[1] / light.sun[2])
    columns = i32(ruts.columns)
    rows = i32(ruts.heads.size // ruts.columns)
    gauge, width, depth = f32(ruts.half_gauge_m), f32(ruts.half_width_m), f32(ruts.depth_m)
    wave = f32(2.0 * math.pi / _CLEAT_M)
    for k in range(n):
        r = at.range_m[k]
        if r > f32(_SEEN_TO_M):
            continue
        x, y = ox + at.ux[k] * r, oy + at.uy[k] * r
        column, row = i32(x * f32(1.0 / _CELL_M)), i32(y * f32(1.0 / _CELL_M))
        if x < zero or y < zero or column >= columns or row >= rows:
            continue
        at_entry = ruts.heads[entry(i32(row * columns + column))]
        while at_entry >= i32(0):
            e = entry(at_entry)
            at_entry = ruts.nexts[e]
            cos, sin = ruts.imprints[e, 2], ruts.imprints[e, 3]
            dx, dy = x - ruts.imprints[e, 0], y - ruts.imprints[e, 1]
            along, across = dx * cos + dy * sin, dy * cos - dx * sin
            if abs(along) > f32(0.6 * SPACING_M):
                continue
            side = one if across > zero else -one
            off = across - side * gauge  # from the middle of the rut
            # Extents of the footprint across and along the rut.
            towards = abs(at.ux[k] * cos + at.uy[k] * sin)
            aside = abs(at.uy[k] * cos - at.ux[k] * sin)
            wide = aside * at.length_m[k] + towards * at.width_m[k]
            long = towards * at.length_m[k] + aside * at.width_m[k]
            wall = max(f32(_WALL_M), wide)
            if abs(off) > width + half * wall:
                continue
            inside = min(max((width - abs(off)) / wall + half, zero), one)
            on_wall = one if abs(abs(off) - width) < half * wall else zero
            # The walls rise away from the middle of the rut.
            rises = on_wall * depth / wall * (one if off > zero else -one)
            blur = wave * long
            seen = np.exp(f32(-0.04) * blur * blur) * inside
            phase = wave * (ruts.imprints[e, 4] + along)
            # Cleats of one track are a half pitch ahead of the other's.
            phase += f32(math.pi) if side > zero else zero
            climbs = seen * depth * f32(_CLEAT_DEPTH_SHARE) * wave * np.cos(phase)
            gx, gy = climbs * cos - rises * sin, climbs * sin + rises * cos
            shade = min(max(-(gx * sun_x + gy * sun_y), f32(-0.7)), f32(0.6))
            smooth = at.texture[k] * (one - f32(ruts.smooth) * inside)
            at.texture[k] = (one + smooth) * (one + shade - f32(_PRESSED) * inside) - one
            break
