"""Small lattices exactly: the operator as a band matrix, its determinant and the diagonal of its inverse."""

from functools import cache

import numpy as np
from numba import njit
from scipy.linalg import cholesky_banded
from threadpoolctl import ThreadpoolController

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.reconstruction.lattice.multigrid.solver import Operator

# Couplings reach two nodes in every direction.
_REACH = 2


def band_of(operator: Operator) -> FloatArray:
    """Return the lower band (bandwidth + 1, n) of the operator, row by row of the lattice.

    The operator is applied to grids of ones five nodes apart, which do not meet.
    """
    rows, columns = operator.shape
    n, spacing = rows * columns, 2 * _REACH + 1
    band = np.zeros((_REACH * columns + 1, n))
    node = np.arange(n).reshape(rows, columns)
    for a in range(spacing):
        for b in range(spacing):
            ones = np.zeros((rows, columns))
            ones[a::spacing, b::spacing] = 1.0
            image = operator.apply(ones)
            for up in range(_REACH + 1):
                for right in range(-_REACH if up else 0, _REACH + 1):
                    if abs(up) + abs(right) > _REACH:
                        continue
                    j, i = np.arange(a, rows - up, spacing), np.arange(b, columns, spacing)
                    i = i[(i + right >= 0) & (i + right < columns)]
                    there = image[np.ix_(j + up, i + right)]
                    band[up * columns + right, node[np.ix_(j, i)]] = there
    return band


@cache
def _blas() -> ThreadpoolController:
    """Return the BLAS of SciPy, found once: the search takes longer than a factor of 1,024 nodes."""
    return ThreadpoolController()


def band_cholesky(band: FloatArray) -> FloatArray:
    """Return the Cholesky factor in the same lower band form; the same bytes whatever the number of threads.

    Raises
    ------
    InputError
        When the data hold the surface nowhere.
    """
    with _blas().limit(limits=1, user_api="blas"):
        try:
            factor: FloatArray = cholesky_banded(band, lower=True, check_finite=False)
        except np.linalg.LinAlgError as error:
            raise InputError(
                f"the surface is not determined by its points ({error}); add points or a finite range."
            ) from error
    return factor


def log_determinant(factor: FloatArray) -> float:
    """Return log det A from its band Cholesky factor."""
    return 2.0 * float(np.log(factor[0]).sum())


@njit(cache=True, fastmath=True)
def inverse_diagonal(factor: FloatArray) -> FloatArray:
    """Return the diagonal of A⁻¹ from the band Cholesky factor of A, by Takahashi's recursion.

    `known` holds A⁻¹ between the latest `width` nodes, each in the place of its number modulo `width`.
    """
    width, n = factor.shape[0] - 1, factor.shape[1]
    known = np.zeros((width, width))
    below, column = np.zeros(width), np.zeros(width)
    diagonal = np.zeros(n)
    for j in range(n - 1, -1, -1):
        for d in range(1, width + 1):
            below[(j + d) % width] = factor[d, j] / factor[0, j] if j + d < n else 0.0
        own = 1.0 / factor[0, j] ** 2
        for a in range(width):
            total = 0.0
            for b in range(width):
                total += known[a, b] * below[b]
            column[a] = -total
        for a in range(width):
            own -= below[a] * column[a]
        here = j % width
        column[here] = own
        for a in range(width):
            known[a, here] = column[a]
            known[here, a] = column[a]
        diagonal[j] = own
    return diagonal


def exact_variance(operator: Operator) -> FloatArray:
    """Return the diagonal of A⁻¹ on the nodes (H, W)."""
    return inverse_diagonal(band_cholesky(band_of(operator))).reshape(operator.shape)
