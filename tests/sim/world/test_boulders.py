"""Blocks of stone: a power law of sizes, heights and tones where they lie."""

import numpy as np
import pytest
import shapely

from sim.world.appearance import snow_on_rough_ground
from sim.world.boulders import draw_blocks, lay_blocks, number_above
from sim.world.hazards import scatter_boulders
from tests.sim.world.test_hazards import STEP_M, changed, ground


def flat(n: int = 64) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((n, n), np.float32), np.ones((n, n), np.float32)


def test_sizes_follow_the_power_law(rng: np.random.Generator) -> None:
    sizes = draw_blocks(rng, 40_000, (0.5, 50.0), np.ones(2), 0.3).size_m
    assert number_above(0.5, 10.0) == pytest.approx(10.0 * 2.0**2.5)
    for factor in (2.0, 4.0):
        assert (sizes > 0.5 * factor).mean() == pytest.approx(factor**-2.5, rel=0.1)


def test_a_block_at_the_corner_of_a_tile_goes_on_at_the_others(rng: np.random.Generator) -> None:
    blocks = draw_blocks(rng, 1, (0.4, 0.4), np.zeros(2), 0.3)
    tile, tone = flat()
    lay_blocks(tile, tone, 0.01, blocks, periodic=True)
    assert (tile[np.ix_([0, -1], [0, -1])] > 0.0).all()
    assert (tone[tile > 0.0] == np.float32(blocks.tone[0])).all()
    cut, _ = flat()
    lay_blocks(cut, tone, 0.01, blocks, periodic=False)
    assert cut[0, 0] > 0.0
    assert not cut[-1].any()


def test_boulders_stand_inside_their_outlines(rng: np.random.Generator) -> None:
    site = ground()
    hazards = scatter_boulders(site, rng, above_1_m=3.0)
    assert {hazard.kind for hazard in hazards} == {"boulder"}
    reach = shapely.union_all([hazard.outline for hazard in hazards]).buffer(2.0 * STEP_M)
    assert shapely.contains_xy(reach, *changed(site).T).all()
    assert 0.2 < site.height.max() < 4.0
    assert site.tone.min() < 1.0


def test_snow_patches_cover_their_share_but_no_steep_sides() -> None:
    level = np.zeros((400, 400), np.float32)
    assert snow_on_rough_ground(level, 0.25, 0.3, 1).mean() == pytest.approx(0.3, abs=0.03)
    assert not snow_on_rough_ground(level, 0.25, 0.0, 1).any()
    steep = np.tile(0.25 * 1.5 * np.arange(400, dtype=np.float32), (400, 1))
    assert not snow_on_rough_ground(steep, 0.25, 0.3, 1).any()
