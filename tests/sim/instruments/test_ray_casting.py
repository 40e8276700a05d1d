"""Rays meet the bilinear surface at the first place where they reach it."""

import numpy as np
import pytest

from sim.instruments.lidar import HeightRaster
from survey.core.arrays import FloatArray
from survey.data.dem import Dem
from survey.data.grid import Grid

GRID = Grid((0.0, 0.0, 60.0, 60.0), 2.0)


def hills(seed: int = 0) -> Dem:
    return Dem.on(GRID, np.random.default_rng(seed).uniform(0.0, 2.0, GRID.shape))


def rays(n: int, seed: int = 1) -> FloatArray:
    drawn = np.random.default_rng(seed).standard_normal((n, 3)) * [1.0, 1.0, 0.15]
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def test_rays_meet_a_plane_where_geometry_says() -> None:
    plane = Dem.on(GRID, np.zeros(GRID.shape))
    start, down = np.array([[30.0, 30.0, 3.0]]), np.array([[0.6, 0.0, -0.8]])
    hits = HeightRaster.of(plane).hits(start, down, 50.0)
    assert hits.range_m == pytest.approx([3.75])
    assert hits.cosine == pytest.approx([0.8])


def test_every_hit_lies_on_the_surface_and_nothing_stands_before_it() -> None:
    terrain, direction = hills(), rays(400)
    start = np.tile([30.0, 30.0, 3.0], (len(direction), 1))
    reached = HeightRaster.of(terrain).hits(start, direction, 40.0).range_m
    met = np.isfinite(reached)
    assert 0.2 < met.mean() < 1.0
    place = start[met] + reached[met, None] * direction[met]
    assert place[:, 2] == pytest.approx(terrain.at(place[:, :2]), abs=1e-9)
    farthest = np.where(met, reached, 29.0)
    for share in np.linspace(0.02, 0.999, 150):
        on_ray = start + share * farthest[:, None] * direction
        assert (on_ray[:, 2] > terrain.at(on_ray[:, :2]) - 1e-9).all()


def test_rays_that_leave_the_raster_or_meet_unknown_ground_return_nothing() -> None:
    heights = np.zeros(GRID.shape)
    heights[:, 20:] = np.nan
    start = np.tile([10.0, 30.0, 1.0], (3, 1))
    direction = np.array([[1.0, 0.0, -0.02], [-1.0, 0.0, -0.02], [0.0, 0.0, 1.0]])
    assert np.isinf(HeightRaster.of(Dem.on(GRID, heights)).hits(start, direction, 100.0).range_m).all()


def test_rays_straight_down_meet_the_ground_below() -> None:
    terrain = hills()
    start = np.array([[20.0, 20.0, 5.0], [21.3, 18.7, 5.0]])
    hits = HeightRaster.of(terrain).hits(start, np.tile([0.0, 0.0, -1.0], (2, 1)), 10.0)
    assert 5.0 - hits.range_m == pytest.approx(terrain.at(start[:, :2]))
