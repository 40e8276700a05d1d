"""Odometry of wheels and gyro alone, for recordings without images.

The path is dead reckoning: the travel of the wheels along the body's forward axis, turned by the gyro and levelled by
gravity. Without a gyro the heading is the course of the fixes.
"""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from survey import InputError
from survey.core import FloatArray
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes, Inertial, Wheels
from vision_slam.attitude import world_attitudes
from vision_slam.motion import MotionSensors
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.window import half_turned
from vision_slam.readers.sequence import VisionRecords

_STEP_S = 0.25  # between poses
_TURN_RAD_SQRT_S = (
    0.5  # random walk of the heading where the filter is to take turns from gyro or fixes alone
)
_COURSE_M = 6.0  # travel between the fixes whose direction is the course
_BLIND = FrameHealth(0.0, 0.0, 0.0)


def wheel_odometry(records: VisionRecords, gps: GpsFixes | None = None) -> VisualOdometry:
    """Integrate wheels and gyro to an odometry without sightings, in steps of a quarter of a second.

    With fixes its turns get an error that leaves them to the gyro, whose bias filter and smoother estimate, or to the
    fixes. Without fixes the error is that of the gyro's noise and bias.

    `records`: with wheels. `gps`: fixes, in a projected CRS.
    """
    assert records.wheels is not None
    time_s = _pose_times(records.wheels, records.inertial)
    sensors = MotionSensors(records)
    motions = [sensors.between(*ends) for ends in pairwise(time_s.tolist())]
    if records.inertial is None:
        turns = _turns_by_course(gps, records.wheels, time_s)
    else:
        turns = [np.eye(3) if one.rotation is None else one.rotation for one in motions]
    pose, poses = np.eye(3), [np.eye(3)]
    for turn in turns:
        pose = pose @ turn
        poses.append(pose)
    travel = [0.0 if one.travel_m is None else one.travel_m for one in motions]
    steps = np.array(
        [half_turned(turn) @ [metres, 0.0, 0.0] for turn, metres in zip(turns, travel, strict=True)]
    )
    seconds = np.diff(time_s)
    if gps is None:
        sigma = _gyro_errors_rad(time_s, motions[0].bias_sigma_rad_s)
    else:
        sigma = _TURN_RAD_SQRT_S * np.sqrt(seconds)
    attitude = world_attitudes(np.array(poses), time_s, records)
    odometry = Odometry(time_s, steps, attitude, turn_sigma_rad=sigma)
    n = len(time_s)
    none = Sightings(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    return VisualOdometry(odometry, none, (_BLIND,) * n, np.zeros(n, dtype=np.bool_), has_images=False)


def _pose_times(wheels: Wheels, inertial: Inertial | None) -> FloatArray:
    """Return times (N,) of poses over the time that wheels and gyro share [s]."""
    spans = [one.time_s[[0, -1]] for one in (wheels, inertial) if one is not None]
    first_s, last_s = max(span[0] for span in spans), min(span[1] for span in spans)
    if last_s - first_s < 2.0 * _STEP_S:
        raise InputError(
            f"wheels and inertial readings share {max(last_s - first_s, 0.0):.1f} s, too little for a path; put both on one clock."
        )
    n = int((last_s - first_s) / _STEP_S)
    times: FloatArray = np.linspace(first_s, last_s, n + 1)
    return times


def _gyro_errors_rad(time_s: FloatArray, bias_sigma_rad_s: float) -> FloatArray:
    """Return errors of the turns (N - 1,) whose variances sum to that of a constant bias [rad]."""
    since_s = time_s - time_s[0]
    errors: FloatArray = bias_sigma_rad_s * np.sqrt(np.diff(since_s**2))
    return errors


def _turns_by_course(gps: GpsFixes | None, wheels: Wheels, time_s: FloatArray) -> list[FloatArray]:
    """Return the turns (N - 1, 3, 3) of the course of the fixes, from some metres before each pose to as many after it."""
    if gps is None:
        raise InputError(
            "the recording has wheels, and neither images, a gyro nor fixes, so that nothing shows its turns; record one of them too."
        )
    rolled = np.interp(time_s, wheels.time_s, 0.5 * (wheels.left_m + wheels.right_m))
    travel = np.append(0.0, np.cumsum(np.abs(np.diff(rolled)))) + 1e-6 * np.arange(len(time_s))
    ends_s = [np.interp(travel + half_m, travel, time_s) for half_m in (-0.5 * _COURSE_M, 0.5 * _COURSE_M)]
    before, after = (
        np.column_stack([np.interp(end_s, gps.time_s, axis) for axis in gps.position[:, :2].T])
        for end_s in ends_s
    )
    ahead = after - before
    course = Rotation.from_euler("z", np.arctan2(ahead[:, 1], ahead[:, 0])[:, None])
    return list((course[:-1].inv() * course[1:]).as_matrix())
