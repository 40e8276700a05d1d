"""Faults of images, calibration, start, tracks and scenery."""

import numpy as np
import pytest

from sim.config.mission import RoverConfig
from sim.config.rover import PhysicsConfig
from sim.config.sensors import FAILURES, FaultConfig, faults_of
from sim.config.world import AppearanceConfig, ImagingConfig
from sim.simulate.assembly import Faults, rover_camera
from sim.vehicle.motion import KinematicRover
from survey.core.errors import ConfigError

IMAGE = np.tile(np.arange(0, 240, 4, dtype=np.uint8), (40, 1))


def faults(component: str, failure: str, **settings: float) -> Faults:
    return Faults([FaultConfig(component=component, failure=failure, **settings)], 1)


def seen(failure: str, **settings: float):
    return faults("camera", failure, **settings).image(1.0, 4, IMAGE)


def test_images_fail_as_named():
    assert seen("whiteout").min() > 220
    assert seen("dark").max() < 20
    assert seen("dropped") is None
    assert np.abs(np.diff(seen("glare")[0, 28:32].astype(int))).max() == 0  # overexposed
    chequered = np.indices((40, 60)).sum(axis=0).astype(np.uint8) % 2 * 200
    dropped = faults("camera", "lens-drop").image(1.0, 4, chequered)
    assert 0.05 < np.mean(dropped != chequered) < 0.5  # blurred behind the drop alone
    assert seen("blur").astype(float).std(axis=0).mean() == pytest.approx(1.3, rel=0.2)  # noise alone


def test_a_frozen_camera_repeats_the_last_image():
    frozen = faults("camera", "frozen", from_s=1.0)
    first = frozen.image(0.0, 0, IMAGE)
    np.testing.assert_array_equal(frozen.image(1.0, 1, IMAGE + 10), first)


def test_outside_its_interval_a_fault_changes_nothing():
    late = faults("camera", "whiteout", from_s=2.0)
    np.testing.assert_array_equal(late.image(1.0, 0, IMAGE), IMAGE)


def test_calibration_is_stated_wrongly():
    camera = rover_camera(ImagingConfig())
    focal = faults("calibration", "focal-length", strength=0.01).calibration(camera)
    assert focal.matrix[0, 0] == pytest.approx(1.01 * camera.matrix[0, 0])
    assert focal.matrix[0, 2] == camera.matrix[0, 2]
    pitch = faults("calibration", "pitch", strength=2.0).calibration(camera)
    cosine = pitch.T_body_camera[:3, 2] @ camera.T_body_camera[:3, 2]
    assert np.degrees(np.arccos(cosine)) == pytest.approx(2.0)


def test_a_kidnapped_start_is_as_far_away_as_stated():
    moved = faults("start", "kidnapped", strength=12.0).start(np.zeros(3))
    assert np.hypot(*moved[:2]) == pytest.approx(12.0)
    assert moved[2] == 0.0


class Level:
    step_m, bounds = 1.0, (0.0, 0.0, 10.0, 10.0)

    def elevation(self, xy):
        return np.zeros(len(xy))


def test_tracks_and_ground_fail_during_the_interval_alone():
    rover = KinematicRover(Level(), PhysicsConfig(), RoverConfig(), np.array([5.0, 5.0]), 0.0)
    stuck = Faults(
        [
            FaultConfig(component="tracks", failure="stuck-left", until_s=2.0),
            FaultConfig(component="tracks", failure="slippery", until_s=2.0),
        ],
        1,
    )
    stuck.drive(rover, 1.0)
    assert (rover.drive_share, rover.friction_share) == ((0.0, 1.0), 0.3)
    stuck.drive(rover, 2.0)
    assert (rover.drive_share, rover.friction_share) == ((1.0, 1.0), 1.0)


def test_hidden_mountains_are_not_drawn():
    assert faults("scenery", "mountains-hidden").appearance(AppearanceConfig()).ridges_deg == 0.0
    assert Faults([], 1).appearance(AppearanceConfig()) == AppearanceConfig()


def test_every_failure_has_a_usual_strength():
    for component, failures in FAILURES.items():
        for failure, strength in failures.items():
            assert FaultConfig(component=component, failure=failure).size == strength


def test_unknown_components_and_failures_are_refused():
    with pytest.raises(ConfigError, match="'radar' is not known; give one of camera, gps"):
        FaultConfig(component="radar", failure="off")
    with pytest.raises(ConfigError, match="gps has the failures off, frozen, jump, delayed"):
        FaultConfig(component="gps", failure="whiteout")


def test_faults_are_found_by_component():
    both = [FaultConfig(component=c, failure=f) for c, f in (("gps", "off"), ("rover", "carried"))]
    assert faults_of(both, "rover") == both[1:]
