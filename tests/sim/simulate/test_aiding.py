"""Aids of a mission: drawn from streams of their own, and honest about what they are."""

from dataclasses import replace

import numpy as np
import pytest
import typer

from planners import LawnmowerConfig
from sim.cli.plan_foresight import tell_ways
from sim.config.mission import AidsConfig, MissionConfig, RandomTerrain, SatelliteConfig, SensorConfig
from sim.mission.foresight import cheapest, foresee, ways_to_meet
from sim.simulate.aiding import with_way_home
from sim.simulate.statistical import simulate_statistical
from sim.world.site import World
from survey import Dem, Grid, Leg, Route, SurveyArea
from survey.data.recording import Recording
from survey.data.truth import Truth
from vision_slam.inertial.gravity import standing_bias
from vision_slam.inertial.gyro import gyro_residual_rad

CRS = "EPSG:32608"
AREA = SurveyArea.rectangle((0.0, 0.0, 200.0, 200.0), CRS)


def terrain() -> Dem:
    grid = Grid((-60.0, -60.0, 260.0, 260.0), 4.0, AREA.crs)
    x, y = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, 4.0 * np.sin(x / 60.0) * np.cos(y / 45.0))


def route(swaths: int = 2) -> Route:
    legs = []
    for k, y in enumerate(np.linspace(50.0, 150.0, swaths)):
        ends = [[20.0, y], [180.0, y]] if k % 2 == 0 else [[180.0, y], [20.0, y]]
        if legs:
            legs.append(Leg("transit", [legs[-1].xy[-1], ends[0]]))
        legs.append(Leg("swath", ends))
    return Route(tuple(legs), AREA.crs, "lawnmower")


def driven(**aids) -> tuple[Recording, Truth]:
    return simulate_statistical(terrain(), route(), mission(**aids))


def mission(**aids) -> MissionConfig:
    return MissionConfig(
        schema_version=1,
        name="m",
        seed=5,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=2),
        aids=AidsConfig(**aids),
    )


def test_aids_leave_the_other_sensors_as_they_were():
    plain, _ = driven()
    aided, _ = driven(accelerometer=True, stakes=2, base_barometer=True)
    np.testing.assert_array_equal(aided.gps.position, plain.gps.position)
    np.testing.assert_array_equal(aided.odometry.step, plain.odometry.step)
    np.testing.assert_array_equal(aided.sightings.offset, plain.sightings.offset)
    assert driven(barometer=False)[0].barometer is None


def test_stakes_are_where_the_sightings_say():
    recording, real = driven(stakes=2)
    index = np.searchsorted(real.trajectory.time_s, recording.stake_sightings.time_s)
    away = recording.stakes.position - real.trajectory.position[index]
    # A stake stands 1.5 m beside the way; survey and sighting err by 5 and 3 cm.
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 1.5, atol=0.3)
    np.testing.assert_allclose(np.linalg.norm(recording.stake_sightings.offset, axis=1), 1.5, atol=0.15)


def test_the_turn_at_the_start_tells_the_bias_of_the_accelerometer():
    recording, real = driven(accelerometer=True)
    driving = recording.inertial.time_s >= 0.0
    found = standing_bias(recording.inertial, 0.0)
    assert found is not None
    # What the readings of the drive pretend on average, with the acceleration of a level, even drive near 0.
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(real.trajectory.quaternion).inv().as_matrix()
    pretended = recording.inertial.specific_force_m_s2[driving] - 9.81 * turn[:, :, 2]
    straight = np.abs(recording.inertial.gyro_rad_s[driving, 2]) < 0.01
    bias = np.median(pretended[straight], axis=0) / 9.81
    # 40 readings of 5 mm/s² standing: 0.1 mrad; 350 of 50 mm/s² driving: 0.4 mrad.
    assert found.pitch_rad == pytest.approx(-bias[0], abs=1.5e-3)
    assert found.roll_rad == pytest.approx(bias[1], abs=1.5e-3)
    assert standing_bias(replace(recording.inertial), -100.0) is None


