"""Ray casting on the bilinear surface of an elevation raster, exact to rounding."""

from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray
from survey.data.dem import Dem

_FLAT = 1e-12


class Hits(NamedTuple):
    """Distances (N,) along rays to the surface [m], infinite where there is none, and cosines of incidence (N,)."""

    range_m: FloatArray
    cosine: FloatArray


class HeightRaster(NamedTuple):
    """Heights (H, W) [m] at cell centres, rows northwards, with the place of the first one and the spacing [m]."""

    z: FloatArray
    highest: FloatArray
    """Greatest height (H - 1, W - 1) of each patch between four centres [m], infinite where one is not known."""
    west_m: float
    south_m: float
    step_m: float

    @classmethod
    def of(cls, terrain: Dem) -> "HeightRaster":
        """Return the heights of a DEM of square cells; unknown cells are NaN."""
        (xmin, ymin, *_), step = terrain.grid().bounds, terrain.step_m
        z = np.ascontiguousarray(terrain.elevation[::-1])
        highest = np.max([z[:-1, :-1], z[:-1, 1:], z[1:, :-1], z[1:, 1:]], axis=0)
        return cls(z, np.where(np.isnan(highest), np.inf, highest), xmin, ymin, step)

    def hits(self, start: FloatArray, direction: FloatArray, farthest_m: float) -> Hits:
        """Return where rays from `start` (N, 3) [m] along unit vectors (N, 3) meet the surface from above.

        A ray that leaves the raster or reaches unknown ground meets nothing.
        """
        origin = np.array([self.west_m, self.south_m, 0.0])
        scale = np.array([1.0 / self.step_m, 1.0 / self.step_m, 1.0])
        top = float(np.nanmax(self.z))
        reached, cosine = _cast(
            self.z,
            self.highest,
            np.ascontiguousarray((start - origin) * scale),
            np.ascontiguousarray(direction * scale),
            (farthest_m, self.step_m, top),
        )
        return Hits(reached, cosine)


@njit(cache=True)
def _cast(
    z: FloatArray,
    highest: FloatArray,
    start: FloatArray,
    along: FloatArray,
    limits: tuple[float, float, float],
) -> tuple[FloatArray, FloatArray]:
    """Follow every ray from patch to patch; x and y count in nodes, distances in metres."""
    farthest_m, step_m, top = limits
    n_north, n_east = z.shape
    reached = np.full(len(start), np.inf)
    cosine = np.zeros(len(start))
    for k in range(len(start)):
        du, dv, dz = along[k]
        travelled = 0.0
        while travelled < farthest_m:
            u, v = start[k, 0] + du * travelled, start[k, 1] + dv * travelled
            height = start[k, 2] + dz * travelled
            # A ray on the edge between patches belongs to the one that it enters.
            i, j = int(np.floor(u + 1e-9 * du)), int(np.floor(v + 1e-9 * dv))
            if i < 0 or j < 0 or i >= n_east - 1 or j >= n_north - 1 or (dz >= 0.0 and height > top):
                break
            length = min(_to_edge(u - i, du), _to_edge(v - j, dv), farthest_m - travelled)
            if height + min(dz * length, 0.0) <= highest[j, i]:
                corners = z[j, i], z[j, i + 1], z[j + 1, i], z[j + 1, i + 1]
                if not np.isfinite(highest[j, i]):
                    break
                met = _root(corners, (u - i, v - j, height), (du, dv, dz), length)
                if met >= 0.0:
                    reached[k] = travelled + met
                    cosine[k] = _incidence(corners, u - i + du * met, v - j + dv * met, (du, dv, dz), step_m)
                    break
            travelled += length + 1e-9
    return reached, cosine


@njit(cache=True, inline="always")
def _to_edge(inside: float, along: float) -> float:
    """Return the distance to the edge of the patch in one direction."""
    if along > _FLAT:
        return max((1.0 - inside) / along, 0.0)
    if along < -_FLAT:
        return max(inside / -along, 0.0)
    return np.inf


@njit(cache=True, inline="always")
def _root(
    corners: tuple[float, float, float, float],
    start: tuple[float, float, float],
    along: tuple[float, float, float],
    length: float,
) -> float:
    """Return the first distance at which a ray is at or below the patch, or -1; its height there is quadratic."""
    z00, z10, z01, z11 = corners
    s, t, height = start
    du, dv, dz = along
    a, b, twist = z10 - z00, z01 - z00, z00 - z10 - z01 + z11
    c0 = height - (z00 + a * s + b * t + twist * s * t)
    if c0 <= 0.0:
        return 0.0
    c1 = dz - (a * du + b * dv + twist * (s * dv + t * du))
    c2 = -twist * du * dv
    inside = c1 * c1 - 4.0 * c2 * c0
    if inside < 0.0:
        return -1.0
    # Of the two roots c0 / q and q / c2 the first positive one counts.
    q = -0.5 * (c1 + (np.sqrt(inside) if c1 >= 0.0 else -np.sqrt(inside)))
    first = c0 / q if abs(q) > _FLAT else -1.0
    second = q / c2 if abs(c2) > _FLAT else -1.0
    low, high = min(first, second), max(first, second)
    met = low if low >= 0.0 else high
    return met if 0.0 <= met <= length else -1.0


@njit(cache=True, inline="always")
def _incidence(
    corners: tuple[float, float, float, float],
    s: float,
    t: float,
    along: tuple[float, float, float],
    step_m: float,
) -> float:
    """Return the cosine of the angle between a ray and the normal of the patch."""
    z00, z10, z01, z11 = corners
    to_east = ((z10 - z00) * (1.0 - t) + (z11 - z01) * t) / step_m
    to_north = ((z01 - z00) * (1.0 - s) + (z11 - z10) * s) / step_m
    facing = to_east * along[0] * step_m + to_north * along[1] * step_m - along[2]
    return float(abs(facing) / np.sqrt(1.0 + to_east**2 + to_north**2))
