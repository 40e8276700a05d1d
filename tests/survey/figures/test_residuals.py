"""Figures of residuals at checkpoints."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PathCollection

from survey import Dem, Grid
from survey.core.errors import InputError
from survey.figures.errors import residual_histogram, residual_map
from survey.scoring import Checkpoints, ErrorStatistics, compare

GRID = Grid((0.0, 0.0, 300.0, 200.0), 10.0, "EPSG:32608")
TERRAIN = Dem.on(GRID, np.add.outer(0.05 * GRID.y, 0.1 * GRID.x))


def compared(n):
    rng = np.random.default_rng(4)
    xy = rng.uniform([10.0, 10.0], [290.0, 190.0], (n, 2))
    xyz = np.column_stack([xy, TERRAIN.at(xy) - rng.normal(0.0, 0.1, n)])
    return compare(
        TERRAIN, Checkpoints(xyz, np.full(n, 0.02), names=tuple(f"P{k}" for k in range(n)), crs=GRID.crs)
    )


def test_colours_of_residuals_are_symmetric_and_hold_the_largest():
    errors = compared(12)
    drawn = residual_map(errors, TERRAIN).axes[0].collections
    above, below = (c for c in drawn if isinstance(c, PathCollection) and c.get_array() is not None)
    shown = np.r_[above.get_array(), below.get_array()]
    assert np.allclose(np.sort(shown), np.sort(errors.errors_m))
    assert (above.get_array().min() >= 0.0, below.get_array().max() < 0.0) == (True, True)
    for points in (above, below):
        assert points.norm.vmax == -points.norm.vmin == np.abs(errors.errors_m).max()


@pytest.mark.parametrize(("n", "named"), [(12, 12), (60, 0)])
def test_few_points_are_named(n, named):
    texts = [text.get_text() for text in residual_map(compared(n), TERRAIN).axes[0].texts]
    assert sum(text.startswith("P") for text in texts) == named


def test_the_histogram_counts_every_residual():
    errors = np.random.default_rng(5).normal(0.0, 0.1, 80)
    axes = residual_histogram(errors, ErrorStatistics.of(errors)).axes[0]
    assert sum(bar.get_height() for bar in axes.patches) == pytest.approx(80)


def test_errors_without_places_are_refused():
    with pytest.raises(InputError, match="no places"):
        residual_map(replace(compared(5), xyz=None), TERRAIN)


def test_points_in_a_small_part_of_the_map_are_shown_large():
    errors = compared(12)
    corner = replace(errors, xyz=errors.xyz * [0.2, 0.2, 1.0])
    assert residual_map(errors, TERRAIN).axes[0].get_xlim()[1] >= 300.0
    assert residual_map(corner, TERRAIN).axes[0].get_xlim()[1] < 200.0
