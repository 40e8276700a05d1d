"""Density of landmarks on a map."""

import numpy as np
import pytest

from survey import Dem, Grid, SurfacePoints
from survey.figures.maps import landmark_map

GRID = Grid((0.0, 0.0, 300.0, 200.0), 10.0, "EPSG:32608")
TERRAIN = Dem.on(GRID, np.zeros(GRID.shape))


def counts(points):
    """Return the numbers of the coloured squares."""
    (squares,) = (c for c in landmark_map(points, TERRAIN).axes[0].collections if c.get_array() is not None)
    return (
        squares.get_array().filled(0.0) if np.ma.isMaskedArray(squares.get_array()) else squares.get_array()
    )


@pytest.mark.parametrize("n", [1, 400])
def test_every_landmark_inside_is_counted_once(n):
    xyz = np.random.default_rng(2).uniform([0.0, 0.0, 0.0], [300.0, 200.0, 1.0], (n, 3))
    assert np.nansum(counts(SurfacePoints(xyz, sigma_m=0.1, crs=GRID.crs))) == n


def test_landmarks_outside_are_not_counted_but_stand_in_the_title():
    xyz = np.array([[150.0, 100.0, 0.0], [900.0, 100.0, 0.0]])
    points = SurfacePoints(xyz, sigma_m=0.1, crs=GRID.crs)
    assert np.nansum(counts(points)) == 1
    assert landmark_map(points, TERRAIN).axes[0].get_title(loc="left") == "Landmarks (2)"
