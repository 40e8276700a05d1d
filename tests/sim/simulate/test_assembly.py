"""Assembly of a drive: rover, camera, stakes."""

import numpy as np
import pytest

from sim.simulate.assembly import camera_on_rover, rover_physics, stakes_beside
from sim.vehicle.motion import KinematicRover
from sim.vehicle.pursuit import PurePursuit
from sim.world.fine_terrain import fine_terrain
from tests.sim.simulate.test_vision import ground, mission

KINEMATIC = {"physics": {"engine": "kinematic"}}


def test_the_rover_stands_at_the_start_and_heads_along_the_path():
    config = mission(**KINEMATIC)
    path = np.array([[6.0, 12.0], [6.0, 14.0]])
    rover = rover_physics(fine_terrain(ground(), config.scenery, 5), path, config)
    assert isinstance(rover, KinematicRover)
    assert rover.state.position == pytest.approx((6.0, 12.0, 100.12), abs=1e-3)
    for _ in range(240):
        rover.step(1.0, 1.0)
    assert rover.state.position[:2] == pytest.approx((6.0, 13.0), abs=0.02)


def test_stakes_stand_left_and_right_of_the_route_on_the_ground():
    config = mission(instruments={"stakes": {"count": 4, "beside_m": 2.0}}, **KINEMATIC)
    pursuit = PurePursuit(np.array([[4.0, 12.0], [20.0, 12.0]]), 1.0, config.physics)
    fine = fine_terrain(ground(), config.scenery, 5)
    places = stakes_beside(fine, pursuit, config)
    np.testing.assert_allclose(places[:, 1], [14.0, 10.0, 14.0, 10.0])
    np.testing.assert_allclose(places[:, 0], [6.0, 10.0, 14.0, 18.0], atol=0.11)
    np.testing.assert_allclose(places[:, 2], fine.elevation(places[:, :2]))


def test_stakes_off_the_map_are_left_out():
    config = mission(instruments={"stakes": {"count": 2, "beside_m": 15.0}}, **KINEMATIC)
    pursuit = PurePursuit(np.array([[4.0, 12.0], [20.0, 12.0]]), 1.0, config.physics)
    assert len(stakes_beside(fine_terrain(ground(), config.scenery, 5), pursuit, config)) == 0


def test_the_camera_on_the_rover_gives_images_of_its_size():
    from sim.simulate.assembly import rover_camera

    config = mission(**KINEMATIC)
    camera = rover_camera(config.imaging)
    fine = fine_terrain(ground(), config.scenery, 5)
    pose = np.eye(4)
    pose[:3, 3] = 12.0, 12.0, float(fine.elevation(np.array([[12.0, 12.0]]))[0])
    on_rover = camera_on_rover(fine, config.appearance, camera, config)
    assert on_rover.frame(lambda _: pose, 0.0, 0).shape == (72, 96)
