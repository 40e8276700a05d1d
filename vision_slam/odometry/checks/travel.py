"""Check of mounting and wheels: the direction in which the camera travels while the wheels roll."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames
from survey.data.sensors.aiding import Wheels
from vision_slam.odometry.checks.turns import (
    LEAST_AGREE,
    LEAST_CORNERS,
    image_pairs,
    ray_error_rad,
    tracked_rays,
)
from vision_slam.odometry.config import VisualOdometryConfig
from vision_slam.odometry.tracks import epipolar_motion

_MOST_PAIRS, _LEAST_PAIRS = 12, 8
_LEAST_M, _LEAST_SHARE = 0.05, 0.3  # between two images, also of the most between any two
_STRAIGHT = 0.1  # of the travel: the most that left and right differ by
# Cosines: pairs of images that agree with their median, how many must, and what a mounting may be off by.
_ALIKE, _MANY, _AHEAD = 0.8, 0.8, np.cos(np.radians(30.0))
_SIDES = (("ahead", "backward"), ("to the left", "to the right"), ("up", "down"))


def refuse_other_travel(frames: Frames, camera: Camera, wheels: Wheels, config: VisualOdometryConfig) -> None:
    """Refuse wheels and a mounting with which the images do not travel ahead while the wheels roll ahead.

    The direction of travel is that of the epipolar geometry of pairs of images between which the wheels roll straight. Fewer
    than eight such pairs, or pairs that do not agree with each other, say nothing.

    Parameters
    ----------
    frames : Frames
        Images.
    camera : Camera
        Calibration and mounting.
    wheels : Wheels
        Distances rolled.
    config : VisualOdometryConfig
        Settings of contrast, detection and tracking.

    Raises
    ------
    InputError
        The images travel in a direction more than 30 degrees from ahead.
    """
    found = _directions(frames, camera, wheels, config)
    if len(found) < _LEAST_PAIRS:
        return
    median = np.median(found, axis=0)
    median /= max(float(np.linalg.norm(median)), 1e-9)
    n = int((found @ median > _ALIKE).sum())
    if n < _MANY * len(found) or median[0] > _AHEAD:
        return
    axis = int(np.argmax(np.abs(median)))
    side = _SIDES[axis][int(median[axis] < 0.0)]
    angle_deg = float(np.degrees(np.arccos(median[0])))
    wheels_remedy = "change the sign of left_m and right_m, or " if median[0] < -_AHEAD else ""
    raise InputError(
        f"while the wheels roll ahead the images travel {angle_deg:.0f}° from ahead, {side}, in {n} of {len(found)} pairs of "
        f"images; {wheels_remedy}correct T_body_camera of the camera, which takes x right, y down, z forward of the camera "
        "to x forward, y left, z up of the body."
    )


def _directions(frames: Frames, camera: Camera, wheels: Wheels, config: VisualOdometryConfig) -> FloatArray:
    """Return the directions (N, 3) of travel in the body, for wheels that roll ahead."""
    found = []
    for first, last, sign in _straight_pairs(frames.time_s, wheels):
        rays = tracked_rays(camera, frames[first], frames[last], config)
        if rays is None:
            continue
        motion, agree = epipolar_motion(*rays, ray_error_rad(camera))
        if agree.sum() >= max(LEAST_CORNERS, LEAST_AGREE * len(agree)):
            found.append(sign * camera.T_body_camera[:3, :3] @ motion[:3, 3])
    return np.array(found).reshape(-1, 3)


def _straight_pairs(time_s: FloatArray, wheels: Wheels) -> list[tuple[int, int, float]]:
    """Return pairs of images between which the wheels roll straight, and the sign of their travel."""
    pairs = np.array(image_pairs(time_s), dtype=int).reshape(-1, 2)
    left, right = (np.interp(time_s, wheels.time_s, side) for side in (wheels.left_m, wheels.right_m))
    left, right = (side[pairs[:, 1]] - side[pairs[:, 0]] for side in (left, right))
    rolled = np.abs(0.5 * (left + right))
    least_m = max(_LEAST_M, _LEAST_SHARE * float(rolled.max(initial=0.0)))
    straight = np.flatnonzero((rolled >= least_m) & (np.abs(right - left) < _STRAIGHT * rolled))
    if len(straight) == 0:
        return []
    chosen = straight[np.unique(np.linspace(0, len(straight) - 1, _MOST_PAIRS).astype(int))]
    return [(*pairs[k].tolist(), float(np.sign(left[k] + right[k]))) for k in chosen]
