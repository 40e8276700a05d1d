import numpy as np
import pytest

from survey import Grid, InputError

CRS = "EPSG:32608"


def test_nodes_include_both_ends_and_rows_run_from_north_to_south():
    grid = Grid((0.0, 0.0, 600.0, 600.0), 1.0, CRS)
    assert grid.shape == (601, 601)
    assert (grid.x[0], grid.x[-1], grid.y[0], grid.y[-1]) == (0.0, 600.0, 600.0, 0.0)
    np.testing.assert_array_equal(grid.xy[:2], [[0.0, 600.0], [1.0, 600.0]])
    assert grid.transform @ (0.5, 0.5) == (0.0, 600.0)


@pytest.mark.parametrize(
    ("bounds", "step", "words"),
    [
        ((0.0, 0.0, 0.0, 1.0), 1.0, "enclose nothing"),
        ((0.0, 0.0, 10.0, 10.0), 3.0, "no whole number"),
        ((0.0, 0.0, 10.0, 10.0), 0.0, "greater than 0"),
        ((0.0, 0.0, 10.0, 10.0), -1.0, "greater than 0"),
        ((0.0, 0.0, np.nan, 10.0), 1.0, "NaN"),
        ((0.0, 0.0, 10.0), 1.0, "shape"),
    ],
)
def test_refusals(bounds, step, words):
    with pytest.raises(InputError, match=words):
        Grid(bounds, step, CRS)
