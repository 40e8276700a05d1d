"""Aids of a mission: drawn from streams of their own, and honest about what they are."""

from dataclasses import replace

import numpy as np
import pytest

from sim.config.mission import SensorConfig
from sim.simulate.simulation import simulate_statistical, with_way_home
from survey import Dem, Grid, Leg, Route, SurveyArea
from survey.data.recording import Recording
from survey.data.truth import Truth
from tests.sim.small_missions import mission_with
from vision_slam.attitude import standing_bias
from vision_slam.motion import gyro_residual_rad

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
    return simulate_statistical(terrain(), route(), mission_with(**aids))


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


def test_the_turn_at_the_start_gives_the_bias_of_the_accelerometer():
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


def test_the_gyro_measures_every_turn_where_the_heading_walks():
    sensors = SensorConfig(yaw_sigma_deg=0.0, tilt_sigma_deg=0.0, heading_walk_deg_sqrt_m=1e-6)
    config = mission_with(accelerometer=True).model_copy(update={"sensors": sensors})
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
    recording, real = simulate_statistical(terrain(), there_and_back, mission_with(recognition=1.0))
    times = real.trajectory.time_s
    later, earlier = (
        np.searchsorted(times, t) for t in (recording.loop_closures.time_s, recording.loop_closures.earlier_s)
    )
    apart = np.linalg.norm(real.trajectory.position[later] - real.trajectory.position[earlier], axis=1)
    assert len(apart) >= 2
    assert apart.max() < 7.5
    np.testing.assert_allclose(np.linalg.norm(recording.loop_closures.offset, axis=1), apart, atol=0.5)
