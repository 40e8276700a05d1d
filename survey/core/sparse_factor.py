"""Sparse factorization of symmetric positive definite matrices, solved with in blocks of right-hand sides."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from survey.core.arrays import FloatArray

# Right-hand sides that are solved for at once: SuperLU takes two more arrays of their size, and slows down with many.
_AT_ONCE = 64


@dataclass(frozen=True)
class SparseFactor:
    """Factorization of a symmetric positive definite matrix (S, S), to solve with.

    Parameters
    ----------
    factor : scipy.sparse.linalg.SuperLU
        Of the matrix.

    Examples
    --------
    >>> factor = SparseFactor.of(sparse.diags_array([2.0, 4.0]))
    >>> factor.solve(np.array([1.0, 1.0]))
    array([0.5 , 0.25])
    """

    factor: Any

    @classmethod
    def of(cls, matrix: Any) -> Self:
        """Factorize a sparse matrix.

        Parameters
        ----------
        matrix : scipy.sparse array
            (S, S), symmetric positive definite.

        Returns
        -------
        SparseFactor
            Solves with `matrix`.
        """
        options = {"SymmetricMode": True}
        return cls(
            splu(
                sparse.csc_matrix(matrix),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options=options,
            )
        )

    def solve(self, sides: FloatArray) -> FloatArray:
        """Return the solutions of one or several right-hand sides.

        Parameters
        ----------
        sides : (S,) or (S, R) ndarray
            Right-hand sides.

        Returns
        -------
        ndarray
            Of the shape of `sides`, in column order.
        """
        if sides.ndim == 1:
            solved: FloatArray = self.factor.solve(sides)
            return solved
        result = np.empty(sides.shape, order="F")
        for first in range(0, sides.shape[1], _AT_ONCE):
            here = slice(first, first + _AT_ONCE)
            result[:, here] = self.factor.solve(np.asfortranarray(sides[:, here]))
        return result
