"""Monocular odometry of OpenCV's functions alone: corners, Lucas-Kanade, essential matrix, resection.

What a careful user writes in an afternoon: no bundle adjustment, no loop closure. Corners are tracked from image to image,
forward and back. The essential matrix gives the first step, and resection each pose after it; a corner gets its point
once it is seen from two directions.
"""

import cv2
import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.camera import Camera
from survey.data.frames import Image

_N_CORNERS, _APART_PX, _BACK_PX = 1200, 8.0, 0.7
_PALE = 30.0  # standard deviation of grey values below which contrast is enhanced
_FIRST_FLOW_PX, _LEAST_INLIERS, _GATE_PX = 15.0, 15, 1.5
_LEAST_ANGLE_RAD, _LEAST_TRIANGULATED = np.radians(1.0), 60


class OpenCvOdometry:
    """Odometry that is given one image after the other."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self._focal_px = camera, float(camera.matrix[0, 0])
        self._image: Image | None = None
        self._clahe = cv2.createCLAHE(4.0, (8, 8))
        self._pose, self._has_scale = np.eye(4), False
        # Of each corner: where it is [pixels], its first ray and the pose it was seen from, and its point.
        self._uv, self._first = np.zeros((0, 2), np.float32), np.zeros((0, 2))
        self._seen_from, self._points = np.zeros((0, 4, 4)), np.zeros((0, 3))

    def add(self, image: Image) -> FloatArray | None:
        """Return the pose (4, 4) of the camera at an image in the frame of the first; None where it is lost."""
        if image.std() < _PALE:
            image = self._clahe.apply(image)
        if self._image is not None and len(self._uv):
            self._track(image)
        self._image = image
        found = self._resected() if self._has_scale else self._first_step()
        if found and self._has_scale:
            self._triangulate()
        if found and (self._has_scale or not len(self._uv)) and len(self._uv) < 0.8 * _N_CORNERS:
            self._add_corners(image)
        return self._pose.copy() if found else None

    def _plane(self, uv: FloatArray) -> FloatArray:
        """Project pixels (N, 2) onto the plane at distance 1."""
        rays = self._camera.rays(np.asarray(uv, dtype=np.float64).reshape(-1, 2))
        return rays[:, :2] / rays[:, 2:]

    def _keep(self, stays: BoolArray) -> None:
        self._uv, self._first = self._uv[stays], self._first[stays]
        self._seen_from, self._points = self._seen_from[stays], self._points[stays]

    def _track(self, image: Image) -> None:
        """Follow the corners forward and back, and drop those that do not return."""
        assert self._image is not None
        there, seen, _ = cv2.calcOpticalFlowPyrLK(self._image, image, self._uv, None, winSize=(21, 21))
        back, again, _ = cv2.calcOpticalFlowPyrLK(image, self._image, there, None, winSize=(21, 21))
        stays = (seen & again).ravel().astype(bool) & (np.linalg.norm(back - self._uv, axis=1) < _BACK_PX)
        self._uv = there
        self._keep(stays)

    def _first_step(self) -> bool:
        """Take the pose from the essential matrix once the corners have moved."""
        here = self._plane(self._uv)
        moved_px = np.linalg.norm(here - self._first, axis=1) * self._focal_px
        if not len(here) or np.median(moved_px) < _FIRST_FLOW_PX:
            return True
        gate = {"prob": 0.999, "threshold": _GATE_PX / self._focal_px}
        essential, inlier = cv2.findEssentialMat(self._first, here, np.eye(3), cv2.RANSAC, **gate)
        _, turn, step, _ = cv2.recoverPose(essential, self._first, here, np.eye(3), mask=inlier)
        self._pose = _inverse_pose(turn, step)
        self._triangulate()
        self._has_scale = int(np.isfinite(self._points[:, 0]).sum()) > _LEAST_TRIANGULATED
        if not self._has_scale:
            self._pose, self._points[:] = np.eye(4), np.nan
            return True
        self._keep(inlier.ravel().astype(bool))
        return True

    def _resected(self) -> bool:
        """Resect the pose from the corners that have points; a pose that is lost stays where it was."""
        known = np.flatnonzero(np.isfinite(self._points[:, 0]))
        if len(known) < _LEAST_INLIERS:
            return False
        here, points, view = self._plane(self._uv[known]), self._points[known], np.linalg.inv(self._pose)
        start = cv2.Rodrigues(view[:3, :3])[0], view[:3, 3:].copy()
        limits = {"reprojectionError": _GATE_PX / self._focal_px, "iterationsCount": 200, "confidence": 0.999}
        found, turn, step, inliers = cv2.solvePnPRansac(
            points, here, np.eye(3), None, *start, useExtrinsicGuess=True, **limits
        )
        if not found or inliers is None or len(inliers) < _LEAST_INLIERS:
            return False
        chosen = inliers.ravel()
        turn, step = cv2.solvePnPRefineLM(points[chosen], here[chosen], np.eye(3), None, turn, step)
        self._pose = _inverse_pose(cv2.Rodrigues(turn)[0], step)
        stays = np.ones(len(self._uv), dtype=bool)
        stays[np.delete(known, chosen)] = False
        self._keep(stays)
        return True

    def _triangulate(self) -> None:
        """Give points to corners without one that are seen from two directions: the middle between both rays."""
        new = np.flatnonzero(~np.isfinite(self._points[:, 0]))
        before, now = self._seen_from[new], self._pose
        one = np.einsum("nij,nj->ni", before[:, :3, :3], _unit(self._first[new]))
        two = _unit(self._plane(self._uv[new])) @ now[:3, :3].T
        apart, cosine = now[:3, 3] - before[:, :3, 3], np.einsum("ni,ni->n", one, two)
        sine2 = np.maximum(1.0 - cosine**2, 1e-12)
        along_one, along_two = (np.einsum("ni,ni->n", ray, apart) for ray in (one, two))
        far_one, far_two = (along_one - cosine * along_two) / sine2, (cosine * along_one - along_two) / sine2
        ends = before[:, :3, 3] + far_one[:, None] * one, now[:3, 3] + far_two[:, None] * two
        off_px = np.linalg.norm(ends[0] - ends[1], axis=1) / np.maximum(far_two, 1e-9) * self._focal_px
        good = (
            (sine2 > np.sin(_LEAST_ANGLE_RAD) ** 2) & (far_one > 0.0) & (far_two > 0.0) & (off_px < _GATE_PX)
        )
        self._points[new[good]] = 0.5 * (ends[0] + ends[1])[good]

    def _add_corners(self, image: Image) -> None:
        """Add corners where there are none."""
        mask = np.full(image.shape, 255, np.uint8)
        for u, v in self._uv.round().astype(int).tolist():
            cv2.circle(mask, (u, v), int(_APART_PX), 0, -1)
        fresh = cv2.goodFeaturesToTrack(image, _N_CORNERS - len(self._uv), 0.005, _APART_PX, mask=mask)
        more = np.zeros((0, 2), np.float32) if fresh is None else fresh.reshape(-1, 2)
        self._uv, self._first = np.vstack([self._uv, more]), np.vstack([self._first, self._plane(more)])
        self._seen_from = np.concatenate([self._seen_from, np.tile(self._pose, (len(more), 1, 1))])
        self._points = np.vstack([self._points, np.full((len(more), 3), np.nan)])


def _unit(plane: FloatArray) -> FloatArray:
    """Return the unit vectors (N, 3) of rays (N, 2)."""
    rays = np.column_stack([plane, np.ones(len(plane))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _inverse_pose(turn: FloatArray, step: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a camera from the rotation and translation that take points into it."""
    return np.asarray(np.linalg.inv(np.vstack([np.hstack([turn, step]), [0.0, 0.0, 0.0, 1.0]])))
