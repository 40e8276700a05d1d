"""Steps between the grids of multigrid, against dense linear algebra."""

import numpy as np

from survey.reconstruction.lattice.multigrid import (
    add_prolonged,
    cholesky,
    coarsen_stencil,
    coarsened_factors,
    dense,
    restrict,
    solve_triangles,
)

FINE, COARSE = (9, 7), (5, 4)
NO_FACTORS = np.zeros((0, 0, 0))
DATA_ALONE = (0.0, 0.0, 0.0)


def prolongation() -> np.ndarray:
    """Return the interpolation of a coarse grid as a matrix."""
    columns = []
    for unit in np.eye(COARSE[0] * COARSE[1]).reshape(-1, *COARSE):
        fine = np.zeros(FINE)
        add_prolonged(unit, fine)
        columns.append(fine.ravel())
    return np.column_stack(columns)


def stencil_of_points(rng: np.random.Generator) -> np.ndarray:
    """Return a data stencil whose couplings stay within the lattice."""
    stencil = rng.uniform(0.1, 1.0, (5, *FINE))
    stencil[1, :, -1] = stencil[2, -1] = 0.0
    stencil[3, -1] = stencil[3, :, -1] = stencil[4, -1] = stencil[4, :, 0] = 0.0
    return stencil


def test_a_plane_is_interpolated_exactly() -> None:
    north, east = np.mgrid[: COARSE[0], : COARSE[1]]
    fine = np.zeros(FINE)
    add_prolonged(2.0 * north - 3.0 * east, fine)
    rows, columns = np.mgrid[: FINE[0], : FINE[1]]
    np.testing.assert_allclose(fine, rows - 1.5 * columns, atol=1e-14)


def test_restriction_is_the_transpose_of_interpolation(rng: np.random.Generator) -> None:
    fine, coarse = rng.standard_normal(FINE), np.empty(COARSE)
    restrict(fine, coarse)
    np.testing.assert_allclose(coarse.ravel(), prolongation().T @ fine.ravel(), atol=1e-14)


def test_coarse_data_are_those_of_the_fine_ones_seen_through_interpolation(rng: np.random.Generator) -> None:
    stencil, coarse = stencil_of_points(rng), np.empty((5, *COARSE))
    coarsen_stencil(stencil[0], stencil, coarse)
    between = prolongation()
    expected = between.T @ dense(stencil, DATA_ALONE, NO_FACTORS) @ between
    np.testing.assert_allclose(dense(coarse, DATA_ALONE, NO_FACTORS), expected, atol=1e-12)


def test_equal_factors_stay_equal() -> None:
    np.testing.assert_allclose(coarsened_factors(np.full((3, *FINE), 0.7)), 0.7)


def test_the_coarsest_grid_is_solved_exactly(rng: np.random.Generator) -> None:
    root = rng.standard_normal((20, 20))
    matrix, rhs = root @ root.T + np.eye(20), rng.standard_normal((5, 4))
    factor = cholesky(matrix)
    np.testing.assert_allclose(factor @ factor.T, matrix, atol=1e-12)
    np.testing.assert_allclose(
        solve_triangles(factor, rhs).ravel(), np.linalg.solve(matrix, rhs.ravel()), atol=1e-12
    )
