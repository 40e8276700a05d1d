"""Motion by wheels and gyro where the answer is known."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames
from survey.data.sensors.aiding import Inertial, Wheels
from vision_slam.inertial.motion import MotionSensors
from vision_slam.io.sequence import ImageSequence


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


def test_what_images_see_teaches_the_bias(camera: Camera) -> None:
    sensors = MotionSensors(_sensed(camera, np.zeros(3)))
    turned = Rotation.from_rotvec(
        [0.0, 0.0, 0.005 * 0.25]
    )  # against images the gyro reads 0.005 rad/s too little
    for _ in range(1200):
        motion = sensors.between(0.25, 0.5)
        sensors.learn(motion, turned.as_matrix())
    motion = sensors.between(0.25, 0.5)
    assert motion.rotation is not None
    # Ten times the memory of 30 s: what remains of the bias is e^-10 of it.
    assert (Rotation.from_matrix(motion.rotation).inv() * turned).magnitude() < 1e-6


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
