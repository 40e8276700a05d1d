"""Monocular odometry of OpenCV's functions alone: corners, Lucas-Kanade, essential matrix, resection.

What a careful user writes in an afternoon: no bundle adjustment, no loop closure. Corners are tracked from image to image,
forward and back; the essential matrix gives the first step, and resection of the triangulated corners each pose after it.
"""

import cv2
import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.camera import Camera
from survey.data.frames import Image

_N_CORNERS, _APART_PX, _BACK_PX = 1500, 8.0, 0.7
_FIRST_FLOW_PX, _KEY_FLOW_PX, _LEAST_INLIERS = 15.0, 20.0, 15
_GATE_PX, _LEAST_ANGLE_RAD = 1.5, np.radians(0.4)


class OpenCvOdometry:
    """Odometry that is given one image after the other."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self._focal_px = camera, float(camera.matrix[0, 0])
        self._image: Image | None = None
        self._uv = np.zeros((0, 2), np.float32)  # tracked corners, where the key image had them, and their points
        self._key, self._points = np.zeros((0, 2)), np.zeros((0, 3))
        self._key_pose, self._pose, self._has_scale = np.eye(4), np.eye(4), False

    def add(self, image: Image) -> FloatArray | None:
        """Return the pose (4, 4) of the camera at an image in the frame of the first; None where it is lost."""
        if self._image is not None:
            self._track(image)
        had_scale, self._image = self._has_scale, image
        found = self._resected() if had_scale else self._first_step()
        flow = np.linalg.norm(self._plane(self._uv) - self._key, axis=1) * self._focal_px
        is_due = len(flow) < _N_CORNERS // 3 or float(np.median(flow)) > _KEY_FLOW_PX
        if not len(self._key) or (self._has_scale and found and (is_due or not had_scale)):
            self._make_key(image)
        return self._pose.copy() if found else None

    def _plane(self, uv: FloatArray) -> FloatArray:
        """Project pixels (N, 2) onto the plane at distance 1."""
        rays = self._camera.rays(np.asarray(uv, dtype=np.float64).reshape(-1, 2))
        return rays[:, :2] / rays[:, 2:]

    def _keep(self, stays: BoolArray) -> None:
        self._uv, self._key, self._points = self._uv[stays], self._key[stays], self._points[stays]

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
        if not len(here) or np.median(np.linalg.norm(here - self._key, axis=1)) * self._focal_px < _FIRST_FLOW_PX:
            return True
        gate = {"prob": 0.999, "threshold": _GATE_PX / self._focal_px}
        essential, inlier = cv2.findEssentialMat(self._key, here, np.eye(3), cv2.RANSAC, **gate)
        _, turn, step, _ = cv2.recoverPose(essential, self._key, here, np.eye(3), mask=inlier)
        self._pose = np.linalg.inv(np.vstack([np.hstack([turn, step]), [0.0, 0.0, 0.0, 1.0]]))
        self._keep(inlier.ravel().astype(bool))
        self._has_scale = True
        return True

    def _resected(self) -> bool:
        """Resect the pose from the corners that have points; a pose that is lost stays where it was."""
        known = np.isfinite(self._points[:, 0])
        if known.sum() < _LEAST_INLIERS:
            return False
        here, turned = self._plane(self._uv[known]), np.linalg.inv(self._pose)
        start = cv2.Rodrigues(turned[:3, :3])[0], turned[:3, 3:].copy()
        limits = {"reprojectionError": _GATE_PX / self._focal_px, "iterationsCount": 200, "confidence": 0.999}
        found, turn, step, inliers = cv2.solvePnPRansac(
            self._points[known], here, np.eye(3), None, *start, useExtrinsicGuess=True, **limits
        )
        if not found or inliers is None or len(inliers) < _LEAST_INLIERS:
            return False
        chosen = inliers.ravel()
        turn, step = cv2.solvePnPRefineLM(self._points[known][chosen], here[chosen], np.eye(3), None, turn, step)
        self._pose = np.linalg.inv(np.vstack([np.hstack([cv2.Rodrigues(turn)[0], step]), [0.0, 0.0, 0.0, 1.0]]))
        stays = ~known
        stays[np.flatnonzero(known)[chosen]] = True
        self._keep(stays)
        return True

    def _make_key(self, image: Image) -> None:
        """Triangulate the corners between the key image and this one, then take this one as key image, with new corners."""
        self._triangulate()
        mask = np.full(image.shape, 255, np.uint8)
        for u, v in self._uv.round().astype(int):
            cv2.circle(mask, (int(u), int(v)), int(_APART_PX), 0, -1)
        fresh = cv2.goodFeaturesToTrack(image, max(_N_CORNERS - len(self._uv), 1), 0.005, _APART_PX, mask=mask)
        more = np.zeros((0, 2), np.float32) if fresh is None else fresh.reshape(-1, 2)
        self._uv = np.vstack([self._uv, more]).astype(np.float32)
        self._points = np.vstack([self._points, np.full((len(more), 3), np.nan)])
        self._key, self._key_pose = self._plane(self._uv), self._pose.copy()

    def _triangulate(self) -> None:
        """Give points to corners without one that have moved enough, where both images agree with them."""
        chosen = np.flatnonzero(~np.isfinite(self._points[:, 0]))
        if not self._has_scale or not len(chosen):
            return
        here, key = self._plane(self._uv[chosen]), self._key[chosen]
        views = [np.linalg.inv(pose)[:3] for pose in (self._key_pose, self._pose)]
        homogeneous = cv2.triangulatePoints(*views, key.T, here.T)
        points = (homogeneous[:3] / homogeneous[3]).T
        good = np.ones(len(points), dtype=bool)
        for view, plane in zip(views, (key, here), strict=True):
            local = points @ view[:, :3].T + view[:, 3]
            off = np.linalg.norm(local[:, :2] / local[:, 2:] - plane, axis=1) * self._focal_px
            good &= (local[:, 2] > 0.0) & (off < _GATE_PX)
        rays = [points - pose[:3, 3] for pose in (self._key_pose, self._pose)]
        across = np.linalg.norm(np.cross(*rays), axis=1) / np.prod([np.linalg.norm(r, axis=1) for r in rays], axis=0)
        good &= across > np.sin(_LEAST_ANGLE_RAD)
        self._points[chosen[good]] = points[good]
