"""Walls that overhang, as triangle meshes, and a scanner whose beams are cast at them.

A scene is a sheet of triangles with sharp edges and roughness finer than the nodes of a lattice. `scan` casts a bundle of
rays for every beam at the mesh: a beam that meets an edge returns a range between the two surfaces or the range of the larger
part, as wide pulses do. Poses err as a whole, so that all points of a scan are shifted and turned together.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit
from pyproj import CRS
from scipy.spatial.transform import Rotation

from survey.core import FloatArray, IntArray
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.free_lattice import beam_covariance

CRS_OF_SCENES = CRS("EPSG:32608")
HALF_M, MESH_M = 6.0, 0.08


class TriangleMesh(NamedTuple):
    """Vertices (V, 3) [m] and triangles (T, 3) of a surface."""

    vertices: FloatArray
    triangles: IntArray

    @property
    def corners(self) -> FloatArray:
        """Places of the three corners of each triangle (T, 3, 3) [m]."""
        return self.vertices[self.triangles]

    def section(self, y: float, step_m: float = 0.03) -> FloatArray:
        """Return places (K, 3) about a step apart on the line in which the surface meets a plane of constant y [m]."""
        offset = self.vertices[self.triangles, 1] - y
        side = offset > 0.0
        cut = np.flatnonzero(side.any(axis=1) & ~side.all(axis=1))
        places = []
        for f in cut:
            ends = []
            for a, b in ((0, 1), (1, 2), (2, 0)):
                if side[f, a] != side[f, b]:
                    part = offset[f, a] / (offset[f, a] - offset[f, b])
                    first, last = self.vertices[self.triangles[f, [a, b]]]
                    ends.append(first + part * (last - first))
            n = max(1, round(float(np.linalg.norm(ends[1] - ends[0])) / step_m))
            places.append(ends[0] + (np.arange(n) + 0.5)[:, None] / n * (ends[1] - ends[0]))
        return np.vstack(places)


class ScannerModel(NamedTuple):
    """Angular step [deg], beam width [deg], range noise [m], and pose errors [m, deg] of a scanner."""

    step_deg: float = 1.0
    width_deg: float = 0.1
    range_sigma_m: float = 0.02
    place_sigma_m: float = 0.01
    tilt_sigma_deg: float = 0.05
    pulse_m: float = 0.5
    reach_m: float = 16.0


STATED = ScannerModel()
WRONG = STATED._replace(width_deg=0.3, place_sigma_m=0.02, tilt_sigma_deg=0.1)


def tilted_serac(rng: np.random.Generator) -> TriangleMesh:
    """Draw a block that leans 15 to 30 degrees over the ground, with side walls."""
    height, lean = rng.uniform(2.2, 3.2), np.tan(np.radians(rng.uniform(15.0, 30.0)))
    length = rng.uniform(2.0, 3.0)

    def section(y: float) -> FloatArray:
        part = 1.0 / (1.0 + np.exp(-(2.2 - abs(y)) / 0.06))
        h = height * part
        over = lean * h
        top = length - 0.2
        return np.array(
            [
                [-HALF_M, 0.0],
                [0.0, 0.0],
                [-over, h],
                [top - over, h - 0.3 * part],
                [length, 0.0],
                [HALF_M, 0.0],
            ]
        )

    return _sheet(section, rng)


def melt_notch(rng: np.random.Generator) -> TriangleMesh:
    """Draw an ice wall that running water has undercut by 0.7 to 1.3 m."""
    depth, rise, height = rng.uniform(0.8, 1.1), rng.uniform(0.7, 1.0), rng.uniform(2.4, 3.2)
    phase = rng.uniform(0.0, 2.0 * np.pi)

    def section(y: float) -> FloatArray:
        cut = depth + 0.2 * np.sin(0.8 * y + phase)
        return np.array(
            [
                [-HALF_M, -0.2],
                [0.2, 0.0],
                [cut, 0.1],
                [cut, 0.35],
                [0.0, rise],
                [-0.15, height],
                [HALF_M, height + 0.2],
            ]
        )

    return _sheet(section, rng)


def glacier_table(rng: np.random.Generator) -> TriangleMesh:
    """Draw a slab of rock on a pedestal of ice."""
    foot, over, rise = rng.uniform(0.7, 1.0), rng.uniform(0.8, 1.2), rng.uniform(1.0, 1.4)
    thick = rng.uniform(0.4, 0.6)
    line = np.array(
        [
            [1e-3, rise + thick + 0.1],
            [foot + over, rise + thick],
            [foot + over + 0.1, rise + 0.05],
            [foot, rise - 0.15],
            [foot + 0.1, 0.15],
            [1.45 * HALF_M, 0.0],
        ]
    )
    radius, z = _divided(line[::-1], 0.09)
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    r, a = np.meshgrid(radius, angle, indexing="ij")
    r = r * (1.0 + 0.06 * np.cos(3.0 * a + rng.uniform(0.0, 6.0)))
    return _rough(
        np.stack([r * np.cos(a), r * np.sin(a), np.broadcast_to(z[:, None], r.shape)], axis=-1), rng
    )


SCENES: dict[str, Callable[[np.random.Generator], TriangleMesh]] = {
    "tilted serac": tilted_serac,
    "melt notch": melt_notch,
    "glacier table": glacier_table,
}


def _sheet(section: Callable[[float], FloatArray], rng: np.random.Generator) -> TriangleMesh:
    """Sweep a vertical section (K, 2) [m], whose corners depend on y, along y."""
    ys = np.arange(-HALF_M, HALF_M + MESH_M, MESH_M)
    lengths = np.hypot(*np.diff(section(0.0), axis=0).T)
    counts = np.maximum(1, np.ceil(lengths / MESH_M)).astype(int)
    rows = []
    for y in ys:
        line = section(float(y))
        x, z = (
            np.concatenate(
                [
                    np.linspace(a, b, n, endpoint=False)
                    for a, b, n in zip(line[:-1, k], line[1:, k], counts, strict=True)
                ]
            )
            for k in (0, 1)
        )
        rows.append(
            np.column_stack([np.append(x, line[-1, 0]), np.full(len(x) + 1, y), np.append(z, line[-1, 1])])
        )
    return _rough(np.stack(rows, axis=1), rng)


def _divided(line: FloatArray, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Divide a line (K, 2) into pieces no longer than a step, with its corners."""
    pieces = [
        np.linspace(a, b, max(2, int(np.ceil(np.hypot(*(b - a)) / step_m)) + 1))[:-1]
        for a, b in pairwise(line)
    ]
    first, second = np.vstack([*pieces, line[-1:]]).T
    return first, second


