"""Tracking of corners from image to image by pyramidal Lucas-Kanade."""

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.camera.frames import Image
from vision_slam.odometry.config import VisualOdometryConfig
from vision_slam.odometry.features import Pixels

_LEAST_RAYS = 5


@dataclass
class Track:
    """One corner: where the keyframes saw it, and the point that it is.

    ``rays[i]`` is the unit direction in the camera frame of keyframe ``keyframes[i]``;
    ``point`` (3,) its place in the window's frame, None while unknown; ``is_far`` when no
    motion so far has moved it, so that only its direction counts; ``has_moved`` when its
    direction changed by more than its error explains, so that it is not far. ``rest_pixel``
    is where it was in the last image that moved; ``planes[i]`` (2,) is where ``rays[i]`` meets z = 1.
    """

    pixel: FloatArray
    keyframes: list[int] = field(default_factory=list)
    rays: list[FloatArray] = field(default_factory=list)
    point: FloatArray | None = None
    is_far: bool = False
    has_moved: bool = False
    rest_pixel: FloatArray = field(init=False)
    planes: list[FloatArray] = field(init=False)

    def __post_init__(self) -> None:
        self.rest_pixel = self.pixel
        self.planes = [ray[:2] / ray[2] for ray in self.rays]

    def add_observation(self, keyframe: int, ray: FloatArray) -> None:
        """Add an observation from a keyframe."""
        self.keyframes.append(keyframe)
        self.rays.append(ray)
        self.planes.append(ray[:2] / ray[2])


def track_corners(
    before: Image, now: Image, pixels: Pixels, guess: Pixels, config: VisualOdometryConfig
) -> tuple[Pixels, BoolArray]:
    """Track corners (N, 2) by pyramidal Lucas-Kanade from a guess, with a forward-backward check.

    Returns their new pixels and which passed the check inside the image.
    """
    if len(pixels) == 0:
        return pixels, np.zeros(0, dtype=bool)
    ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01)
    start = np.ascontiguousarray(guess, dtype=np.float32)
    forth, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, pixels, start, winSize=(17, 17), maxLevel=3, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=ends, minEigThreshold=1e-5,
    )  # fmt: skip
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(
        now, before, forth, pixels.copy(), winSize=(17, 17), maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=ends, minEigThreshold=1e-5,
    )  # fmt: skip
    height, width = now.shape
    margin = 5.0
    landed: Pixels = np.asarray(forth, dtype=np.float32)
    inside = ((landed > margin) & (landed < np.array([width, height]) - 1 - margin)).all(axis=1)
    came_back = np.linalg.norm(back - pixels, axis=1) < config.round_trip_px
    return landed, (found.ravel() > 0) & (found_back.ravel() > 0) & came_back & inside


def epipolar_motion(before: FloatArray, now: FloatArray, angle: float) -> tuple[FloatArray, BoolArray]:
    """Return the motion (4, 4) of the camera by one unit that unit rays (N, 3) fit within an angle [rad], and which do (RANSAC).

    The motion takes coordinates of the camera after it to those before it; the identity where there is none.
    """
    first, second = (np.ascontiguousarray(rays[:, :2] / rays[:, 2:]) for rays in (before, now))
    cv2.setRNGSeed(0)  # RANSAC draws; the same images shall give the same bytes
    found: Any = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.999, angle)
    mask = found[1]
    motion = np.eye(4)
    if mask is None:
        return motion, np.zeros(len(before), dtype=bool)
    agree: BoolArray = mask.ravel() > 0
    _, turn, shift, _ = cv2.recoverPose(found[0][:3], first, second, np.eye(3), mask=mask.copy())
    motion[:3, :3], motion[:3, 3] = turn.T, -turn.T @ shift.ravel()
    return motion, agree


def rotation_between(before: FloatArray, now: FloatArray, angle: float) -> tuple[FloatArray, BoolArray]:
    """Return the rotation R (3, 3) with before ≈ R now of unit rays (N, 3), and which fit it within an angle [rad].

    Least squares by singular value decomposition, repeated over the inliers of a gate that narrows.
    """
    rotation, agree = np.eye(3), np.ones(len(before), dtype=np.bool_)
    for width in (16.0, 8.0, 4.0, 2.0, 1.0, 1.0):
        if agree.sum() >= _LEAST_RAYS:
            left, _, right = np.linalg.svd(before[agree].T @ now[agree])
            rotation = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        agree = np.linalg.norm(before - now @ rotation.T, axis=1) < width * angle
    return rotation, agree


def quadrant_shift_px(before: Pixels, now: Pixels, size: tuple[int, int]) -> float:
    """Return the largest median shift of corners (N, 2) in a quadrant of an image of a size (width, height) [pixels]."""
    right, below = (before >= 0.5 * np.array(size)).T
    shifts = [0.0]
    for index in range(4):
        inside = 2 * right + below == index
        if inside.sum() >= _LEAST_RAYS:
            shifts.append(float(np.linalg.norm(np.median((now - before)[inside], axis=0))))
    return max(shifts)
