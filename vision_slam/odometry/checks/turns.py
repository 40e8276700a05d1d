"""Turns between images by the images alone, beside those by the gyro."""

from typing import Any, NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames, Image
from survey.data.sensors.aiding import Inertial
from vision_slam.odometry.clahe import ContrastEnhancer, grey_of
from vision_slam.odometry.config import VisualOdometryConfig
from vision_slam.odometry.features import detect
from vision_slam.odometry.tracks import track_corners

_LEAST_S, _MOST_S = 0.2, 1.5  # between two images; a faster camera turns too little from image to image
_PER_SIDE = 6  # pairs of images with the largest turns to either side about each axis
LEAST_CORNERS, LEAST_AGREE = 25, 0.5
"""Corners that must be tracked, and the share of them that must agree with one motion."""
# Cosine of the angle to the optical axis beyond which a corner has no place on the plane z = 1.
_LEAST_AHEAD = 0.2
_MOST_TRIALS = 300  # of RANSAC: images of noise shall cost little


class ImageTurns(NamedTuple):
    """Turns of the body between pairs of images.

    ``seconds`` (N,), ``by_images`` and ``by_gyro`` (N, 3) rotation vectors in axes of the body [rad].
    """

    seconds: FloatArray
    by_images: FloatArray
    by_gyro: FloatArray


def largest_turns(
    frames: Frames, camera: Camera, inertial: Inertial, config: VisualOdometryConfig
) -> ImageTurns:
    """Return the turns of the pairs of images between which the gyro turns most, about each axis to either side.

    Corners are tracked without any prediction; their epipolar geometry gives the turn. Pairs of the same image, and those
    of which too few corners agree, are left out.

    Parameters
    ----------
    frames : Frames
        Images.
    camera : Camera
        Calibration and mounting.
    inertial : Inertial
        Readings of the gyro in the axes of the body.
    config : VisualOdometryConfig
        Settings of contrast, detection and tracking.

    Returns
    -------
    ImageTurns
        Of at most 36 pairs; none where the readings cover no images.
    """
    mount = Rotation.from_matrix(camera.T_body_camera[:3, :3])
    rows = []
    for first, last, by_gyro in _chosen(_gyro_turns(frames.time_s, inertial)):
        rays = tracked_rays(camera, frames[first], frames[last], config)
        turn = None if rays is None else _turn_between(*rays, ray_error_rad(camera))
        if turn is not None:
            seconds = float(frames.time_s[last] - frames.time_s[first])
            rows.append((seconds, (mount * turn * mount.inv()).as_rotvec(), by_gyro))
    columns = list(zip(*rows, strict=True)) or [(), (), ()]
    return ImageTurns(np.array(columns[0]), *(np.array(part).reshape(-1, 3) for part in columns[1:]))


def tracked_rays(
    camera: Camera, before: Image, now: Image, config: VisualOdometryConfig
) -> tuple[FloatArray, FloatArray] | None:
    """Return the unit rays (N, 3) of corners that are tracked from one image to another without any prediction.

    None for the same image twice, and for fewer than 25 corners.
    """
    first, second = (grey_of(image, camera.width, camera.height) for image in (before, now))
    if np.array_equal(first, second):
        return None
    enhance = ContrastEnhancer(config.clahe_clip, config.clahe_tiles)
    first, second = enhance(first), enhance(second)
    pixels = detect(first, np.zeros((0, 2), np.float32), config.n_features, config)
    landed, came = track_corners(first, second, pixels, pixels.copy(), config)
    rays = [camera.rays(at[came].astype(np.float64)) for at in (pixels, landed)]
    is_ahead = (rays[0][:, 2] > _LEAST_AHEAD) & (rays[1][:, 2] > _LEAST_AHEAD)
    return (rays[0][is_ahead], rays[1][is_ahead]) if is_ahead.sum() >= LEAST_CORNERS else None


def ray_error_rad(camera: Camera) -> float:
    """Return the angle of a pixel at the middle of the image [rad]."""
    return 2.0 / float(camera.matrix[0, 0] + camera.matrix[1, 1])


def image_pairs(time_s: FloatArray) -> list[tuple[int, int]]:
    """Return for each image the first one that is a fifth of a second or more later, where one is within 1.5 s."""
    ends = np.searchsorted(time_s, time_s + _LEAST_S - 1e-6).tolist()
    return [
        (first, end)
        for first, end in enumerate(ends)
        if end < len(time_s) and time_s[end] - time_s[first] <= _MOST_S
    ]


def _turn_between(before: FloatArray, now: FloatArray, angle: float) -> Rotation | None:
    """Return the turn of the camera by the epipolar geometry of rays (N, 3); None where too few agree.

    Of the two rotations that an essential matrix has, the other one includes half a turn.
    """
    first, second = (np.ascontiguousarray(rays[:, :2] / rays[:, 2:]) for rays in (before, now))
    cv2.setRNGSeed(0)  # RANSAC draws; the same images shall give the same result
    found: Any = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.999, angle, _MOST_TRIALS)
    if found[1] is None or found[1].sum() < max(LEAST_CORNERS, LEAST_AGREE * len(first)):
        return None
    both = [Rotation.from_matrix(turn.T) for turn in cv2.decomposeEssentialMat(found[0][:3])[:2]]
    return min(both, key=lambda turn: float(turn.magnitude()))


def _gyro_turns(time_s: FloatArray, inertial: Inertial) -> list[tuple[int, int, FloatArray]]:
    """Return pairs of images that the readings cover, and the integral of the gyro between them (3,) [rad].

    Each reading is the mean rate over the time before it. The integral has no full circles, which rates in degrees would make.
    """
    seconds = np.diff(inertial.time_s)[:, None]
    total = np.vstack([np.zeros(3), np.cumsum(inertial.gyro_rad_s[1:] * seconds, axis=0)])
    at = np.column_stack([np.interp(time_s, inertial.time_s, axis) for axis in total.T])
    is_covered = (time_s >= inertial.time_s[0]) & (time_s <= inertial.time_s[-1])
    return [
        (first, end, at[end] - at[first])
        for first, end in image_pairs(time_s)
        if is_covered[first] and is_covered[end]
    ]


def _chosen(pairs: list[tuple[int, int, FloatArray]]) -> list[tuple[int, int, FloatArray]]:
    """Return the pairs with the largest turns to either side about each axis, in the order of time."""
    if not pairs:
        return []
    order = np.argsort([turn for _, _, turn in pairs], axis=0, kind="stable")
    chosen = np.unique(np.r_[order[:_PER_SIDE], order[-_PER_SIDE:]])
    return [pairs[k] for k in chosen.tolist()]
