"""Variance of the fine relief within cells."""

import numpy as np
import pytest

from survey.reconstruction.lattice.field_posterior import Stiffness
from survey.reconstruction.tiled.fine_relief import (
    CellPoints,
    fine_relief,
    mean_square_over_cells,
    variance_within_cells,
)
from survey.reconstruction.tiled.layout import CellWindow

WINDOW = CellWindow(1000, 2000, 40, 40)


def points_in_all_cells(sigma_m: float) -> CellPoints:
    """Return a point at a random place of every cell."""
    rng = np.random.default_rng(3)
    row, column = (index.ravel() for index in np.indices(WINDOW.shape))
    uv = np.column_stack([column, row]) + rng.uniform(-0.5, 0.5, (row.size, 2))
    inside = np.clip(uv, 0.0, 39.0)
    weight = np.full(row.size, sigma_m**-2)
    return CellPoints(
        inside, 0.0 * weight, weight, np.ones(row.size, np.int64), row + WINDOW.south, column + WINDOW.west
    )


def test_the_mean_square_over_cells_is_that_of_bilinear_values() -> None:
    assert mean_square_over_cells(np.full((5, 6), 3.0)) == pytest.approx(9.0)
    signs = (-1.0) ** np.add.outer(np.arange(6), np.arange(7))
    assert mean_square_over_cells(signs)[1:-1, 1:-1] == pytest.approx(1.0 / 9.0)


def test_heights_are_better_known_in_cells_than_at_their_middles() -> None:
    stiff, soft = Stiffness(1e5, 60.0), Stiffness(10.0, 30.0)
    points = points_in_all_cells(0.02)
    shares = [variance_within_cells(points, WINDOW, 1.0, one, 4) for one in (stiff, soft)]
    assert 0.2 < shares[1] < shares[0] < 1.0


def test_shares_of_strips_add_up_to_one_where_points_lie() -> None:
    fine = fine_relief(points_in_all_cells(0.02), WINDOW, 1.0, Stiffness(100.0, 30.0), 4)
    assert np.abs(fine.long_share()[5:-5, 5:-5]).max() < 0.02
    assert (fine.away[1:-1, 1:-1] == 0.0).all()
