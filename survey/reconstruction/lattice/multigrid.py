"""Geometric multigrid on a lattice: V-cycle and preconditioned conjugate gradients, compiled.

Restriction, prolongation and the data's stencil on the coarser grid come first, with the Cholesky factor of the coarsest.
`Operator` is the linear system and `Hierarchy` its grids: each level has every second node of the one before, and the data
that the same points would have left there. Levels lie one behind the other in flat arrays. `cycle` is one V-cycle with
Chebyshev smoothing, and `conjugate_gradients` takes it as preconditioner.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core import FloatArray, IntArray
from survey.reconstruction.lattice.stencil import Weights, apply, lumped, prior_diagonal


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


_N_COARSEST = 64
# Largest eigenvalue of a plate or membrane beside its diagonal: 64 / 20, and 4 with factors on the curvatures.
_SPECTRUM, _SPECTRUM_OF_FACTORS = 3.2, 4.0
_RIM_WEIGHT = 1e3

RimCounts = tuple[int, int, int, int]


class Operator(NamedTuple):
    """The matrix A of a lattice's energy.

    `stencil` (5, H, W) or (1, H, W): what the data hold [1/m²]: couplings of nine neighbours, or of single
    nodes. `weights`: of thin plate, springs between neighbours, and height itself [1/m²]. `soft` (3, H, W):
    factors on the curvatures east, north and twist; empty when all are 1.
    """

    stencil: FloatArray
    weights: Weights
    soft: FloatArray = np.zeros((0, 0, 0))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the lattice."""
        _, rows, columns = self.stencil.shape
        return rows, columns

    def apply(self, z: FloatArray) -> FloatArray:
        """Return A z."""
        result = np.empty_like(z)
        apply(self.stencil, self.weights, self.soft, z, result)
        return result

    def dense(self) -> FloatArray:
        """Return A as a dense matrix (H W, H W)."""
        return dense(self.stencil, self.weights, self.soft)


class Hierarchy(NamedTuple):
    """All levels: their shapes, data, factors and smoothers, the coarsest one's Cholesky factor, and the rim."""

    shapes: IntArray
    data: FloatArray
    soft: FloatArray
    inverse_bound: FloatArray
    coarsest: FloatArray
    rim: RimCounts


Workspace = tuple[FloatArray, FloatArray, FloatArray]
"""Right-hand sides, heights and residuals of all levels: where a V-cycle writes."""


def level_shapes(rows: int, columns: int) -> IntArray:
    """Return rows and columns of every level (L, 2), the finest first."""
    shapes = [(rows, columns)]
    while rows * columns > _N_COARSEST:
        rows, columns = rows // 2 + 1, columns // 2 + 1
        shapes.append((rows, columns))
    return np.array(shapes, dtype=np.int64)


def hierarchy(operator: Operator, rim: RimCounts) -> Hierarchy:
    """Return all levels of an operator."""
    shapes = level_shapes(*operator.shape)
    return Hierarchy(shapes, *_built(operator, shapes, rim), rim)


@njit(cache=True)
def workspace(shapes: IntArray) -> Workspace:
    """Return the workspace of one V-cycle."""
    n = 0
    for k in range(len(shapes)):
        n += shapes[k, 0] * shapes[k, 1]
    return np.empty(n), np.empty(n), np.empty(n)


@njit(cache=True, inline="always")
def level_grid(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return one level of a flat array."""
    start = 0
    for m in range(k):
        start += shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + rows * columns].reshape((rows, columns))


@njit(cache=True, inline="always")
def level_stencil(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return the data stencil of one level but the finest."""
    start = 0
    for m in range(1, k):
        start += 5 * shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + 5 * rows * columns].reshape((5, rows, columns))


