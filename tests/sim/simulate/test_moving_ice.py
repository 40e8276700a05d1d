import numpy as np
import pytest
from pydantic import ValidationError

from planners import LawnmowerConfig
from sim.config.mission import AidsConfig, MissionConfig
from sim.config.world import IceConfig, RandomTerrain
from sim.simulate.simulation import simulate_statistical
from survey import Dem, Grid, Leg, Route

CRS, DAY_S = "EPSG:32608", 86400.0
EXACT = {
    "gps_bias_sigma_m": 0.0,
    "gps_white_sigma_m": 0.0,
    "yaw_sigma_deg": 0.0,
    "tilt_sigma_deg": 0.0,
    "scale_sigma": 0.0,
    "step_sigma_m": 0.0,
}


def ground() -> Dem:
    grid = Grid((0.0, 0.0, 200.0, 200.0), 2.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, 3.0 * np.sin(x / 30.0) * np.cos(y / 25.0))


def route() -> Route:
    there = [[40.0, 100.0], [160.0, 100.0]], [[160.0, 100.0], [160.0, 120.0]], [[160.0, 120.0], [40.0, 120.0]]
    legs = (Leg(kind, line) for kind, line in zip(("swath", "transit", "swath"), there, strict=True))
    return Route(tuple(legs), CRS, "lawnmower", 20.0)


def mission(ice: IceConfig | None, **sensors: float) -> MissionConfig:
    config = MissionConfig(
        schema_version=1,
        name="m",
        seed=5,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=2),
        aids=AidsConfig(stakes=2, recognition=1.0),
        ice=ice,
    )
    slow = config.rover.model_copy(update={"speed_m_s": 0.005})
    return config.model_copy(update={"sensors": config.sensors.model_copy(update=sensors), "rover": slow})


def at_half_a_metre_a_second(ice: IceConfig | None) -> MissionConfig:
    slow = mission(ice)
    return slow.model_copy(update={"rover": slow.rover.model_copy(update={"speed_m_s": 0.5})})


def moving(**settings: object) -> IceConfig:
    return IceConfig(
        velocity_m_per_day=4.0, melt_m_per_day=0.1, pose_interval_s=400.0, stake_surveys=3, **settings
    )


def test_fixes_follow_the_route_in_fixed_coordinates_and_the_odometry_the_ice():
    recording, truth = simulate_statistical(ground(), route(), mission(moving(), **EXACT))
    np.testing.assert_allclose(recording.gps.position[:40, 1], 100.0, atol=1e-6)
    assert recording.odometry is not None
    # The first swath lasts 24,000 s, in which the ice moves 1.11 m to the east: the way on the ice is shorter by that.
    before = truth.trajectory.time_s <= 24000.0
    length_m = np.linalg.norm(recording.odometry.step[: before.sum() - 1, :2], axis=1).sum()
    assert abs(length_m - (120.0 - 4.0 * 24000.0 / DAY_S)) < 0.4


def test_the_truth_is_the_terrain_of_the_epoch():
    begin, end = (
        simulate_statistical(ground(), route(), mission(moving(epoch_s=epoch_s)))[1].dem
        for epoch_s in (0.0, DAY_S)
    )
    np.testing.assert_allclose(begin.elevation, ground().elevation, atol=1e-9)
    # After a day what was 4 m to the west is here, 0.1 m lower.
    moved = ground().at(end.grid().xy - [4.0, 0.0]).reshape(end.shape) - 0.1
    np.testing.assert_allclose(end.elevation[:, 5:], moved[:, 5:], atol=1e-6)


def test_stakes_are_surveyed_where_the_ice_has_carried_them():
    recording, _ = simulate_statistical(ground(), route(), mission(moving()))
    surveys = recording.stake_surveys
    assert surveys is not None
    first, last = surveys.position[:2], surveys.position[-2:]
    days = (surveys.time_s[-1] - surveys.time_s[0]) / DAY_S
    # Each survey errs by 5 cm.
    np.testing.assert_allclose(last - first, np.tile([4.0 * days, 0.0, -0.1 * days], (2, 1)), atol=0.3)


def test_ice_at_rest_gives_the_recording_of_a_mission_without_ice():
    still, plain = (
        simulate_statistical(ground(), route(), at_half_a_metre_a_second(ice))[0]
        for ice in (IceConfig(), None)
    )
    assert still == plain


def test_a_fleet_on_moving_ice_is_refused():
    stated = mission(IceConfig(velocity_m_per_day=1.0)).model_dump()
    with pytest.raises(ValidationError, match="supported for one rover"):
        MissionConfig.model_validate({**stated, "fleet": {"rovers": 2}})
