"""The steps between grids, and the coarsest grid solved exactly: what multigrid adds to the stencil's arithmetic, compiled."""

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice.multigrid.plate_prior import Weights
from survey.reconstruction.lattice.multigrid.stencil import apply


@njit(cache=True)
def restrict(fine: FloatArray, coarse: FloatArray) -> None:
    """Set a coarse grid to the transpose of `add_prolonged` applied to a fine one."""
    rows, columns = fine.shape
    coarse[:] = 0.0
    for j in range(rows):
        a, b = coarse[j // 2], coarse[(j + 1) // 2]
        half = 1.0 if j % 2 == 0 else 0.5
        for i in range(0, columns, 2):
            a[i // 2] += half * fine[j, i]
        for i in range(1, columns, 2):
            a[i // 2] += 0.5 * half * fine[j, i]
            a[i // 2 + 1] += 0.5 * half * fine[j, i]
        if j % 2:
            for i in range(0, columns, 2):
                b[i // 2] += half * fine[j, i]
            for i in range(1, columns, 2):
                b[i // 2] += 0.5 * half * fine[j, i]
                b[i // 2 + 1] += 0.5 * half * fine[j, i]


@njit(cache=True, inline="always")
def _coarse_shares(i: int) -> tuple[int, int, float]:
    """Return the one or two coarse nodes that a fine one lies between, and the share of the first."""
    return i // 2, (i + 1) // 2, 1.0 if i % 2 == 0 else 0.5


@njit(cache=True)
def _add_coupling(w: float, p: tuple[int, int], q: tuple[int, int], coarse: FloatArray) -> None:
    """Add a coupling w of the fine nodes p and q to the coarse stencil: the coarse functions' values there, multiplied."""
    pj, pjj, ps = _coarse_shares(p[0])
    pi, pii, pt = _coarse_shares(p[1])
    qj, qjj, qs = _coarse_shares(q[0])
    qi, qii, qt = _coarse_shares(q[1])
    itself = p == q
    for a in range(1 if pj == pjj else 2):
        for b in range(1 if pi == pii else 2):
            left = w * (ps if a == 0 else 1.0 - ps) * (pt if b == 0 else 1.0 - pt)
            j, i = (pj if a == 0 else pjj), (pi if b == 0 else pii)
            for c in range(1 if qj == qjj else 2):
                for d in range(1 if qi == qii else 2):
                    value = left * (qs if c == 0 else 1.0 - qs) * (qt if d == 0 else 1.0 - qt)
                    north, east = (qj if c == 0 else qjj) - j, (qi if d == 0 else qii) - i
                    if north == 0 and east == 0:
                        coarse[0, j, i] += value if itself else 2.0 * value
                    elif itself and (north < 0 or (north == 0 and east < 0)):
                        continue
                    elif north == 0:
                        coarse[1, j, min(i, i + east)] += value
                    elif east == 0:
                        coarse[2, min(j, j + north), i] += value
                    elif north == east:
                        coarse[3, min(j, j + north), min(i, i + east)] += value
                    else:
                        coarse[4, min(j, j + north), max(i, i + east)] += value


@njit(cache=True)
def coarsen_stencil(own: FloatArray, stencil: FloatArray, coarse: FloatArray) -> None:
    """Set a coarse data stencil (5, h, w) to the one that the same points would have made there."""
    rows, columns = own.shape
    coarse[:] = 0.0
    for j in range(rows):
        for i in range(columns):
            if own[j, i] == 0.0:
                continue
            _add_coupling(own[j, i], (j, i), (j, i), coarse)
            if stencil.shape[0] == 1:
                continue
            if stencil[1, j, i] != 0.0:
                _add_coupling(stencil[1, j, i], (j, i), (j, i + 1), coarse)
            if stencil[2, j, i] != 0.0:
                _add_coupling(stencil[2, j, i], (j, i), (j + 1, i), coarse)
            if stencil[3, j, i] != 0.0:
                _add_coupling(stencil[3, j, i], (j, i), (j + 1, i + 1), coarse)
            if stencil[4, j, i] != 0.0:
                _add_coupling(stencil[4, j, i], (j, i), (j + 1, i - 1), coarse)


@njit(cache=True)
def add_prolonged(coarse: FloatArray, fine: FloatArray) -> None:
    """Add a coarse grid, interpolated bilinearly, to a fine one; every second fine node is a coarse one."""
    rows, columns = fine.shape
    for j in range(rows):
        a, b = coarse[j // 2], coarse[(j + 1) // 2]
        for i in range(0, columns, 2):
            fine[j, i] += 0.5 * (a[i // 2] + b[i // 2])
        for i in range(1, columns, 2):
            fine[j, i] += 0.25 * (a[i // 2] + a[i // 2 + 1] + b[i // 2] + b[i // 2 + 1])


# Assignments of slices, array expressions and `np.where` take several seconds to compile, loops a tenth of one.
@njit(cache=True)
def copy(source: FloatArray, target: FloatArray) -> None:
    """Set one grid to another of its shape."""
    for j in range(source.shape[0]):
        for i in range(source.shape[1]):
            target[j, i] = source[j, i]


@njit(cache=True)
def subtract(part: FloatArray, target: FloatArray) -> None:
    """Subtract a grid from another of its shape, in place."""
    for j in range(part.shape[0]):
        for i in range(part.shape[1]):
            target[j, i] -= part[j, i]


@njit(cache=True)
def dot(a: FloatArray, b: FloatArray) -> float:
    """Return the sum of products, added in one order whatever the machine's threads do."""
    total = 0.0
    for j in range(a.shape[0]):
        row = 0.0
        for i in range(a.shape[1]):
            row += a[j, i] * b[j, i]
        total += row
    return total


@njit(cache=True)
def coarsened_factors(soft: FloatArray) -> FloatArray:
    """Return the factors on the curvatures for the next coarser grid: the mean of those near a coarse node."""
    n, rows, columns = soft.shape
    coarse = np.ones((n, rows // 2 + 1, columns // 2 + 1))
    for k in range(n):
        for j in range(coarse.shape[1]):
            for i in range(coarse.shape[2]):
                total, count = 0.0, 0
                for y in range(max(2 * j - 1, 0), min(2 * j + 2, rows)):
                    for x in range(max(2 * i - 1, 0), min(2 * i + 2, columns)):
                        total += soft[k, y, x]
                        count += 1
                if count:
                    coarse[k, j, i] = total / count
    return coarse


@njit(cache=True)
def dense(stencil: FloatArray, weights: Weights, soft: FloatArray) -> FloatArray:
    """Return the operator of a small lattice as a dense matrix."""
    rows, columns = stencil.shape[1:]
    matrix = np.zeros((rows * columns, rows * columns))
    unit, out = np.zeros((rows, columns)), np.zeros((rows, columns))
    for k in range(rows * columns):
        unit[k // columns, k % columns] = 1.0
        apply(stencil, weights, soft, unit, out)
        for node in range(rows * columns):
            matrix[k, node] = out[node // columns, node % columns]
        unit[k // columns, k % columns] = 0.0
    return matrix


@njit(cache=True)
def cholesky(matrix: FloatArray) -> FloatArray:
    """Return the lower triangle L of ``L Lᵀ``; what nothing holds (a free plate) is held by a hair."""
    n = len(matrix)
    factor = np.zeros_like(matrix)
    for j in range(n):
        rest = matrix[j, j]
        for k in range(j):
            rest -= factor[j, k] ** 2
        factor[j, j] = np.sqrt(max(rest, 1e-10 * matrix[j, j] + 1e-300))
        for i in range(j + 1, n):
            rest = matrix[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            factor[i, j] = rest / factor[j, j]
    return factor


@njit(cache=True)
def solve_triangles(factor: FloatArray, rhs: FloatArray) -> FloatArray:
    """Return ``(L Lᵀ)⁻¹`` times a grid."""
    n = len(factor)
    x = rhs.copy().ravel()
    for j in range(n):
        for k in range(j):
            x[j] -= factor[j, k] * x[k]
        x[j] /= factor[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            x[j] -= factor[k, j] * x[k]
        x[j] /= factor[j, j]
    return x.reshape(rhs.shape)
