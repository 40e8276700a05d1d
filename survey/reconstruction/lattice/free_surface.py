"""Triangle mesh of a surface that may overhang: distances along its normal, vertical sections, and its file."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import cKDTree

from survey.core import BoolArray, FloatArray, InputError, IntArray, checked
from survey.core.files import write_bytes

_N_NEAREST = 4


class VerticalSection(NamedTuple):
    """Lines in which a surface meets a vertical plane.

    `along_m` (S, 2): distances of both ends of each line from the start of the plane [m]. `z_m` (S, 2): heights [m]. `sigma_m` (S, 2):
    standard deviations along the normal [m]. `normals` (S, 2): normals of the facets in the plane. `is_supported` (S,): whether
    points support the facet.
    """

    along_m: FloatArray
    z_m: FloatArray
    sigma_m: FloatArray
    normals: FloatArray
    is_supported: BoolArray


class SurfaceDistances(NamedTuple):
    """SurfaceDistances (P,) of places from a surface along its normal [m], positive on the open side, and what holds there.

    `sigma_m` (P,): standard deviation of the surface along the normal [m]. `is_supported` (P,): whether points support the facet.
    """

    distance_m: FloatArray
    sigma_m: FloatArray
    is_supported: BoolArray


@dataclass(frozen=True, eq=False)
class FreeSurface:
    """Triangle mesh of a surface that may overhang, with the standard deviation of each node along its normal.

    Parameters
    ----------
    nodes : (N, 3) ndarray
        Places [m].
    triangles : (M, 3) ndarray of int
        Nodes of each triangle, counter-clockwise as seen from the scanner.
    normals : (N, 3) ndarray
        Unit normals on the open side.
    sigma_m : (N,) ndarray
        Standard deviation along the normal, with the roughness that is finer than the nodes [m].
    is_supported : (N,) ndarray of bool
        Whether points lie on a facet of the node; the others are interpolated.
    step_m : float
        Mean distance of nodes of the first mesh [m].
    bending_m, roughness_m : float
        Learned scales τ and ρ [m].
    factors : (float, float)
        Factors on the standard deviation of nodes with and without points, from points that were left out.
    """

    nodes: FloatArray
    triangles: IntArray
    normals: FloatArray
    sigma_m: FloatArray
    is_supported: BoolArray
    step_m: float
    bending_m: float
    roughness_m: float
    factors: tuple[float, float]

    @property
    def covariance(self) -> FloatArray:
        """Covariance of each node (N, 3, 3) [m²]; along the surface nodes slide, so that it is of the normal alone."""
        n = self.normals
        return (self.sigma_m**2)[:, None, None] * n[:, :, None] * n[:, None, :]

    def distances(self, places: npt.ArrayLike) -> SurfaceDistances:
        """Return the signed distances of places from the nearest points of the surface, along its normal but at its rim.

        Parameters
        ----------
        places : (P, 3) array_like
            Places [m].

        Returns
        -------
        SurfaceDistances
            Distances and standard deviations [m], and whether points support the facet.

        Raises
        ------
        InputError
            Places that are no finite (P, 3) numbers.
        """
        xyz = checked(places, (None, 3), "the places")
        facet, weights = nearest_facets(self.nodes, self.triangles, xyz, np.zeros_like(xyz), np.inf)
        corners = self.triangles[facet]
        offset = xyz - (weights[:, :, None] * self.nodes[corners]).sum(axis=1)
        above = (offset * facet_normals(self.nodes, corners)).sum(axis=1)
        sigma = (weights * self.sigma_m[corners]).sum(axis=1)
        away = np.copysign(np.linalg.norm(offset, axis=1), above)
        return SurfaceDistances(away, sigma, np.asarray(self.is_supported[corners].all(axis=1)))

    def section(self, start: npt.ArrayLike, end: npt.ArrayLike) -> VerticalSection:
        """Return the lines in which the surface meets the vertical plane between two places.

        Parameters
        ----------
        start, end : (2,) array_like
            Easting and northing of both ends of the plane [m].

        Returns
        -------
        VerticalSection
            Lines between the ends, in no order.

        Raises
        ------
        InputError
            Ends that are one place.
        """
        a, b = checked(start, (2,), "the start"), checked(end, (2,), "the end")
        length = float(np.hypot(*(b - a)))
        if length == 0.0:
            raise InputError("the section starts where it ends; give two places.")
        along = (b - a) / length
        offset = (self.nodes[:, :2] - a) @ [-along[1], along[0]]
        offset = np.where(offset == 0.0, 1e-12, offset)
        side = offset[self.triangles] > 0.0
        cut = np.flatnonzero(side.any(axis=1) & ~side.all(axis=1))
        values = np.column_stack([(self.nodes[:, :2] - a) @ along, self.nodes[:, 2], self.sigma_m])
        # One corner lies alone on its side; both lines from it cross the plane.
        alone = np.argmax(side[cut] == (side[cut].sum(axis=1) == 1)[:, None], axis=1)
        own = self.triangles[cut, alone]
        others = np.stack([self.triangles[cut, (alone + k) % 3] for k in (1, 2)], axis=1)
        part = offset[own][:, None] / (offset[own][:, None] - offset[others])
        ends = values[own][:, None] + part[:, :, None] * (values[others] - values[own][:, None])
        facets = facet_normals(self.nodes, self.triangles[cut])
        flat = np.column_stack([facets[:, :2] @ along, facets[:, 2]])
        inside = (ends[:, :, 0].max(axis=1) >= 0.0) & (ends[:, :, 0].min(axis=1) <= length)
        supported = np.asarray(self.is_supported[self.triangles[cut]].all(axis=1))
        along_m, z_m, sigma_m = np.moveaxis(ends[inside], 2, 0)
        return VerticalSection(along_m, z_m, sigma_m, flat[inside], supported[inside])

    def write(self, path: str | Path) -> None:
        """Write the mesh as binary PLY with ``sigma`` and ``supported`` at each vertex, which CloudCompare and QGIS open.

        Parameters
        ----------
        path : str or pathlib.Path
            The file, replaced where it exists.
        """
        fields = [(name, "<f8") for name in ("x", "y", "z")] + [
            (name, "<f4") for name in ("nx", "ny", "nz", "sigma")
        ]
        vertices = np.zeros(len(self.nodes), dtype=[*fields, ("supported", "u1")])
        for name, column in zip(("x", "y", "z"), self.nodes.T, strict=True):
            vertices[name] = column
        for name, column in zip(("nx", "ny", "nz"), self.normals.T, strict=True):
            vertices[name] = column
        vertices["sigma"], vertices["supported"] = self.sigma_m, self.is_supported
        faces = np.zeros(len(self.triangles), dtype=[("n", "u1"), ("corners", "<i4", (3,))])
        faces["n"], faces["corners"] = 3, self.triangles
        kinds = {"<f8": "double", "<f4": "float", "u1": "uchar"}
        lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
        lines += [f"property {kinds[kind]} {name}" for name, kind in [*fields, ("supported", "u1")]]
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
        write_bytes(path, "\n".join(lines).encode() + vertices.tobytes() + faces.tobytes())


def facet_normals(nodes: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the unit normals of triangles (M, 3)."""
    a, b, c = (nodes[column] for column in triangles.T)
    normals = np.cross(b - a, c - a)
    unit: FloatArray = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    return unit


