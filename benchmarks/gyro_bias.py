"""Heading by visual odometry where the gyro has a bias, with and without a rest before the drive.

Run with ``python -m benchmarks.gyro_bias``. The recordings are lawnmower missions in images of
`benchmarks.honest_missions`, which are driven where that was not done before. Each is processed from its rest on, and
from 10 s after its rover sets off, with a further bias added to the gyro. Of the rest the odometry estimates the bias;
without one it has the images. The heading is compared with that of the truth, from the first image on.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.honest_missions.missions import SEEDS, driven
from benchmarks.report import Row, main
from survey.core.arrays import FloatArray
from survey.data.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.records import Inertial, Wheels
from survey.data.truth import Truth
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.readers.sequence import ImageSequence

_BIASES_DEG_S = (0.0, 0.4, 1.0)
_SET_OFF_M, _CUT_S, _BEFORE_S = 2e-3, 10.0, 0.5
_N_IMAGES = 240
_MOST_DEG = 1.0


def measure(quick: bool) -> Iterator[Row]:
    """Yield the largest error of heading over a minute, for each start and bias the worst of the sites."""
    seeds, biases = (SEEDS[:1], (0.0, 0.4)) if quick else (SEEDS, _BIASES_DEG_S)
    for begins_in_motion in (False, True):
        start = "begins in motion" if begins_in_motion else "begins at rest"
        for bias in biases:
            errors = [_heading_error_deg(seed, bias, begins_in_motion) for seed in seeds]
            name = f"{start}, gyro bias {bias:g} deg/s: largest heading error"
            yield Row(f"{name}, median of the sites", float(np.median(errors)), "deg")
            yield Row.of(f"{name}, worst of the sites", max(errors), "deg", "<=", _MOST_DEG)


def _heading_error_deg(seed: int, bias_deg_s: float, begins_in_motion: bool) -> float:
    """Return the largest error of heading of a mission [deg]."""
    folder = driven("lawnmower", seed) / "2-simulate"
    drive = _part(Recording.read(folder / "recording"), begins_in_motion)
    assert drive.inertial is not None
    rates = drive.inertial.gyro_rad_s + np.radians([0.0, 0.0, bias_deg_s])
    found = visual_odometry(replace(drive, inertial=replace(drive.inertial, gyro_rad_s=rates)))
    return float(np.degrees(np.abs(_heading_error_rad(found, Truth.read(folder / "truth")))).max())


def _part(recording: Recording, begins_in_motion: bool) -> ImageSequence:
    """Return a minute of images of a recording, from its rest or from its motion on, with the readings from there on."""
    frames, wheels, inertial = recording.frames, recording.wheels, recording.inertial
    assert recording.camera is not None
    assert frames is not None
    assert wheels is not None
    assert inertial is not None
    set_off_s = wheels.time_s[np.flatnonzero(np.abs(np.diff(wheels.left_m)) > _SET_OFF_M)[0]]
    first_s = set_off_s + _CUT_S if begins_in_motion else frames.time_s[0]
    chosen = np.flatnonzero(frames.time_s >= first_s)[:_N_IMAGES]
    images = tuple(frames[int(k)] for k in chosen)
    rolls, turns = wheels.time_s >= first_s - _BEFORE_S, inertial.time_s >= first_s - _BEFORE_S
    return ImageSequence(
        recording.camera,
        Frames(frames.time_s[chosen], images),
        Wheels(wheels.time_s[rolls], wheels.left_m[rolls], wheels.right_m[rolls]),
        Inertial(inertial.time_s[turns], inertial.gyro_rad_s[turns], inertial.specific_force_m_s2[turns]),
    )


def _heading_error_rad(found: VisualOdometry, truth: Truth) -> FloatArray:
    """Return the error of heading (N,), relative to the first image [rad]."""
    path, times = truth.trajectory, found.odometry.time_s
    turn = Slerp(path.time_s, Rotation.from_quat(path.quaternion))(times.clip(max=path.time_s[-1]))
    error: FloatArray = np.unwrap(found.odometry.attitude_rad[:, 2]) - np.unwrap(turn.as_euler("xyz")[:, 2])
    return error - error[0]


if __name__ == "__main__":
    main("Gyro bias", measure, ("numpy", "opencv-python-headless"))
