"""The V-cycle and the conjugate gradients, compiled.

Each level has every second node of the one before, and the data that the same points would
have left there. Levels lie one behind the other in flat arrays.
"""

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice.multigrid.coarsening import (
    add_prolonged,
    copy,
    dot,
    restrict,
    solve_triangles,
    subtract,
)
from survey.reconstruction.lattice.multigrid.levels import (
    Hierarchy,
    Operator,
    Rooms,
    clear,
    coarser_weights,
    level_factors,
    level_grid,
    level_stencil,
    rooms,
)
from survey.reconstruction.lattice.multigrid.stencil import apply

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
    k: int, levels: Hierarchy, room: Rooms
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return right-hand side, solution, work space and inverse diagonal bound of one level."""
    shapes = levels.shapes
    return (
        level_grid(room[0], shapes, k),
        level_grid(room[1], shapes, k),
        level_grid(room[2], shapes, k),
        level_grid(levels.inverse_bound, shapes, k),
    )


@njit(cache=True)
def _descend(k: int, operator: Operator, levels: Hierarchy, room: Rooms) -> None:
    """Smooth one level from zero, and restrict its residual to the next coarser one."""
    rhs, z, work, inverse = _arrays_at(k, levels, room)
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
    restrict(work, level_grid(room[0], levels.shapes, k + 1))


@njit(cache=True)
def _ascend(k: int, operator: Operator, levels: Hierarchy, room: Rooms) -> None:
    """Add the coarser level's correction, and smooth in reverse order."""
    rhs, z, work, inverse = _arrays_at(k, levels, room)
    add_prolonged(level_grid(room[1], levels.shapes, k + 1), z)
    if k == 0:
        clear(z, levels.rim)
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[1], inverse, rhs, work, z)
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[0], inverse, rhs, work, z)


@njit(cache=True)
def cycle(
    operator: Operator, levels: Hierarchy, residual: FloatArray, result: FloatArray, room: Rooms
) -> None:
    """Set `result` to one V-cycle: down to the coarsest level, solved exactly, and up again."""
    shapes = levels.shapes
    last = len(shapes) - 1
    copy(residual, level_grid(room[0], shapes, 0))
    for k in range(last):
        _descend(k, operator, levels, room)
    coarsest = solve_triangles(levels.coarsest, level_grid(room[0], shapes, last))
    copy(coarsest, level_grid(room[1], shapes, last))
    for k in range(last - 1, -1, -1):
        _ascend(k, operator, levels, room)
    copy(level_grid(room[1], shapes, 0), result)
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
    room = rooms(levels.shapes)
    z, work, correction = start.copy(), np.empty_like(rhs), np.empty_like(rhs)
    apply(operator.stencil, operator.weights, operator.soft, z, work)
    residual = rhs.copy()
    subtract(work, residual)
    clear(residual, levels.rim)
    cycle(operator, levels, residual, correction, room)
    direction = correction.copy()
    squared = dot(residual, correction)
    n_iterations = 0
    while squared > tolerance**2 and n_iterations < max_iterations:
        apply(operator.stencil, operator.weights, operator.soft, direction, work)
        clear(work, levels.rim)
        _advance(squared / dot(direction, work), direction, work, z, residual)
        cycle(operator, levels, residual, correction, room)
        before, squared = squared, dot(residual, correction)
        for j in range(direction.shape[0]):
            for i in range(direction.shape[1]):
                direction[j, i] = correction[j, i] + squared / before * direction[j, i]
        n_iterations += 1
    return z, n_iterations
