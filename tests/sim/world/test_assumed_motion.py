"""Prior of the motion of the ice: one velocity, or velocity rasters."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from sim.config.world import IceAssumptions, IceConfig
from sim.mission.runs import read_mission
from sim.world.moving_ice import assumed_motion
from survey import Dem, Grid
from survey.core.config import validated
from survey.core.errors import ConfigError, InputError

MISSION = Path(__file__).parents[3] / "examples/small_survey.toml"
UTM = CRS("EPSG:32608")
PLACES = np.array([[500.0, 500.0], [900.0, 700.0]])
NAMES = ("vx.tif", "vy.tif", "sx.tif", "sy.tif")


@pytest.fixture
def rasters(tmp_path: Path) -> Path:
    """Velocity of 1 m a day to the east, which grows by 1 m a day over a kilometre, ± 0.1, and none to the north, ± 0.2."""
    grid = Grid((0.0, 0.0, 1500.0, 1500.0), 100.0, UTM)
    east = 1.0 + np.meshgrid(grid.x - 700.0, grid.y)[0] / 1000.0
    for name, values in zip(NAMES, (east, 0.0, 0.1, 0.2), strict=True):
        Dem.on(grid, np.broadcast_to(values, grid.shape)).write(tmp_path / name)
    return tmp_path


def test_rasters_are_the_prior_with_their_errors(rasters: Path) -> None:
    assumed = IceAssumptions(velocity_files=NAMES, lowering_m_per_day=0.06, lowering_sigma_m_per_day=0.02)
    motion = assumed_motion(assumed, 3600.0, PLACES, UTM, path_of=lambda name: rasters / name)
    np.testing.assert_allclose(motion.rates(PLACES), [[0.8, 0.0, -0.06], [1.2, 0.0, -0.06]], atol=1e-9)
    np.testing.assert_allclose(motion.rates_sigma(PLACES), [[0.1, 0.2, 0.02]] * 2, atol=1e-6)
    assert motion.epoch_s == 3600.0


def test_without_rasters_the_velocity_counts_from_the_start() -> None:
    assumed = IceAssumptions(velocity_m_per_day=(2.0, 0.0))
    motion, stated = assumed_motion(assumed, 60.0, PLACES, UTM), assumed.prior(60.0, (500.0, 500.0))
    np.testing.assert_array_equal(motion.origin_m, stated.origin_m)
    np.testing.assert_array_equal(motion.coefficients, stated.coefficients)


def test_rasters_in_another_crs_are_refused(rasters: Path) -> None:
    assumed = IceAssumptions(velocity_files=NAMES)
    with pytest.raises(InputError, match="rasters of the velocity"):
        assumed_motion(assumed, 0.0, PLACES, CRS("EPSG:32607"), path_of=lambda name: rasters / name)


def test_rasters_and_one_velocity_exclude_one_another() -> None:
    values = {"velocity_files": NAMES, "velocity_sigma_m_per_day": 1.0}
    with pytest.raises(ConfigError, match="velocity_files and velocity_sigma_m_per_day exclude one another"):
        validated(IceAssumptions, values, "the mission")


def test_the_files_of_a_mission_hold_the_assumed_rasters() -> None:
    ice = IceConfig(assumed=IceAssumptions(velocity_files=NAMES))
    mission = read_mission(MISSION).model_copy(update={"ice": ice})
    assert {f"ice.assumed.velocity_files[{k}]" for k in range(4)} <= set(mission.input_files)
