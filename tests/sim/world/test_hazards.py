"""Hazards carved into level ground."""

import numpy as np
import pytest
import shapely
from affine import Affine

from sim.world.hazards import (
    Ground,
    bridged_crevasse,
    carve_hazards,
    crevasse,
    dirt_cone,
    melt_channel,
    melt_pool,
    place_hazard,
)

STEP_M = 0.25


def ground(slope: float = 0.0) -> Ground:
    shape = 241, 241
    x = np.tile(np.arange(shape[1]) * STEP_M, (shape[0], 1))
    grids = [(-slope * x).astype(np.float32), *(np.full(shape, v, np.float32) for v in (1.0, 0.0, 1.0))]
    return Ground(*grids, STEP_M)


def changed(site: Ground) -> np.ndarray:
    """Nodes (N, 2) whose height is not 0 [m]."""
    rows, columns = np.nonzero(site.height)
    return np.column_stack([columns, rows]) * STEP_M


def test_a_crevasse_is_as_deep_as_asked_and_within_its_outline(rng: np.random.Generator) -> None:
    site = ground()
    hazard = crevasse(site, rng, 4.0)
    assert site.height.min() == pytest.approx(-4.0)
    # Walls are one cell wide.
    reach = hazard.outline.buffer(1.5 * STEP_M)
    assert shapely.contains_xy(reach, *changed(site).T).all()
    assert site.openness.min() == pytest.approx(0.1)


def test_a_snow_bridge_sags_by_5_to_20_cm(rng: np.random.Generator) -> None:
    site = ground()
    assert bridged_crevasse(site, rng).kind == "bridged crevasse"
    assert 0.02 < -site.height.min() <= 0.20


def test_a_channel_runs_downhill_with_water_on_its_bed(rng: np.random.Generator) -> None:
    site = ground(0.05)
    hazard = melt_channel(site, rng)
    xmin, ymin, xmax, ymax = hazard.outline.bounds
    assert xmax - xmin > ymax - ymin  # the ground falls to the east
    assert site.water.max() == pytest.approx(1.0, abs=0.1)


def test_a_pool_is_level_and_steep_ground_holds_none(rng: np.random.Generator) -> None:
    site = ground()
    hazard = melt_pool(site, rng)
    inside = shapely.contains_xy(
        hazard.outline.buffer(-STEP_M), *np.moveaxis(site.nodes(np.s_[0:241, 0:241]), -1, 0)
    )
    assert np.ptp(site.height[inside]) < 1e-6
    assert melt_pool(ground(1.0), rng) is None


def test_a_cone_is_30_cm_to_1_m_high(rng: np.random.Generator) -> None:
    site = ground()
    dirt_cone(site, rng)
    assert 0.2 < site.height.max() <= 1.0
    assert site.tone.min() < 0.6


def test_a_tiny_site_gets_no_hazards(rng: np.random.Generator) -> None:
    tiny = Ground(*(np.zeros((9, 9), np.float32) for _ in range(4)), STEP_M)
    assert carve_hazards(tiny, 3, lambda: dirt_cone(tiny, rng)) == []


def test_outlines_are_placed_in_the_world(rng: np.random.Generator) -> None:
    hazard = dirt_cone(ground(), rng)
    transform = Affine(STEP_M, 0.0, 1000.0, 0.0, -STEP_M, 2000.0)
    east, north = place_hazard(hazard, transform).outline.centroid.coords[0]
    x, y = hazard.outline.centroid.coords[0]
    assert (east, north) == pytest.approx((1000.0 + 0.5 * STEP_M + x, 2000.0 - 0.5 * STEP_M - y))
