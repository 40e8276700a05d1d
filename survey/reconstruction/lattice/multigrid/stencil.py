"""The energy's operator, compiled: the data's stencil and the prior's, without its matrix.

Arrays are (rows, columns) with the row counting northwards and the column eastwards. The data
stencil holds, for every node, its own weight and the couplings to its neighbours in the
east, north, north-east and north-west; the others follow by symmetry. Sums are not reordered
(no fast math): the same map has the same bytes whatever was compiled before it.
"""

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice.multigrid.plate_prior import (
    Weights,
    prior_at_node,
    prior_of_edge_rows,
    prior_of_inner_row,
    prior_of_row_ends,
)

OWN, EAST, NORTH, NORTH_EAST, NORTH_WEST = range(5)


@njit(cache=True, inline="always")
def _add_data_row(stencil: FloatArray, z: FloatArray, j: int, out: FloatArray) -> None:
    """Add the data's couplings of row j with itself and its neighbours."""
    rows, columns = z.shape
    row, into = z[j], out[j]
    own, east = stencil[0, j], stencil[1, j]
    into[0] += own[0] * row[0] + east[0] * row[1]
    for i in range(1, columns - 1):
        into[i] += own[i] * row[i] + east[i] * row[i + 1] + east[i - 1] * row[i - 1]
    into[columns - 1] += own[columns - 1] * row[columns - 1] + east[columns - 2] * row[columns - 2]
    if j < rows - 1:
        north, up, up_right, up_left = z[j + 1], stencil[2, j], stencil[3, j], stencil[4, j]
        into[0] += up[0] * north[0] + up_right[0] * north[1]
        for i in range(1, columns - 1):
            into[i] += up[i] * north[i] + up_right[i] * north[i + 1] + up_left[i] * north[i - 1]
        into[columns - 1] += up[columns - 1] * north[columns - 1] + up_left[columns - 1] * north[columns - 2]
    if j > 0:
        south, down, down_left, down_right = z[j - 1], stencil[2, j - 1], stencil[3, j - 1], stencil[4, j - 1]
        into[0] += down[0] * south[0] + down_right[1] * south[1]
        for i in range(1, columns - 1):
            into[i] += down[i] * south[i] + down_left[i - 1] * south[i - 1] + down_right[i + 1] * south[i + 1]
        into[columns - 1] += (
            down[columns - 1] * south[columns - 1] + down_left[columns - 2] * south[columns - 2]
        )


@njit(cache=True)
def _add_membrane_row(membrane: float, z: FloatArray, j: int, out: FloatArray) -> None:
    """Add what springs between neighbours pull on row j."""
    rows, columns = z.shape
    row = out[j]
    for i in range(columns - 1):
        row[i] -= membrane * (z[j, i + 1] - z[j, i])
    for i in range(1, columns):
        row[i] += membrane * (z[j, i] - z[j, i - 1])
    if j < rows - 1:
        for i in range(columns):
            row[i] -= membrane * (z[j + 1, i] - z[j, i])
    if j > 0:
        for i in range(columns):
            row[i] += membrane * (z[j, i] - z[j - 1, i])


@njit(cache=True)
def _bend_along(plate: float, soft: FloatArray, z: FloatArray, j: int, into: FloatArray) -> None:
    """Fill into[2:-2] with the moments of the east-west curvature along row j; none at the ends."""
    columns = z.shape[1]
    for i in range(1, columns - 1):
        into[i + 1] = plate * (z[j, i - 1] - 2.0 * z[j, i] + z[j, i + 1])
    if soft.shape[0]:
        for i in range(1, columns - 1):
            into[i + 1] *= soft[0, j, i]


@njit(cache=True)
def _bend_across(plate: float, soft: FloatArray, z: FloatArray, j: int, into: FloatArray) -> None:
    """Fill a row with the moments of the north-south curvature at row j; none on the first and last row."""
    rows, columns = z.shape
    if j < 1 or j > rows - 2:
        for i in range(columns):
            into[i] = 0.0
        return
    for i in range(columns):
        into[i] = plate * (z[j - 1, i] - 2.0 * z[j, i] + z[j + 1, i])
    if soft.shape[0]:
        for i in range(columns):
            into[i] *= soft[1, j, i]


@njit(cache=True)
def _twist(plate: float, soft: FloatArray, z: FloatArray, j: int, into: FloatArray) -> None:
    """Fill into[1:] with the moments of the twist of the cells between rows j and j + 1; none beyond the ends."""
    rows, columns = z.shape
    for i in range(columns + 1):
        into[i] = 0.0
    if j < 0 or j > rows - 2:
        return
    for i in range(columns - 1):
        into[i + 1] = 2.0 * plate * (z[j, i] - z[j, i + 1] - z[j + 1, i] + z[j + 1, i + 1])
    if soft.shape[0]:
        for i in range(columns - 1):
            into[i + 1] *= soft[2, j, i]


@njit(cache=True)
def apply(stencil: FloatArray, weights: Weights, soft: FloatArray, z: FloatArray, out: FloatArray) -> None:
    """Set ``out = (data + plate · thin plate + membrane · springs + mass) z``, boundaries free.

    `stencil` has five layers, or one when the data hang on single nodes; `soft` has three
    layers of factors on the curvatures (east, north, twist), or none.
    """
    rows, columns = z.shape
    if soft.shape[0] or rows < 5 or columns < 5:
        _apply_by_bends(stencil, weights, soft, z, out)
        return
    prior_of_edge_rows(weights, z, out)
    for j in range(rows):
        if 2 <= j < rows - 2:
            prior_of_inner_row(weights, z, j, out)
            prior_of_row_ends(weights, z, j, out)
        else:
            for i in (0, 1, columns - 2, columns - 1):
                out[j, i] = prior_at_node(weights, z, j, i)
        if stencil.shape[0] == 1:
            for i in range(columns):
                out[j, i] += stencil[0, j, i] * z[j, i]
        else:
            _add_data_row(stencil, z, j, out)


