r"""First mesh of a surface that may overhang: an indicator function of the open side, and its zero surface.

`surface_net` estimates normals of the points, turned to the scanner, and solves the screened Poisson equation (Kazhdan and
Hoppe 2013, *Screened Poisson surface reconstruction*) for an indicator function f that rises across the surface:

.. math::  \min_f \int |\nabla f - V|^2 + \frac{s}{h} \sum_p a_p f(p)^2 + \frac{c}{h} \sum_q a_q (f(q) - \tfrac12)^2

with the smoothed field V of the normals, the step h of the grid, the area :math:`a_p` of a point, and places q that lines of sight
passed. Where f changes its sign nodes are set as in surface nets (Gibson 1998, *Constrained elastic surface nets*), one for each
cell of the grid, so that they are about a step apart on walls and under overhangs as well.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, cg
from scipy.spatial import cKDTree

from survey.core import BoolArray, FloatArray, InputError, IntArray

_N_NEIGHBOURS = 10
_PAD = 5
_MOST_CELLS = 8_000_000
_SCREEN, _PASSED = 4.0, 0.5
# Places that lines of sight passed lie so many steps before their ends.
_BEFORE_END = (2.0, 4.0, 8.0)
_BLUR = 1.0
_ITERATIONS, _TOLERANCE = 40, 1e-2
_LEAST_SHARE = 0.005
"""Pieces with fewer of the supported nodes are left out."""


class TangentPatches(NamedTuple):
    """Means of the points of small cells: places (M, 3) [m], normals towards the scanner (M, 3), rays (M, 3), areas (M,) [m²]."""

    places: FloatArray
    normals: FloatArray
    rays: FloatArray
    areas: FloatArray


def surface_net(
    xyz: FloatArray, origins: FloatArray, step_m: float, reach_m: float
) -> tuple[FloatArray, IntArray]:
    """Return nodes (N, 3) [m] and triangles (M, 3), counter-clockwise as seen from the scanner, of a surface through points.

    Parameters
    ----------
    xyz, origins : (P, 3) ndarray
        Points and the places from which the scanner saw them [m].
    step_m : float
        Distance between the nodes [m].
    reach_m : float
        Greatest distance of a node from points [m].

    Returns
    -------
    nodes : (N, 3) ndarray
        Places [m].
    triangles : (M, 3) ndarray of int
        Nodes of each triangle.

    Raises
    ------
    InputError
        Too few points, a grid of too many cells, or points that show no surface.
    """
    patches = _patches(xyz, origins, step_m)
    low = patches.places.min(axis=0) - _PAD * step_m
    shape = tuple(np.ceil((np.ptp(patches.places, axis=0)) / step_m).astype(int) + 2 * _PAD + 1)
    if np.prod(shape, dtype=float) > _MOST_CELLS:
        raise InputError(
            f"the points extend over {shape[0]} × {shape[1]} × {shape[2]} steps of {step_m:g} m, more than {_MOST_CELLS:,} cells; "
            "give a larger step or fewer points."
        )
    indicator = _indicator(patches, low, shape, step_m)
    nodes, quads = _zero_surface(indicator)
    nodes = low + step_m * nodes
    away = np.asarray(cKDTree(patches.places).query(nodes, distance_upper_bound=reach_m)[0])
    quads = quads[_kept(quads, away <= reach_m, away <= step_m)]
    if not len(quads):
        raise InputError(
            f"{len(xyz)} points show no surface with nodes {step_m:g} m apart; give more points or a larger step."
        )
    used, index = np.unique(quads, return_inverse=True)
    return nodes[used], _split(nodes[used], index.reshape(-1, 4))


def _patches(xyz: FloatArray, origins: FloatArray, step_m: float) -> TangentPatches:
    """Average points over cells of half a step, and estimate normals and areas from the nearest ten."""
    _, cell, count = np.unique(cell_numbers(xyz, 0.5 * step_m), return_inverse=True, return_counts=True)
    if len(count) <= _N_NEIGHBOURS:
        raise InputError(
            f"{len(xyz)} points in {len(count)} places are too few for a surface; give more points or a smaller step."
        )
    rays = xyz - origins
    rays = rays / np.linalg.norm(rays, axis=1)[:, None]
    sums = [np.bincount(cell, column) / count for column in (*xyz.T, *rays.T)]
    places, rays = np.column_stack(sums[:3]), np.column_stack(sums[3:])
    away, near = (np.asarray(found) for found in cKDTree(places).query(places, k=_N_NEIGHBOURS + 1))
    offsets = places[near] - places[near].mean(axis=1)[:, None]
    _, vectors = np.linalg.eigh(offsets.transpose(0, 2, 1) @ offsets)
    normals = vectors[:, :, 0]
    normals = np.where((normals * rays).sum(axis=1)[:, None] > 0.0, -normals, normals)
    radius = np.minimum(away[:, -1], 2.0 * step_m)
    return TangentPatches(places, normals, rays, np.pi * radius**2 / _N_NEIGHBOURS)


def cell_numbers(xyz: FloatArray, side_m: float) -> IntArray:
    """Return one number for the cubic cell of each point (P,)."""
    i, j, k = np.floor((xyz - xyz.min(axis=0)) / side_m).astype(np.int64).T
    numbers: IntArray = (i * (j.max() + 1) + j) * (k.max() + 1) + k
    return numbers


def _indicator(patches: TangentPatches, low: FloatArray, shape: tuple[int, ...], step_m: float) -> FloatArray:
    """Solve for the indicator function on a grid, by conjugate gradients that a cosine transform preconditions."""
    places = (patches.places - low) / step_m
    areas = patches.areas / step_m**2
    weights = _trilinear(places, shape)
    fields = [
        gaussian_filter((weights.T @ (areas * normal)).reshape(shape), _BLUR) for normal in patches.normals.T
    ]
    rhs = np.zeros(shape)
    for axis, field in enumerate(fields):
        rhs -= _divergence(field, axis)
    passed = np.vstack([places - back * patches.rays for back in _BEFORE_END])
    inside = ((passed >= 0.0) & (passed < np.array(shape) - 1.0)).all(axis=1)
    open_side = _trilinear(passed[inside], shape)
    open_area = _PASSED * np.tile(areas, len(_BEFORE_END))[inside]
    right = rhs.ravel() + 0.5 * (open_side.T @ open_area)
    data = (
        weights.T @ weights.multiply(_SCREEN * areas[:, None])
        + open_side.T @ open_side.multiply(open_area[:, None])
    ).tocsr()
    eigenvalues = sum(
        (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n)).reshape([-1 if a == axis else 1 for a in range(3)])
        for axis, n in enumerate(shape)
    )
    shift = 0.5 * data.diagonal().mean() + 1e-3

    def times(f: FloatArray) -> FloatArray:
        laplacian_and_data: FloatArray = _laplacian(f.reshape(shape)).ravel() + data @ f
        return laplacian_and_data

    def preconditioned(r: FloatArray) -> FloatArray:
        smooth = dctn(r.reshape(shape), norm="ortho") / (eigenvalues + shift)
        inverse: FloatArray = np.asarray(idctn(smooth, norm="ortho"))
        return inverse.ravel()

    n = int(np.prod(shape))
    f, _ = cg(
        LinearOperator((n, n), times),
        right,
        rtol=_TOLERANCE,
        maxiter=_ITERATIONS,
        M=LinearOperator((n, n), preconditioned),
    )
    return np.asarray(f).reshape(shape)


def _trilinear(places: FloatArray, shape: tuple[int, ...]) -> csr_array:
    """Return the weights (M, cells) with which places, in steps, lie between the nodes of a grid."""
    base = np.clip(np.floor(places).astype(np.int64), 0, np.array(shape) - 2)
    part = places - base
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    columns, values = [], []
    for corner in np.ndindex(2, 2, 2):
        columns.append((base + corner) @ strides)
        values.append(np.prod(np.where(corner, part, 1.0 - part), axis=1))
    rows = np.tile(np.arange(len(places)), 8)
    return coo_array(
        (np.concatenate(values), (rows, np.concatenate(columns))), shape=(len(places), int(np.prod(shape)))
    ).tocsr()


def _divergence(field: FloatArray, axis: int) -> FloatArray:
    """Return the difference of a field between the faces of each cell along an axis; none passes the rim."""
    moved = np.moveaxis(field, axis, 0)
    faces = np.zeros((len(moved) + 1, *moved.shape[1:]))
    faces[1:-1] = 0.5 * (moved[1:] + moved[:-1])
    return np.moveaxis(np.diff(faces, axis=0), 0, axis)


@njit(cache=True)
def _laplacian(f: FloatArray) -> FloatArray:
    """Return the negative Laplacian of a grid of heights whose rim is free."""
    out = np.zeros_like(f)
    nx, ny, nz = f.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                c = f[i, j, k]
                total = 0.0
                if i > 0:
                    total += c - f[i - 1, j, k]
                if i < nx - 1:
                    total += c - f[i + 1, j, k]
                if j > 0:
                    total += c - f[i, j - 1, k]
                if j < ny - 1:
                    total += c - f[i, j + 1, k]
                if k > 0:
                    total += c - f[i, j, k - 1]
                if k < nz - 1:
                    total += c - f[i, j, k + 1]
                out[i, j, k] = total
    return out


def _zero_surface(f: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return nodes (N, 3) in steps and quadrilaterals (Q, 4) of the surface where f is zero."""
    cubes = tuple(n - 1 for n in f.shape)
    total, count = np.zeros((*cubes, 3)), np.zeros(cubes)
    crossings = []
    for axis in range(3):
        start, end = np.moveaxis(f, axis, 0)[:-1], np.moveaxis(f, axis, 0)[1:]
        crossed = np.moveaxis((start > 0.0) != (end > 0.0), 0, axis)
        where = np.argwhere(crossed)
        a, b = f[tuple(where.T)], f[tuple((where + np.eye(3, dtype=int)[axis]).T)]
        at = where.astype(np.float64)
        at[:, axis] += a / (a - b)
        sides = [s for s in range(3) if s != axis]
        around = []
        for down in ((0, 0), (1, 0), (1, 1), (0, 1)):
            cube = where.copy()
            cube[:, sides[0]] -= down[0]
            cube[:, sides[1]] -= down[1]
            inside = (cube >= 0).all(axis=1) & (cube < cubes).all(axis=1)
            index = tuple(cube[inside].T)
            np.add.at(total, index, at[inside])
            np.add.at(count, index, 1.0)
            around.append(np.where(inside, cube @ [cubes[1] * cubes[2], cubes[2], 1], -1))
        quads = np.column_stack(around)
        # The cubes go round the edge clockwise about the second axis, and the surface faces the positive side.
        flip = (b > a) == (axis == 1)
        quads[flip] = quads[flip][:, ::-1]
        crossings.append(quads[(quads >= 0).all(axis=1)])
    hit = np.flatnonzero(count.ravel())
    number = np.full(count.size, -1)
    number[hit] = np.arange(len(hit))
    nodes = total.reshape(-1, 3)[hit] / count.ravel()[hit][:, None]
    return nodes, number[np.vstack(crossings)]


def _kept(quads: IntArray, is_near: BoolArray, is_supported: BoolArray) -> BoolArray:
    """Return which quadrilaterals (Q,) lie near points, in pieces that a share of the supported nodes belongs to."""
    near = is_near[quads].all(axis=1)
    edges = quads[near][:, [0, 1, 1, 2, 2, 3]].reshape(-1, 2)
    n = len(is_near)
    _, piece = connected_components(coo_array((np.ones(len(edges)), edges.T), shape=(n, n)), directed=False)
    held = np.bincount(piece, is_supported)
    large = held >= _LEAST_SHARE * is_supported.sum()
    kept: BoolArray = near & large[piece[quads[:, 0]]]
    return kept


def _split(nodes: FloatArray, quads: IntArray) -> IntArray:
    """Divide quadrilaterals along their shorter diagonals into triangles (M, 3)."""
    a, b, c, d = (nodes[column] for column in quads.T)
    first = (((a - c) ** 2).sum(axis=1) <= ((b - d) ** 2).sum(axis=1))[:, None]
    upper = np.where(first, quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    lower = np.where(first, quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    triangles: IntArray = np.vstack([upper, lower])
    return triangles