@njit(cache=True, inline="always")
def level_factors(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return one level of the factors on the curvatures, or none."""
    if len(flat) == 0:
        return np.zeros((0, 0, 0))
    start = 0
    for m in range(k):
        start += 3 * shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + 3 * rows * columns].reshape((3, rows, columns))


@njit(cache=True, inline="always")
def coarser_weights(weights: Weights, k: int) -> Weights:
    """Return the weights on a lattice with 2ᵏ times the step."""
    quarter = 0.25**k
    return weights[0] * quarter, weights[1], weights[2] / quarter


@njit(cache=True)
def clear(array: FloatArray, rim: RimCounts) -> None:
    """Set the rim of an array (H, W) to 0."""
    rows, columns = array.shape
    array[: rim[0]] = 0.0
    array[rows - rim[1] :] = 0.0
    array[:, : rim[2]] = 0.0
    array[:, columns - rim[3] :] = 0.0


@njit(cache=True)
def _hold_rim(rim: RimCounts, held: FloatArray, bound: FloatArray) -> None:
    """Give the nodes of a rim a great weight, and no step of the smoother."""
    free, weight = np.ones(bound.shape), _RIM_WEIGHT * bound.max()
    clear(free, rim)
    for j in range(bound.shape[0]):
        for i in range(bound.shape[1]):
            held[j, i] += weight * (1.0 - free[j, i])
            if free[j, i] <= 0.0:
                bound[j, i] = np.inf


@njit(cache=True)
def _built(
    operator: Operator, shapes: IntArray, rim: RimCounts
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return data, factors, smoother and coarsest factor of all levels; a rim that is held gets a great weight."""
    stencil, weights, soft = operator
    n, last = 0, len(shapes) - 1
    for k in range(len(shapes)):
        n += shapes[k, 0] * shapes[k, 1]
    inverse_bound = np.empty(n)
    data = np.empty(5 * (n - shapes[0, 0] * shapes[0, 1]))
    factors = np.empty(3 * n if soft.shape[0] else 0)
    spectrum = _SPECTRUM_OF_FACTORS if soft.shape[0] else _SPECTRUM
    here, held = soft, stencil[0].copy()
    for k in range(len(shapes)):
        if k == 1:
            coarsen_stencil(held, stencil, level_stencil(data, shapes, 1))
        elif k > 1:
            finer = level_stencil(data, shapes, k - 1)
            coarsen_stencil(finer[0], finer, level_stencil(data, shapes, k))
        if soft.shape[0]:
            here = soft if k == 0 else coarsened_factors(here)
            for layer in range(3):
                copy(here[layer], level_factors(factors, shapes, k)[layer])
        own = lumped(stencil) if k == 0 else lumped(level_stencil(data, shapes, k))
        shape = (shapes[k, 0], shapes[k, 1])
        prior = prior_diagonal(coarser_weights(weights, k), here, shape)
        inverse = level_grid(inverse_bound, shapes, k)
        for j in range(shape[0]):
            for i in range(shape[1]):
                own[j, i] += spectrum * prior[j, i]
        if k == 0 and rim[0] + rim[1] + rim[2] + rim[3] > 0:
            _hold_rim(rim, held, own)
        for j in range(shape[0]):
            for i in range(shape[1]):
                inverse[j, i] = np.divide(1.0, own[j, i])
    deepest = stencil if last == 0 else level_stencil(data, shapes, last)
    matrix = dense(deepest, coarser_weights(weights, last), level_factors(factors, shapes, last))
    return data, factors, inverse_bound, cholesky(matrix)


# The smoother damps the upper part of the spectrum, which coarser grids cannot hold, by Chebyshev's steps.
_SMOOTHED_FROM = 1.0 / 20.0
_STEPS = tuple(
    1.0 / (0.5 * (1.0 + _SMOOTHED_FROM) + 0.5 * (1.0 - _SMOOTHED_FROM) * np.cos(angle))
    for angle in (np.pi / 4.0, 3.0 * np.pi / 4.0)
)


@njit(cache=True, inline="always")
def _relax(step: float, inverse: FloatArray, rhs: FloatArray, applied: FloatArray, z: FloatArray) -> None:
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            z[j, i] += step * inverse[j, i] * (rhs[j, i] - applied[j, i])


@njit(cache=True)
def _apply_at(k: int, operator: Operator, levels: Hierarchy, z: FloatArray, out: FloatArray) -> None:
    """Apply the operator of one level."""
    if k == 0:
        apply(operator.stencil, operator.weights, operator.soft, z, out)
    else:
        data = level_stencil(levels.data, levels.shapes, k)
        soft = level_factors(levels.soft, levels.shapes, k)
        apply(data, coarser_weights(operator.weights, k), soft, z, out)


@njit(cache=True)
def _arrays_at(
    k: int, levels: Hierarchy, work_arrays: Workspace
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return right-hand side, solution, work space and inverse diagonal bound of one level."""
    shapes = levels.shapes
    return (
        level_grid(work_arrays[0], shapes, k),
        level_grid(work_arrays[1], shapes, k),
        level_grid(work_arrays[2], shapes, k),
        level_grid(levels.inverse_bound, shapes, k),
    )


@njit(cache=True)
def _descend(k: int, operator: Operator, levels: Hierarchy, work_arrays: Workspace) -> None:
    """Smooth one level from zero, and restrict its residual to the next coarser one."""
    rhs, z, work, inverse = _arrays_at(k, levels, work_arrays)
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            z[j, i] = _STEPS[0] * inverse[j, i] * rhs[j, i]
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[1], inverse, rhs, work, z)
    _apply_at(k, operator, levels, z, work)
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            work[j, i] = rhs[j, i] - work[j, i]
    if k == 0:
        clear(work, levels.rim)
    restrict(work, level_grid(work_arrays[0], levels.shapes, k + 1))


@njit(cache=True)
def _ascend(k: int, operator: Operator, levels: Hierarchy, work_arrays: Workspace) -> None:
    """Add the coarser level's correction, and smooth in reverse order."""
    rhs, z, work, inverse = _arrays_at(k, levels, work_arrays)
    add_prolonged(level_grid(work_arrays[1], levels.shapes, k + 1), z)
    if k == 0:
        clear(z, levels.rim)
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[1], inverse, rhs, work, z)
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[0], inverse, rhs, work, z)