@njit(cache=True)
def _apply_by_bends(
    stencil: FloatArray, weights: Weights, soft: FloatArray, z: FloatArray, out: FloatArray
) -> None:
    """Do the same in one sweep over all bends, each with its factor, on a lattice of any size."""
    plate, membrane, mass = weights
    rows, columns = z.shape
    along = np.zeros(columns + 2)
    twist_south, twist_north = np.zeros(columns + 1), np.zeros(columns + 1)
    south, here, north = np.zeros(columns), np.zeros(columns), np.zeros(columns)
    if plate > 0:
        _bend_across(plate, soft, z, 1, north)
    for j in range(rows):
        row = out[j]
        for i in range(columns):
            row[i] = mass * z[j, i]
        if stencil.shape[0] == 1:
            for i in range(columns):
                row[i] += stencil[0, j, i] * z[j, i]
        else:
            _add_data_row(stencil, z, j, out)
        if membrane > 0:
            _add_membrane_row(membrane, z, j, out)
        if plate > 0:
            _bend_along(plate, soft, z, j, along)
            _twist(plate, soft, z, j, twist_north)
            for i in range(columns):
                row[i] += along[i] - 2.0 * along[i + 1] + along[i + 2]
            for i in range(columns):
                row[i] += south[i] - 2.0 * here[i] + north[i]
            for i in range(columns):
                row[i] += twist_north[i + 1] - twist_north[i] - twist_south[i + 1] + twist_south[i]
            south, here, north = here, north, south
            twist_south, twist_north = twist_north, twist_south
            _bend_across(plate, soft, z, j + 2, north)


@njit(cache=True)
def prior_diagonal(weights: Weights, soft: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return the diagonal of the operator without data."""
    plate, membrane, mass = weights
    rows, columns = shape
    diagonal = np.full(shape, mass)
    weighted = soft.shape[0] > 0
    for j in range(rows):
        for i in range(columns):
            neighbours = (i > 0) + (i < columns - 1) + (j > 0) + (j < rows - 1)
            diagonal[j, i] += membrane * neighbours
            if 0 < i < columns - 1:
                w = plate * (soft[0, j, i] if weighted else 1.0)
                diagonal[j, i - 1] += w
                diagonal[j, i] += 4.0 * w
                diagonal[j, i + 1] += w
            if 0 < j < rows - 1:
                w = plate * (soft[1, j, i] if weighted else 1.0)
                diagonal[j - 1, i] += w
                diagonal[j, i] += 4.0 * w
                diagonal[j + 1, i] += w
            if i < columns - 1 and j < rows - 1:
                w = 2.0 * plate * (soft[2, j, i] if weighted else 1.0)
                diagonal[j, i] += w
                diagonal[j, i + 1] += w
                diagonal[j + 1, i] += w
                diagonal[j + 1, i + 1] += w
    return diagonal


@njit(cache=True)
def prior_noise(weights: Weights, soft: FloatArray, normals: FloatArray, out: FloatArray) -> None:
    """Add noise to `out` whose covariance is the operator without data; `normals` is (6, rows, columns)."""
    plate, membrane, mass = weights
    rows, columns = out.shape
    weighted = soft.shape[0] > 0
    root, spring = np.sqrt(plate), np.sqrt(membrane)
    for j in range(rows):
        for i in range(columns):
            out[j, i] += np.sqrt(mass) * normals[0, j, i]
            if i < columns - 1:
                out[j, i] -= spring * normals[1, j, i]
                out[j, i + 1] += spring * normals[1, j, i]
            if j < rows - 1:
                out[j, i] -= spring * normals[2, j, i]
                out[j + 1, i] += spring * normals[2, j, i]
            if 0 < i < columns - 1:
                e = root * normals[3, j, i] * (np.sqrt(soft[0, j, i]) if weighted else 1.0)
                out[j, i - 1] += e
                out[j, i] -= 2.0 * e
                out[j, i + 1] += e
            if 0 < j < rows - 1:
                e = root * normals[4, j, i] * (np.sqrt(soft[1, j, i]) if weighted else 1.0)
                out[j - 1, i] += e
                out[j, i] -= 2.0 * e
                out[j + 1, i] += e
            if i < columns - 1 and j < rows - 1:
                e = np.sqrt(2.0) * root * normals[5, j, i] * (np.sqrt(soft[2, j, i]) if weighted else 1.0)
                out[j, i] += e
                out[j, i + 1] -= e
                out[j + 1, i] -= e
                out[j + 1, i + 1] += e


@njit(cache=True)
def lumped(stencil: FloatArray) -> FloatArray:
    """Return the sum of each node's row of the data stencil (all its couplings are positive)."""
    rows, columns = stencil.shape[1:]
    total: FloatArray = stencil[0].copy()
    if stencil.shape[0] == 1:
        return total
    for j in range(rows):
        for i in range(columns):
            if i < columns - 1:
                total[j, i] += stencil[1, j, i]
                total[j, i + 1] += stencil[1, j, i]
            if j < rows - 1:
                total[j, i] += stencil[2, j, i]
                total[j + 1, i] += stencil[2, j, i]
            if i < columns - 1 and j < rows - 1:
                total[j, i] += stencil[3, j, i]
                total[j + 1, i + 1] += stencil[3, j, i]
            if i > 0 and j < rows - 1:
                total[j, i] += stencil[4, j, i]
                total[j + 1, i - 1] += stencil[4, j, i]
    return total
