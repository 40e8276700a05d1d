"""Ground around a site: its horizon, how it continues the site, and what it refuses."""

import numpy as np
import pytest

from benchmarks.small_inputs import BARE_SCENERY
from sim.config.mission import MissionConfig
from sim.config.world import AppearanceConfig, SceneryConfig
from sim.world.fine_terrain import FineTerrain, fine_terrain
from sim.world.surroundings import (
    SiteSurroundings,
    horizon_deg,
    mission_surroundings,
    sunlight_on,
    surroundings_of,
)
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid

LOOK = AppearanceConfig(horizon="x")
CRS = "EPSG:32632"


def site(height: float = 2000.0) -> FineTerrain:
    grid = Grid((-20.0, -20.0, 20.0, 20.0), 1.0, CRS)
    return fine_terrain(Dem.on(grid, np.full(grid.shape, height)), SceneryConfig(**BARE_SCENERY), seed=1)


def model(height: np.ndarray, half_m: float = 12000.0) -> Dem:
    step = 2.0 * half_m / (len(height) - 1)
    return Dem.on(Grid((-half_m, -half_m, half_m, half_m), step, CRS), height)


def with_wall(at_m: float, top_m: float) -> Dem:
    """Level ground at 2000 m with a long wall in the east."""
    heights = np.full((241, 241), 2000.0)
    heights[:, 120 + round(at_m / 100.0) :] = 2000.0 + top_m
    return model(heights)


def test_the_horizon_is_lowered_by_curvature_and_raised_by_refraction() -> None:
    around = surroundings_of(with_wall(10000.0, 1000.0), site(), 2000.0, LOOK, 1)
    drop = 0.87 * 10000.0**2 / (2.0 * 6.371e6)  # 6.8 m
    expected = np.degrees(np.arctan((1000.0 - drop) / 10000.0))
    east, west = horizon_deg(around, np.array([90.0, 270.0]))
    assert east == pytest.approx(expected, abs=0.1)  # the edge is as wide as a cell of 100 m
    assert west == pytest.approx(0.0, abs=0.05)


def test_a_model_with_another_height_continues_the_site() -> None:
    around = surroundings_of(with_wall(10000.0, 0.0), site(2037.0), 2037.0, LOOK, 1)
    column, row = np.rint(around.middle / around.step_m).astype(int)
    level = around.height[row, column:]
    assert np.abs(level[4 : 2000 // round(around.step_m)]).max() < 0.5
    assert -1.5 < level[0] < -0.4  # below the site, which hides it


def test_sunlight_ends_at_the_shadow_of_a_wall() -> None:
    heights = np.zeros((201, 201), np.float32)
    heights[:, :50] = 100.0  # in the west, 500 m wide
    nothing = np.zeros_like(heights)
    around = SiteSurroundings(heights, nothing, nothing, np.zeros(2), np.array([1000.0, 1000.0]), 10.0)
    look = AppearanceConfig(sun_from_deg=270.0, sun_elevation_deg=float(np.degrees(np.arctan(0.25))))
    light = sunlight_on(around, look)[100]
    ends = 490.0 + 100.0 / 0.25  # the shadow is 400 m long
    assert light[60 : int(ends / 10.0) - 4].max() == 0.0
    assert light[int(ends / 10.0) + 4 : -2].min() > 0.95


def test_a_model_elsewhere_and_a_random_terrain_are_refused() -> None:
    far = Dem.on(Grid((50000.0, 0.0, 51000.0, 1000.0), 100.0, CRS), np.zeros((11, 11)))
    with pytest.raises(InputError, match="no height at the site"):
        surroundings_of(far, site(), 2000.0, LOOK, 1)
    content = {
        "schema_version": 1,
        "name": "a",
        "terrain": {"source": "random"},
        "planner": {"pattern": "lawnmower", "swaths": 2},
        "appearance": {"horizon": "terrain"},
    }
    mission = MissionConfig.model_validate(content)
    with pytest.raises(InputError, match="drawn at random and has no ground around it"):
        mission_surroundings(mission, site(), "terrain")


def test_a_mission_names_the_raster_of_its_horizon(tmp_path) -> None:
    slope = np.broadcast_to(2000.0 + np.arange(121.0), (121, 121))
    model(slope).write(tmp_path / "alps.tif")
    content = {
        "schema_version": 1,
        "name": "a",
        "terrain": {"source": "srtm-sample"},
        "planner": {"pattern": "lawnmower", "swaths": 2},
        "appearance": {"horizon": "alps.tif"},
    }
    mission = MissionConfig.model_validate(content).read_from(tmp_path)
    assert mission.input_files == {"appearance.horizon": tmp_path / "alps.tif"}
    assert mission_surroundings(mission, site(), "alps.tif").step_m == 200.0
    assert mission_surroundings(mission, site(), "terrain").relief_m > 500.0  # the complete sample
