"""Sparse factorization that is solved with in blocks of right-hand sides."""

import numpy as np
import pytest
from scipy import sparse

from survey.data.path_error import SparseFactor

_SIZE = 90


@pytest.fixture
def matrix() -> sparse.csr_array:
    """A chain of coupled unknowns, as of a path."""
    off = np.full(_SIZE - 1, -1.0)
    return sparse.csr_array(sparse.diags_array([off, np.linspace(2.1, 3.0, _SIZE), off], offsets=[-1, 0, 1]))


@pytest.mark.parametrize("n", [1, 64, 130])
def test_more_sides_than_a_block_are_solved_as_by_a_dense_solver(matrix: sparse.csr_array, n: int) -> None:
    sides = np.random.default_rng(0).normal(size=(_SIZE, n))
    solved = SparseFactor.of(matrix).solve(sides)
    np.testing.assert_allclose(solved, np.linalg.solve(matrix.toarray(), sides), atol=1e-12)
    assert solved.flags.f_contiguous


def test_one_side_has_the_solution_of_a_block_of_one(matrix: sparse.csr_array) -> None:
    side = np.arange(_SIZE, dtype=np.float64)
    factor = SparseFactor.of(matrix)
    np.testing.assert_allclose(factor.solve(side), factor.solve(side[:, None])[:, 0], atol=1e-12)