@njit(cache=True)
def cycle(
    operator: Operator, levels: Hierarchy, residual: FloatArray, result: FloatArray, work_arrays: Workspace
) -> None:
    """Set `result` to one V-cycle: down to the coarsest level, solved exactly, and up again."""
    shapes = levels.shapes
    last = len(shapes) - 1
    copy(residual, level_grid(work_arrays[0], shapes, 0))
    for k in range(last):
        _descend(k, operator, levels, work_arrays)
    coarsest = solve_triangles(levels.coarsest, level_grid(work_arrays[0], shapes, last))
    copy(coarsest, level_grid(work_arrays[1], shapes, last))
    for k in range(last - 1, -1, -1):
        _ascend(k, operator, levels, work_arrays)
    copy(level_grid(work_arrays[1], shapes, 0), result)
    clear(result, levels.rim)


@njit(cache=True)
def _advance(
    step: float, direction: FloatArray, applied: FloatArray, z: FloatArray, residual: FloatArray
) -> None:
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            z[j, i] += step * direction[j, i]
            residual[j, i] -= step * applied[j, i]


@njit(cache=True)
def conjugate_gradients(
    operator: Operator, levels: Hierarchy, rhs: FloatArray, start: FloatArray, until: tuple[float, int]
) -> tuple[FloatArray, int]:
    """Return the solution and the number of iterations; `until` are tolerance and most iterations."""
    tolerance, max_iterations = until
    work_arrays = workspace(levels.shapes)
    z, work, correction = start.copy(), np.empty_like(rhs), np.empty_like(rhs)
    apply(operator.stencil, operator.weights, operator.soft, z, work)
    residual = rhs.copy()
    subtract(work, residual)
    clear(residual, levels.rim)
    cycle(operator, levels, residual, correction, work_arrays)
    direction = correction.copy()
    squared = dot(residual, correction)
    n_iterations = 0
    while squared > tolerance**2 and n_iterations < max_iterations:
        apply(operator.stencil, operator.weights, operator.soft, direction, work)
        clear(work, levels.rim)
        _advance(squared / dot(direction, work), direction, work, z, residual)
        cycle(operator, levels, residual, correction, work_arrays)
        before, squared = squared, dot(residual, correction)
        for j in range(direction.shape[0]):
            for i in range(direction.shape[1]):
                direction[j, i] = correction[j, i] + squared / before * direction[j, i]
        n_iterations += 1
    return z, n_iterations