def nearest_facets(
    nodes: FloatArray, triangles: IntArray, places: FloatArray, rays: FloatArray, farthest_m: float
) -> tuple[IntArray, FloatArray]:
    """Return the facet next to each place (P,) and the weights of its nodes at the nearest point of it (P, 3).

    Facets of the four nearest nodes are searched, those that face the ray (P, 3) alone; rays of zero allow all. The facet is -1 where
    none is within `farthest_m`.
    """
    corners = triangles.ravel()
    order = np.argsort(corners, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(corners, minlength=len(nodes)))])
    k = min(_N_NEAREST, len(nodes))
    _, near = cKDTree(nodes).query(places, k=k)
    normals = facet_normals(nodes, triangles)
    return _nearest(
        nodes, triangles, normals, first, order // 3, near.reshape(-1, k), places, rays, farthest_m
    )


@njit(cache=True)
def _nearest(  # noqa: PLR0917  (numba takes no keywords)
    nodes: FloatArray,
    triangles: IntArray,
    normals: FloatArray,
    first: IntArray,
    incident: IntArray,
    near: IntArray,
    places: FloatArray,
    rays: FloatArray,
    farthest: float,
) -> tuple[IntArray, FloatArray]:
    """Search the facets of the nearest nodes, by the nearest point of each triangle (Ericson 2004, section 5.1.5)."""
    n = len(places)
    facet, weights = np.full(n, -1), np.zeros((n, 3))
    for i in range(n):
        best = farthest * farthest
        for node in near[i]:
            for k in range(first[node], first[node + 1]):
                f = incident[k]
                if rays[i, 0] * normals[f, 0] + rays[i, 1] * normals[f, 1] + rays[i, 2] * normals[f, 2] > 0.0:
                    continue
                a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
                v, w = _on_triangle(nodes, a, b, c, places, i)
                away = 0.0
                for axis in range(3):
                    u = 1.0 - v - w
                    away += (
                        places[i, axis] - u * nodes[a, axis] - v * nodes[b, axis] - w * nodes[c, axis]
                    ) ** 2
                if away < best:
                    best, facet[i] = away, f
                    weights[i, 0], weights[i, 1], weights[i, 2] = 1.0 - v - w, v, w
    return facet, weights


@njit(cache=True)
def _on_triangle(  # noqa: PLR0917  (numba takes no keywords)
    nodes: FloatArray, a: int, b: int, c: int, places: FloatArray, i: int
) -> tuple[float, float]:
    """Return the weights of the nodes b and c at the point of triangle a, b, c that is nearest to place i."""
    d00 = d01 = d11 = e0 = e1 = 0.0
    for axis in range(3):
        u, v, q = (
            nodes[b, axis] - nodes[a, axis],
            nodes[c, axis] - nodes[a, axis],
            places[i, axis] - nodes[a, axis],
        )
        d00, d01, d11 = d00 + u * u, d01 + u * v, d11 + v * v
        e0, e1 = e0 + u * q, e1 + v * q
    det = d00 * d11 - d01 * d01
    if det > 1e-18:
        v, w = (d11 * e0 - d01 * e1) / det, (d00 * e1 - d01 * e0) / det
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            return v, w
    best_v, best_w, least = 0.0, 0.0, np.inf
    s = min(max(e0 / max(d00, 1e-18), 0.0), 1.0)
    t = min(max(e1 / max(d11, 1e-18), 0.0), 1.0)
    side = d00 - 2.0 * d01 + d11
    r = min(max((e1 - e0 + d00 - d01) / max(side, 1e-18), 0.0), 1.0)
    for v, w in ((s, 0.0), (0.0, t), (1.0 - r, r)):
        away = v * v * d00 + 2.0 * v * w * d01 + w * w * d11 - 2.0 * (v * e0 + w * e1)
        if away < least:
            best_v, best_w, least = v, w, away
    return best_v, best_w
