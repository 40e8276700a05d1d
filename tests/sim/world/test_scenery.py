"""Fine ground: dunes, sastrugi and hazards on a terrain model."""

import numpy as np
import pytest
import shapely

from benchmarks.small_inputs import BARE_SCENERY
from sim.config.world import SceneryConfig
from sim.world.fine_terrain import FineTerrain, band_limited_field, fine_terrain
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid


def site(size_m: float = 60.0) -> Dem:
    grid = Grid((1000.0, 2000.0, 1000.0 + size_m, 2000.0 + size_m), 1.0)
    x, y = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, 100.0 + 0.02 * (x - 1000.0) + 0.5 * np.cos((y - 2000.0) / 8.0))


def fine(**settings: float) -> FineTerrain:
    return fine_terrain(site(), SceneryConfig(**{**BARE_SCENERY, **settings}), seed=3)


def test_without_detail_the_surface_runs_through_the_terrain() -> None:
    ground, terrain = fine(), site()
    # Single precision at 100 m is 8 µm.
    assert ground.elevation(terrain.xy) == pytest.approx(terrain.elevation.ravel(), abs=2e-5)
    assert ground.bounds == (1000.0, 2000.0, 1060.0, 2060.0)


def test_surface_and_dem_agree_between_the_nodes(rng: np.random.Generator) -> None:
    ground = fine(dune_sd_m=0.2, sastrugi_sd_m=0.1)
    xy = rng.uniform((1000.0, 2000.0), (1060.0, 2060.0), (500, 2))
    assert ground.elevation(xy) == pytest.approx(ground.dem.at(xy), abs=1e-9)


def test_normals_are_those_of_the_slope() -> None:
    grid = Grid((0.0, 0.0, 20.0, 20.0), 1.0)
    x, y = np.meshgrid(grid.x, grid.y)
    ground = fine_terrain(Dem.on(grid, 0.3 * x - 0.1 * y), SceneryConfig(**BARE_SCENERY), seed=0)
    expected = np.array([-0.3, 0.1, 1.0]) / np.sqrt(1.1)
    assert ground.normal(np.array([[7.3, 4.1]]))[0] == pytest.approx(expected, abs=1e-5)


def test_places_off_the_map_have_no_height() -> None:
    assert np.isnan(fine().elevation(np.array([[999.9, 2010.0], [1060.1, 2010.0]]))).all()
    assert np.isnan(fine().normal(np.array([[999.9, 2010.0]]))).all()


def test_dunes_lie_along_the_wind() -> None:
    ground = fine(dune_sd_m=0.3, wind_from_deg=270.0)  # from the west: long from west to east
    relief = ground.height - fine().height
    along, across = np.diff(relief, axis=1).std(), np.diff(relief, axis=0).std()
    assert across > 1.5 * along


def test_crevasses_are_cut_inside_their_outlines() -> None:
    ground, flat = fine(crevasses_per_ha=6.0, bridged_share=0.0), fine()
    assert {hazard.kind for hazard in ground.hazards} == {"crevasse"}
    deep = ground.height < flat.height - 2.0
    x, y = np.meshgrid(ground.dem.x, ground.dem.y)
    outlines = shapely.union_all([hazard.outline for hazard in ground.hazards]).buffer(ground.step_m)
    assert deep.sum() > 50
    assert shapely.contains_xy(outlines, x[deep], y[deep]).all()
    assert ground.openness[deep].max() < 255


def test_pools_are_level_water() -> None:
    ground = fine(pools_per_ha=6.0)
    pools = [hazard for hazard in ground.hazards if hazard.kind == "melt pool"]
    x, y = np.meshgrid(ground.dem.x, ground.dem.y)
    wet = shapely.contains_xy(pools[0].outline.buffer(-0.3), x, y)
    heights = np.unique(ground.height[wet & (ground.water == 255)])
    # Another pool may lie across this one; within itself water is level to the last bit.
    assert len(heights) <= len(pools)


def test_every_kind_of_hazard_has_a_valid_outline() -> None:
    ground = fine(
        crevasses_per_ha=8.0, pools_per_ha=5.0, channels_per_ha=5.0, dirt_cones_per_ha=9.0, bridged_share=0.5
    )
    kinds = {hazard.kind for hazard in ground.hazards}
    assert kinds == {"crevasse", "bridged crevasse", "melt channel", "melt pool", "dirt cone"}
    assert all(hazard.outline.is_valid and hazard.outline.area > 0.1 for hazard in ground.hazards)
    assert np.isfinite(ground.height).all()


def test_the_same_seed_gives_the_same_ground_and_another_one_not() -> None:
    config = SceneryConfig(crevasses_per_ha=5.0)
    first = fine_terrain(site(), config, seed=1)
    other = fine_terrain(site(), config, seed=2)
    again = fine_terrain(site(), config, seed=1)
    assert (again.height == first.height).all()
    assert (other.height != first.height).any()
    assert fine_terrain(site(), config, seed=1) is again  # kept


def test_tiles_meet_at_their_edges(rng: np.random.Generator) -> None:
    tile = band_limited_field((64, 64), 0.1, (0.8, 3.0), 1.0, rng, periodic=True)
    inner = np.abs(np.diff(tile, axis=0)).max()
    assert np.abs(tile[0] - tile[-1]).max() < 1.5 * inner


def test_unknown_cells_are_refused() -> None:
    heights = np.zeros((11, 11))
    heights[3, 4] = np.nan
    with pytest.raises(InputError, match="1 of them unknown"):
        fine_terrain(Dem.on(Grid((0.0, 0.0, 10.0, 10.0), 1.0), heights), SceneryConfig(), seed=0)
