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
_LEAST_CORNERS, _LEAST_AGREE = 25, 0.5
_LEAST_AHEAD = (
    0.2  # cosine of the angle to the optical axis beyond which a corner has no place on the plane z = 1
)


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
    enhance = ContrastEnhancer(config.clahe_clip, config.clahe_tiles)
    mount = Rotation.from_matrix(camera.T_body_camera[:3, :3])
    rows = []
    for first, last, by_gyro in _chosen(_gyro_turns(frames.time_s, inertial)):
        before, now = (grey_of(frames[k], camera.width, camera.height) for k in (first, last))
        if np.array_equal(before, now):
            continue
        turn = turn_between(camera, enhance(before), enhance(now), config)
        if turn is not None:
            seconds = float(frames.time_s[last] - frames.time_s[first])
            rows.append((seconds, (mount * turn * mount.inv()).as_rotvec(), by_gyro))
    columns = list(zip(*rows, strict=True)) or [(), (), ()]
    return ImageTurns(np.array(columns[0]), *(np.array(part).reshape(-1, 3) for part in columns[1:]))


def turn_between(camera: Camera, before: Image, now: Image, config: VisualOdometryConfig) -> Rotation | None:
    """Return the turn of the camera between two images by their epipolar geometry; None where too few corners agree.

    Of the two rotations that an essential matrix has, the other one includes half a turn.
    """
    pixels = detect(before, np.zeros((0, 2), np.float32), config.n_features, config)
    landed, came = track_corners(before, now, pixels, pixels.copy(), config)
    rays = [camera.rays(at[came].astype(np.float64)) for at in (pixels, landed)]
    is_ahead = (rays[0][:, 2] > _LEAST_AHEAD) & (rays[1][:, 2] > _LEAST_AHEAD)
    first, second = (np.ascontiguousarray(ray[is_ahead, :2] / ray[is_ahead, 2:]) for ray in rays)
    if len(first) < _LEAST_CORNERS:
        return None
    cv2.setRNGSeed(0)  # RANSAC draws; the same images shall give the same result
    angle = 1.0 / (0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1]))
    found: Any = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.999, angle)
    if found[1] is None or found[1].sum() < max(_LEAST_CORNERS, _LEAST_AGREE * len(first)):
        return None
    both = [Rotation.from_matrix(turn.T) for turn in cv2.decomposeEssentialMat(found[0][:3])[:2]]
    return min(both, key=lambda turn: float(turn.magnitude()))


def _gyro_turns(time_s: FloatArray, inertial: Inertial) -> list[tuple[int, int, FloatArray]]:
    """Return pairs of images a fifth of a second or more apart, and the integral of the gyro between them (3,) [rad].

    Each reading is the mean rate over the time before it. The integral has no full circles, which rates in degrees would make.
    """
    seconds = np.diff(inertial.time_s)[:, None]
    total = np.vstack([np.zeros(3), np.cumsum(inertial.gyro_rad_s[1:] * seconds, axis=0)])
    at = np.column_stack([np.interp(time_s, inertial.time_s, axis) for axis in total.T])
    ends = np.searchsorted(time_s, time_s + _LEAST_S - 1e-6)
    first_s, last_s = inertial.time_s[[0, -1]]
    return [
        (first, end, at[end] - at[first])
        for first, end in enumerate(ends.tolist())
        if end < len(time_s)
        and first_s <= time_s[first]
        and time_s[end] <= min(last_s, time_s[first] + _MOST_S)
    ]


def _chosen(pairs: list[tuple[int, int, FloatArray]]) -> list[tuple[int, int, FloatArray]]:
    """Return the pairs with the largest turns to either side about each axis, in the order of time."""
    if not pairs:
        return []
    order = np.argsort([turn for _, _, turn in pairs], axis=0, kind="stable")
    chosen = np.unique(np.r_[order[:_PER_SIDE], order[-_PER_SIDE:]])
    return [pairs[k] for k in chosen.tolist()]