def test_the_gyro_tells_every_turn_where_the_heading_walks():
    sensors = SensorConfig(yaw_sigma_deg=0.0, tilt_sigma_deg=0.0, heading_walk_deg_sqrt_m=1e-6)
    config = mission(accelerometer=True).model_copy(update={"sensors": sensors})
    recording, _ = simulate_statistical(terrain(), route(), config)
    # Right angles within a second are among the turns; what the heading walks is 1e-5 degrees.
    assert np.abs(gyro_residual_rad(recording.inertial, recording.odometry)).max() < 1e-6


def test_the_base_station_shares_most_of_the_error():
    recording, real = driven(base_station=True, base_residual=0.1)
    rover = recording.gps.position - real.trajectory.position
    base = recording.base.position - real.trajectory.position[0]
    # Means over the drive: the lasting part of 1 m is common but for a tenth.
    assert np.abs((rover - base).mean(axis=0))[:2].max() < 0.5


def test_the_way_home_ends_where_the_route_began():
    home = with_way_home(route(), AREA)
    np.testing.assert_allclose(home.legs[-1].xy[-1], home.legs[0].xy[0])
    assert home.length_m > route().length_m
    found, _ = driven()
    assert found.loop_closures is None


def test_meetings_of_the_way_are_recognised():
    there_and_back = Route(
        (Leg("swath", [[20.0, 50.0], [180.0, 50.0]]), Leg("swath", [[180.0, 50.0], [20.0, 50.0]])),
        AREA.crs,
        "lawnmower",
    )
    recording, real = simulate_statistical(terrain(), there_and_back, mission(recognition=1.0))
    times = real.trajectory.time_s
    later, earlier = (
        np.searchsorted(times, t) for t in (recording.loop_closures.time_s, recording.loop_closures.earlier_s)
    )
    apart = np.linalg.norm(real.trajectory.position[later] - real.trajectory.position[earlier], axis=1)
    assert len(apart) >= 2
    assert apart.max() < 7.5
    np.testing.assert_allclose(np.linalg.norm(recording.loop_closures.offset, axis=1), apart, atol=0.5)


def test_foresight_knows_stakes_and_swaths():
    rng = np.random.default_rng(1)
    ground = terrain()
    inner = ground.window((-0.5, -0.5, 200.5, 200.5))
    cells = Dem(inner.elevation[:50, :50].reshape(5, 10, 5, 10).mean(axis=(1, 3)), ground.transform, AREA.crs)
    grid = Grid((20.0, 20.0, 180.0, 180.0), 40.0, AREA.crs)
    cells = Dem.on(grid, cells.elevation + 0.5 * rng.standard_normal((5, 5)))
    world = World(ground, cells, AREA)
    plain, staked = (foresee(mission(stakes=n), world, limit_m=0.4) for n in (0, 2))
    assert staked.rmse_m < plain.rmse_m
    assert staked.site_mean_m < plain.site_mean_m
    assert staked.chance >= plain.chance
    assert cheapest([plain, staked]) == plain
    found = list(ways_to_meet(mission(), world, limit_m=10.0, chance=0.5, most_swaths=2))
    assert [(way.swaths, way.stakes) for way in found] == [(2, 0), (2, 2), (2, 4)]
    assert str(found[1]).startswith("2 swaths with 2 stakes: ")


def test_the_command_says_how_many_swaths_and_stakes(capsys, monkeypatch):
    site = RandomTerrain(source="random", size_m=200.0, relief_m=8.0, length_scale_m=80.0, step_m=2.0)
    asked = mission().model_copy(update={"terrain": site, "satellite": SatelliteConfig(cell_m=25.0)})
    tell_ways(asked, "10", 0.5, as_json=False)
    assert capsys.readouterr().out.startswith("least to drive: 2 swaths: ")
    monkeypatch.setattr(
        "sim.mission.foresight.ways_to_meet", lambda *_, **__: iter(())
    )  # none of 24 that would be tried
    with pytest.raises(typer.Exit):
        tell_ways(asked, "0.001", 0.5, as_json=False)
    assert "is not foreseen" in capsys.readouterr().err