def _rough(grid: FloatArray, rng: np.random.Generator) -> TriangleMesh:
    """Add relief, 0.1 m at wavelengths of 4 to 9 m, and roughness, 0.02 m at 0.3 to 1 m, and return the triangles of a grid."""
    places = grid.reshape(-1, 3)
    for sd, low, high, n in ((0.1, 4.0, 9.0, 12), (0.02, 0.3, 1.0, 60)):
        directions = rng.standard_normal((n, 3))
        waves = (
            directions
            / np.linalg.norm(directions, axis=1)[:, None]
            * (2.0 * np.pi / rng.uniform(low, high, (n, 1)))
        )
        moves = rng.standard_normal((n, 3)) * sd * np.sqrt(2.0 / n)
        places = places + np.cos(places @ waves.T + rng.uniform(0.0, 2.0 * np.pi, n)) @ moves
    index = np.arange(len(places)).reshape(grid.shape[:2])
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return TriangleMesh(places, np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


def scan(mesh: TriangleMesh, scanner: ScannerModel, seed: int, n_scans: int = 5) -> SurfacePoints:
    """Scan a scene from places about it, and return points with the covariances that `STATED` gives.

    Half of the places lie in front of the overhang. Returns within `HALF_M` of the middle are kept.
    """
    rng = stream(seed, "free nodes", "scans")
    points, origins = [], []
    for k in range(n_scans):
        angle = np.pi + (k - (n_scans - 1) / 2.0) * 1.05 + rng.uniform(-0.2, 0.2)
        away = rng.uniform(6.0, 8.0)
        place = np.array([away * np.cos(angle), away * np.sin(angle), 0.0])
        place[2] = _height(mesh, place) + 1.6
        seen = place + _returns(mesh, scanner, place, rng)
        turn = Rotation.from_rotvec(np.radians(scanner.tilt_sigma_deg) * rng.standard_normal(3))
        shift = scanner.place_sigma_m * rng.standard_normal(3)
        estimated = place + shift
        points.append(turn.apply(seen - place) + estimated)
        origins.append(np.broadcast_to(estimated, seen.shape))
    xyz, at = np.vstack(points), np.vstack(origins)
    kept = np.abs(xyz[:, :2]).max(axis=1) <= HALF_M
    xyz, at = xyz[kept], at[kept]
    stated = beam_covariance(xyz, at, STATED.range_sigma_m, STATED.width_deg / 4.0)
    pose = STATED.place_sigma_m**2 * np.eye(3) + beam_covariance(xyz, at, 0.0, STATED.tilt_sigma_deg)
    return SurfacePoints(xyz, stated + pose, origins=at, crs=CRS_OF_SCENES, own_covariance=stated)


def _height(mesh: TriangleMesh, place: FloatArray) -> float:
    """Return the height of the highest vertex near a place [m]."""
    near = np.hypot(*(mesh.vertices[:, :2] - place[:2]).T) < 0.6
    return float(mesh.vertices[near, 2].max()) if near.any() else 0.0


def _returns(
    mesh: TriangleMesh, scanner: ScannerModel, place: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return vectors from the scanner to its returns (N, 3) [m]."""
    step = np.radians(scanner.step_deg)
    azimuth, elevation = (
        np.arange(0.0, 2.0 * np.pi - step / 2.0, step),
        np.arange(np.radians(-55.0), np.radians(45.0), step),
    )
    half = np.radians(scanner.width_deg) / 2.0
    offsets = [
        (0.0, 0.0),
        *((half * np.cos(t), half * np.sin(t)) for t in np.arange(0.0, 2.0 * np.pi, np.pi / 3.0)),
    ]
    corners = np.ascontiguousarray(mesh.corners - place)
    ranges = np.stack([cast(corners, azimuth + da, elevation + de, step) for da, de in offsets])
    ranges[ranges > scanner.reach_m] = np.nan
    measured = _pulse(ranges.reshape(len(offsets), -1), scanner.pulse_m)
    hit = np.isfinite(measured)
    a, e = (part.ravel()[hit] for part in np.meshgrid(azimuth, elevation, indexing="ij"))
    measured = measured[hit] + scanner.range_sigma_m * rng.standard_normal(hit.sum())
    returns: FloatArray = measured[:, None] * np.column_stack(
        [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
    )
    return returns


def _pulse(ranges: FloatArray, pulse_m: float) -> FloatArray:
    """Return the range of each beam (N,) from those of its rays (R, N): their mean within a pulse, or that of the larger part."""
    nearest = np.nanmin(np.where(np.isnan(ranges), np.inf, ranges), axis=0)
    front = ranges - nearest <= pulse_m
    n_front, n_hit = front.sum(axis=0), np.isfinite(ranges).sum(axis=0)
    is_front = 2 * n_front >= n_hit
    chosen = np.where(front == is_front, ranges, np.nan)
    count = np.isfinite(chosen).sum(axis=0)
    measured = np.nansum(chosen, axis=0) / np.maximum(count, 1)
    return np.where(2 * n_hit > len(ranges), measured, np.nan)


@njit(cache=True)
def cast(corners: FloatArray, azimuth: FloatArray, elevation: FloatArray, step: float) -> FloatArray:
    """Return the range to the first of the triangles (T, 3, 3) [m] along rays of even directions, (A, E); infinite where none is hit.

    Every triangle is tested against the rays within its bounds of azimuth and elevation (Möller and Trumbore 1997).
    """
    n_a, n_e = len(azimuth), len(elevation)
    found = np.full((n_a, n_e), np.inf)
    for t in range(len(corners)):
        p, q, r = corners[t, 0], corners[t, 1], corners[t, 2]
        first = np.arctan2(p[1], p[0])
        low_a, high_a, low_e, high_e = 0.0, 0.0, np.pi, -np.pi
        for corner in (p, q, r):
            da = np.arctan2(corner[1], corner[0]) - first
            da -= 2.0 * np.pi * np.round(da / (2.0 * np.pi))
            low_a, high_a = min(low_a, da), max(high_a, da)
            e = np.arctan2(corner[2], np.hypot(corner[0], corner[1]))
            low_e, high_e = min(low_e, e), max(high_e, e)
        u, v = q - p, r - p
        i0, i1 = (
            int(np.floor((first + low_a - azimuth[0]) / step)),
            int(np.ceil((first + high_a - azimuth[0]) / step)),
        )
        j0 = max(0, int(np.floor((low_e - elevation[0]) / step)) - 1)
        j1 = min(n_e - 1, int(np.ceil((high_e - elevation[0]) / step)) + 1)
        for i in range(i0, i1 + 1):
            a = azimuth[i % n_a]
            for j in range(j0, j1 + 1):
                d = np.array(
                    (np.cos(elevation[j]) * np.cos(a), np.cos(elevation[j]) * np.sin(a), np.sin(elevation[j]))
                )
                h = np.cross(d, v)
                det = u @ h
                if abs(det) < 1e-12:
                    continue
                s = -(p @ h) / det
                if s < 0.0 or s > 1.0:
                    continue
                w = np.cross(-p, u)
                b = (d @ w) / det
                if b < 0.0 or s + b > 1.0:
                    continue
                far = (v @ w) / det
                if 0.05 < far < found[i % n_a, j]:
                    found[i % n_a, j] = far
    return found
