"""Drives in images whose path is chosen on the way, from the roll and pitch that the rover senses."""

import numpy as np
import pytest

import planners
from planners.steered_paths import WaypointSteering
from sim.config.rover import PhysicsConfig
from sim.simulate.navigation import PoseEstimate, SensedTilt, SteeredPath
from sim.simulate.simulated_drive import Ending
from sim.simulate.vision import simulate_vision
from sim.vehicle.pursuit import PurePursuit
from survey import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.recording import Readings
from survey.data.sensors.records import Inertial
from tests.sim.simulate.test_vision import mission

G_M_S2 = 9.81
AREA = SurveyArea.rectangle((5.0, 5.0, 19.0, 19.0), "EPSG:32608")
CONFIG = planners.PiecewiseContinuousConfig(swaths=1, step_m=4.0, toggle_probability=0.0)


def steering(seed: int = 1) -> WaypointSteering:
    reference = planners.plan(AREA, None, CONFIG)
    return WaypointSteering(reference, planners.steering_of(CONFIG), AREA.free, np.random.default_rng(seed))


def swath_frame() -> tuple[np.ndarray, np.ndarray]:
    """Return the directions along the swath and to its left."""
    along = np.diff(planners.plan(AREA, None, CONFIG).legs[0].axis, axis=0)[0]
    along = along / np.hypot(*along)
    return along, np.array([-along[1], along[0]])


def readings(roll_rad: float, pitch_rad: float, from_s: float = 0.0) -> Readings:
    """Three seconds of an accelerometer at rest."""
    times = from_s + 0.1 * np.arange(30.0)
    force = G_M_S2 * np.array(
        [-np.sin(pitch_rad), np.sin(roll_rad) * np.cos(pitch_rad), np.cos(roll_rad) * np.cos(pitch_rad)]
    )
    return Readings(inertial=Inertial(times, np.zeros((30, 3)), np.tile(force, (30, 1))))


def test_roll_and_pitch_are_those_of_gravity_in_the_last_seconds() -> None:
    tilt = SensedTilt()
    tilt.add(readings(0.3, 0.3))
    tilt.add(readings(0.1, -0.05, from_s=3.0))
    assert tilt.roll_and_pitch() == pytest.approx((0.1, -0.05), abs=1e-9)


def test_the_path_turns_by_what_is_sensed_and_not_by_the_ground() -> None:
    along, left = swath_frame()
    aside = {}
    for roll in (0.1, -0.1):
        path, start = SteeredPath(steering()), steering().start
        path.sense(readings(roll, 0.0))
        pursuit = PurePursuit(start[None], 1.0, PhysicsConfig(), is_complete=False)
        path.extend(pursuit, PoseEstimate(start, float(np.arctan2(along[1], along[0]))))
        aside[roll] = float((pursuit.at(np.array([pursuit.length_m]))[0][0] - start) @ left)
    # The left side up or down: to one side of the swath or to the other, by 45 degrees.
    assert aside[0.1] == pytest.approx(-aside[-0.1], abs=1e-6)
    assert abs(aside[0.1]) == pytest.approx(4.0 * np.sin(np.pi / 4.0), abs=0.1)


def test_a_path_is_complete_after_its_last_swath() -> None:
    path, start = SteeredPath(steering()), steering().start
    pursuit = PurePursuit(start[None], 1.0, PhysicsConfig(), is_complete=False)
    estimate = PoseEstimate(start, 0.0)
    for _ in range(200):
        path.extend(pursuit, estimate)
        pursuit.track_speeds(*estimate)
        ahead = pursuit.at(np.array([pursuit.progress_m + 0.5]))[0][0]
        estimate = PoseEstimate(ahead, 0.0)
    assert not pursuit.wants_more
    assert pursuit.is_done(pursuit.at(np.array([pursuit.length_m]))[0][0])


@pytest.mark.long
def test_a_drive_in_images_is_steered_by_its_own_accelerometer(tmp_path) -> None:
    pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python")
    grid = Grid((0.0, 0.0, 24.0, 24.0), 0.25, "EPSG:32608")
    reference = planners.plan(AREA, None, CONFIG)
    left = swath_frame()[1]
    x, y = np.meshgrid(grid.x, grid.y)
    offsets = {}
    for slope in (0.12, -0.12):
        ground = Dem.on(grid, 100.0 + slope * (left[0] * x + left[1] * y))
        chosen = steering()
        drive = simulate_vision(
            ground,
            reference,
            mission(area={"bounds_m": [5.0, 5.0, 19.0, 19.0]}),
            tmp_path / f"recording{slope}",
            steering=chosen,
        )
        assert drive.ending is Ending.ARRIVED
        real = drive.truth.trajectory.position[:, :2]
        offsets[slope] = (real - reference.legs[0].axis[0]) @ left
        assert drive.route_m == pytest.approx(chosen.driven().length_m)
    # The accelerometer errs by 0.2 degrees, the ground leans by 7: uphill to one side, or to the other.
    assert np.abs(offsets[0.12]).max() > 1.5
    assert (
        offsets[0.12][np.abs(offsets[0.12]).argmax()] * offsets[-0.12][np.abs(offsets[-0.12]).argmax()] < 0.0
    )
