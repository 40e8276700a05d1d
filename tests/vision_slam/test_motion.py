"""Motion by wheels and gyro where the answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.sensors.records import Inertial, Wheels
from vision_slam.motion import MotionSensors, RelativeMotion
from vision_slam.readers.sequence import ImageSequence


def _rocking(time_s: FloatArray) -> Rotation:
    """Attitude of a body that rocks, from standing at 1 s on, while it turns."""
    moving = np.maximum(time_s - 1.0, 0.0)
    angles = np.column_stack([0.1 * np.sin(9.0 * moving), 0.05 * moving**2, 0.4 * moving])
    return Rotation.from_euler("xyz", angles)


def _sensed(camera: Camera, bias: FloatArray) -> ImageSequence:
    times = np.arange(1, 321) / 80.0
    before, after = _rocking(times - 1.0 / 80.0), _rocking(times)
    rates = (before.inv() * after).as_rotvec() * 80.0 + bias
    rolled = np.maximum(times - 1.0, 0.0)
    frames = Frames(np.array([0.0]), (np.zeros((camera.height, camera.width), np.uint8),))
    return ImageSequence(
        camera, frames, Wheels(times, rolled, rolled), Inertial(times, rates, np.zeros((320, 3)))
    )


def test_mean_rates_sum_up_to_the_turn_whatever_the_moments(camera: Camera) -> None:
    bias = np.array([0.01, -0.02, 0.03])
    sensors = MotionSensors(_sensed(camera, bias))
    first, last = 1.5, 3.1375
    measured = sensors.between(first, last)
    real = (_rocking(np.array([first])).inv() * _rocking(np.array([last])))[0]
    assert measured.rotation is not None
    assert measured.travel_m is not None
    # The bias is that of the standing second; it is taken out half before the turn and half after it,
    # which leaves bias × time × turn² / 12 = 2e-3 of it.
    assert (Rotation.from_matrix(measured.rotation).inv() * real).magnitude() < 4e-3
    short = sensors.between(2.0, 2.25)
    real = (_rocking(np.array([2.0])).inv() * _rocking(np.array([2.25])))[0]
    assert short.rotation is not None
    assert (Rotation.from_matrix(short.rotation).inv() * real).magnitude() < 1e-3
    assert abs(measured.travel_m - (last - first)) < 1e-9


_NOISE_RAD_SQRT_S, _IMAGES_RAD = np.radians(0.01), np.radians(0.05)


def _estimated(motion: RelativeMotion, images_rad: FloatArray) -> FloatArray:
    """Estimate of a turn: that by gyro and that by images, weighed by their variances."""
    assert motion.rotation is not None
    gyro_variance = motion.turn_sigma_rad(_NOISE_RAD_SQRT_S) ** 2
    share = gyro_variance / (gyro_variance + _IMAGES_RAD**2)
    gyro_rad = Rotation.from_matrix(motion.rotation).as_rotvec()
    return Rotation.from_rotvec(gyro_rad + share * (images_rad - gyro_rad)).as_matrix()


def _in_motion(camera: Camera, bias: FloatArray) -> ImageSequence:
    """Straight drive in motion from the first reading on, of which the gyro reads its bias and noise."""
    seen = _sensed(camera, np.zeros(3))
    assert seen.inertial is not None
    times = seen.inertial.time_s
    noise = np.random.default_rng(2).normal(0.0, _NOISE_RAD_SQRT_S * 80.0**0.5, (len(times), 3))
    return replace(
        seen, wheels=Wheels(times, times, times), inertial=replace(seen.inertial, gyro_rad_s=bias + noise)
    )


def test_images_estimate_the_bias_as_well_as_its_sigma_states(camera: Camera) -> None:
    bias, squared = np.radians([0.1, -0.2, 0.4]), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sensors = MotionSensors(_in_motion(camera, bias))
        assert np.degrees(sensors.between(0.5, 1.0).bias_sigma_rad_s) == pytest.approx(1.0)
        for k in range(100):
            motion = sensors.between(0.5 + 0.03 * k, 0.9 + 0.03 * k)
            turn = _estimated(motion, rng.normal(0.0, _IMAGES_RAD, 3))
            sensors.learn(motion, turn, _NOISE_RAD_SQRT_S, has_far_features=True)
        after = sensors.between(0.2, 3.8)
        assert after.rotation is not None
        assert np.degrees(after.bias_sigma_rad_s) < 0.02
        error = Rotation.from_matrix(after.rotation).as_rotvec() / 3.6
        squared.append(float(np.mean(error**2)) / after.bias_sigma_rad_s**2)
    # The drift of a bias, which is part of its sigma, is not drawn here.
    assert 0.4 < np.mean(squared) < 1.3


def test_images_without_far_features_leave_a_bias_alone_that_a_rest_measured(camera: Camera) -> None:
    sensors = MotionSensors(_sensed(camera, np.zeros(3)))
    motion = sensors.between(0.25, 0.5)
    assert motion.rotation is not None
    assert np.degrees(motion.bias_sigma_rad_s) == pytest.approx(0.01)
    seen = Rotation.from_rotvec([0.0, 0.0, np.radians(0.02)]).as_matrix()
    for _ in range(100):
        sensors.learn(motion, seen, _NOISE_RAD_SQRT_S, has_far_features=False)
    unchanged = sensors.between(0.25, 0.5).rotation
    assert unchanged is not None
    assert np.array_equal(unchanged, motion.rotation)
    sensors.learn(motion, seen, _NOISE_RAD_SQRT_S, has_far_features=True)
    changed = sensors.between(0.25, 0.5).rotation
    assert changed is not None
    assert Rotation.from_matrix(changed).as_rotvec()[2] > 0.0


def test_the_rest_of_a_noisy_gyro_leaves_its_bias_uncertain(camera: Camera) -> None:
    seen = _sensed(camera, np.zeros(3))
    assert seen.inertial is not None
    squared = []
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0.0, np.radians(0.3), seen.inertial.gyro_rad_s.shape)
        noisy = replace(seen, inertial=replace(seen.inertial, gyro_rad_s=seen.inertial.gyro_rad_s + noise))
        motion = MotionSensors(noisy).between(0.0125, 1.0)
        bias = np.median(noisy.inertial.gyro_rad_s[:80], axis=0)  # type: ignore[union-attr]
        squared.append(np.mean(bias**2) / motion.bias_sigma_rad_s**2)
    assert 0.6 < np.mean(squared) < 1.3


def test_an_hour_between_two_keyframes_leaves_the_bias_a_variance(camera: Camera) -> None:
    sensors = MotionSensors(_sensed(camera, np.zeros(3)))
    motion = replace(sensors.between(0.25, 0.5), seconds=3600.0)
    assert motion.rotation is not None
    for _ in range(3):
        sensors.learn(motion, motion.rotation, _NOISE_RAD_SQRT_S, has_far_features=True)
        assert 0.0 < sensors.between(0.25, 0.5).bias_sigma_rad_s < np.radians(0.01)


def test_a_body_that_settles_into_a_turn_has_no_bias(camera: Camera) -> None:
    seen = _sensed(camera, np.zeros(3))
    assert seen.inertial is not None
    # Wheels stand for a second, in which the body begins to turn: 0.2 to 0.7 degrees a second.
    rates = seen.inertial.gyro_rad_s.copy()
    rates[:80, 2] += np.radians(np.linspace(0.2, 0.7, 80))
    rates[:80] += np.random.default_rng(1).normal(0.0, np.radians(0.05), (80, 3))
    settling = replace(seen, inertial=replace(seen.inertial, gyro_rad_s=rates))
    measured, alone = (MotionSensors(one).between(1.5, 2.5).rotation for one in (settling, seen))
    assert measured is not None
    assert alone is not None
    # The mean of the second before would be taken off: 0.45 degrees.
    assert (Rotation.from_matrix(measured).inv() * Rotation.from_matrix(alone)).magnitude() < 1e-9
