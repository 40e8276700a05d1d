"""Drives without images: the path of wheels, gyro and fixes, and of some of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.config.sensors import GpsConfig, InertialConfig, InstrumentsConfig, WheelConfig
from sim.instruments.dead_reckoning import InertialUnit, WheelEncoders
from sim.instruments.gps import GpsReceiver
from sim.vehicle.motion import RoverMotion
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.sensors.records import GpsFixes
from vision_slam.config import LocalizationConfig
from vision_slam.pipeline import localize, localize_images
from vision_slam.readers.sequence import MotionRecords
from vision_slam.recordings import open_recording

ORIGIN = np.array([526000.0, 6478000.0, 100.0])
SECONDS = 100.0


@pytest.fixture(scope="module")
def motion() -> RoverMotion:
    """Drive bends of 100 m up and down a slope, after a rest of three seconds."""
    time_s = np.arange(0.0, SECONDS, 0.05)
    speed = np.clip(time_s - 3.0, 0.0, 1.0)
    heading = 1.4 * np.sin(2.0 * np.pi * np.cumsum(speed) * 0.05 / 80.0)
    pitch = -0.05 * np.cos(heading)
    turn = Rotation.from_euler("ZYX", np.column_stack([heading, pitch, np.zeros_like(pitch)]))
    velocity = turn.apply([1.0, 0.0, 0.0]) * speed[:, None]
    position = ORIGIN + 0.05 * np.cumsum(velocity, axis=0)
    rolled = np.tile(0.05 * np.cumsum(speed)[:, None], (1, 2)) + 0.25 * heading[:, None] * [-1.0, 1.0]
    rate = np.gradient(heading, time_s)[:, None] * [0.0, 0.0, 1.0]
    return RoverMotion(time_s, position, turn.as_quat(), velocity, rate, rolled)


def recorded(motion: RoverMotion, seed: int, profile: str = "sbas") -> Recording:
    """Record a drive by a receiver, encoders and an inertial unit whose errors are not those that localization assumes."""
    gps = GpsReceiver(InstrumentsConfig(gps=GpsConfig(profile=profile)), 0.5, seed).sense(motion)
    wheels = WheelEncoders(WheelConfig(scale_error=0.02), seed).sense(motion)
    inertial = InertialUnit(InertialConfig(gyro_bias_deg_h=60.0), seed).sense(motion)
    assert gps is not None
    return Recording(
        "EPSG:32608",
        gps.position[0],
        gps,
        antenna_height_m=0.5,
        start_is_surveyed=False,
        wheels=wheels,
        inertial=inertial,
    )


def truth(motion: RoverMotion, time_s: FloatArray) -> FloatArray:
    return motion.position_at(time_s)


@pytest.mark.long
@pytest.mark.parametrize("has_gyro", [True, False])
@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 8), marks=pytest.mark.exhaustive)])
def test_paths_without_images_are_better_than_the_fixes_and_their_covariances_hold(
    motion: RoverMotion, has_gyro: bool, seeds: range
) -> None:
    squared, ratio = [], []
    for seed in seeds:
        drive = recorded(motion, seed)
        found = localize(drive if has_gyro else replace(drive, inertial=None))
        path = found.trajectory
        off = (path.position - truth(motion, path.time_s))[:, :2]
        spread = path.covariance[:, :2, :2]
        squared.append(np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[:, :, None])[:, :, 0]).mean())
        alone = (drive.gps.position - truth(motion, drive.gps.time_s))[:, :2]
        ratio.append(np.sqrt((off**2).sum(axis=1).mean() / (alone**2).sum(axis=1).mean()))
        assert found.visual_odometry is None
        assert any("no images" in note for note in found.notes)
    assert 0.5 <= np.mean(squared) <= 3.0
    assert max(ratio) <= 1.05
    assert np.mean(ratio) <= 0.9


def test_centimetres_of_fixes_are_kept_between_them(motion: RoverMotion) -> None:
    drive = recorded(motion, 1, "rtk")
    config = LocalizationConfig(gps_bias_sigma_m=0.01, gps_white_sigma_m=0.01)
    path = localize(drive, config).trajectory
    off = (path.position - truth(motion, path.time_s))[:, :2]
    assert np.hypot(*off.T).max() < 0.2


def test_the_ground_below_the_path_takes_the_place_of_landmarks(motion: RoverMotion) -> None:
    found = localize(recorded(motion, 2))
    assert len(found.points.xyz) == len(found.trajectory.time_s)
    assert (found.points.sigma_z >= np.sqrt(found.trajectory.covariance[:, 2, 2])).all()


def test_wheels_and_gyro_alone_give_a_path_whose_claim_grows(motion: RoverMotion) -> None:
    drive = recorded(motion, 3)
    found = localize_images(MotionRecords(drive.wheels, drive.inertial))
    assert found.own_covariance is not None
    sigma_m = np.sqrt(np.linalg.eigvalsh(found.own_covariance[:, :2, :2])[:, -1])
    real = truth(motion, found.time_s)
    heading = motion.rotation_at(found.time_s[:1]).as_matrix()[0]
    off = found.position - (real - real[0]) @ heading
    assert sigma_m[-1] > sigma_m[len(sigma_m) // 2]
    assert np.hypot(*off[-1, :2]) < 3.0 * sigma_m[-1]
    assert np.hypot(*off[-1, :2]) < 10.0


def test_wheels_alone_are_refused_in_one_sentence(motion: RoverMotion) -> None:
    with pytest.raises(InputError, match=r"neither images, a gyro nor fixes.*record one of them too\.$"):
        localize_images(MotionRecords(recorded(motion, 0).wheels))


def test_wheels_and_gyro_of_other_times_are_refused(motion: RoverMotion) -> None:
    drive = recorded(motion, 0)
    assert drive.inertial is not None
    late = replace(drive.inertial, time_s=drive.inertial.time_s + 1000.0)
    with pytest.raises(InputError, match=r"share 0\.0 s.*put both on one clock\.$"):
        localize(replace(drive, inertial=late))


def test_a_recording_without_images_is_opened(motion: RoverMotion, tmp_path: Path) -> None:
    recorded(motion, 4).write(tmp_path / "drive")
    found = open_recording(tmp_path / "drive").localize()
    assert found.trajectory is not None
    assert found.n_fixes > 90


def test_fixes_alone_stay_a_kinematic_survey(motion: RoverMotion) -> None:
    drive = replace(recorded(motion, 5), wheels=None)
    found = localize(drive)
    assert isinstance(drive.gps, GpsFixes)
    assert found.trajectory.position == pytest.approx(drive.gps.position - [0.0, 0.0, 0.5])
