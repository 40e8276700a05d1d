"""Triangulation of landmarks from finished tracks."""

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.camera.calibration import Camera
from survey.data.sensors.sightings import Sightings
from vision_slam.odometry.config import VisualOdometryConfig
from vision_slam.odometry.tracks import Track

_LEAST_SIGHTS = 4
_GREATEST_RANGE_M = 60.0
_GREATEST_ERROR_PX = 1.5


class LandmarkTriangulator:
    """Triangulation of tracks with enough near observations, relative to the body at the last keyframe.

    Its covariance is that of pixels and of poses together, since the poses within the
    window are themselves estimates: with Λ = Σ JᵀJ the information of the rays about the
    place, σ the pixel's angle, o the arm from the body, φ the attitude error between the
    poses and s that of the window's scale,

        C = (k σ)² Λ⁻¹ + φ² (|o|² I − o oᵀ) + s² o oᵀ + f² I

    where k, φ, s and the floor f are those of `VisualOdometryConfig`, calibrated on a drive
    over ground that is known. A landmark's error is not independent of its neighbours'.
    """

    def __init__(self, camera: Camera, config: VisualOdometryConfig) -> None:
        self._T_body_camera, self._config = camera.T_body_camera, config
        self._focal_px = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])
        self.pixel_sigma = config.pixel_sigma
        self._frame: list[int] = []
        self._offset: list[FloatArray] = []
        self._covariance: list[FloatArray] = []
        self._range_m: list[float] = []

    def add(self, tracks: list[Track], poses: list[FloatArray], frame_of: dict[int, int]) -> None:
        """Triangulate tracks; `frame_of` gives the first frame of each keyframe."""
        near = [track for track in tracks if not track.is_far and len(track.rays) >= _LEAST_SIGHTS]
        if not near:
            return
        points, information, error, is_good = intersected(*self._sights(near, poses))
        is_good &= error <= _GREATEST_ERROR_PX / self._focal_px
        for index in np.flatnonzero(is_good).tolist():
            first, last = (poses[near[index].keyframes[end]] for end in (0, -1))
            range_m = float(np.linalg.norm(points[index] - first[:3, 3]))
            if range_m > _GREATEST_RANGE_M:
                continue
            arm = last[:3, :3].T @ (points[index] - last[:3, 3])
            self._frame.append(frame_of[near[index].keyframes[-1]])
            self._offset.append(arm)
            self._covariance.append(
                self._own(information[index], last[:3, :3]) + _of_poses(arm, self._config)
            )
            self._range_m.append(range_m)

    def _sights(
        self, tracks: list[Track], poses: list[FloatArray]
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the rays (T, N, 3) of tracks in the window's frame, where they begin, and which there are."""
        shape = len(tracks), max(len(track.rays) for track in tracks)
        rays, places, there = np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=np.bool_)
        rays[..., 2] = 1.0
        eyes = {k: poses[k] @ self._T_body_camera for k in {k for track in tracks for k in track.keyframes}}
        for row, track in enumerate(tracks):
            eye = np.array([eyes[k] for k in track.keyframes])
            rays[row, : len(eye)] = np.einsum("nij,nj->ni", eye[:, :3, :3], np.array(track.rays))
            places[row, : len(eye)], there[row, : len(eye)] = eye[:, :3, 3], True
        return rays, places, there

    def _own(self, information: FloatArray, turn: FloatArray) -> FloatArray:
        """Return the covariance (3, 3) that pixels alone give, in the body frame [m²]."""
        sigma = self._config.landmark_pixel_factor * self.pixel_sigma / self._focal_px
        own: FloatArray = sigma**2 * (turn.T @ np.linalg.inv(information) @ turn)
        return own

    @property
    def sightings(self) -> Sightings:
        """All of them."""
        return Sightings(
            np.array(self._frame, dtype=np.int64),
            np.array(self._offset).reshape(-1, 3),
            np.array(self._covariance).reshape(-1, 3, 3),
            np.array(self._range_m),
        )


def _of_poses(arm: FloatArray, config: VisualOdometryConfig) -> FloatArray:
    along = np.outer(arm, arm)
    across = (arm @ arm) * np.eye(3) - along
    spread: FloatArray = (
        np.radians(config.landmark_attitude_deg) ** 2 * across + config.landmark_scale_sigma**2 * along
    )
    return spread + config.landmark_floor_m**2 * np.eye(3)


def intersected(
    rays: FloatArray, places: FloatArray, there: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Intersect the rays (T, N, 3) of each track that are `there` (T, N).

    Returns the point (T, 3) nearest to all rays by angle, the information of its place
    (T, 3, 3) [1/m² per rad²], the RMS angle [rad], and which of them are points at all.
    """
    across = np.eye(3) - rays[..., :, None] * rays[..., None, :]
    is_good, weight = np.ones(len(rays), dtype=np.bool_), there.astype(np.float64)
    for _ in range(3):
        normal = np.einsum("tn,tnij->tij", weight, across)
        is_good &= np.linalg.det(normal) >= 1e-12 * np.trace(normal, axis1=1, axis2=2) ** 3
        normal[~is_good] = np.eye(3)
        right = np.einsum("tn,tni->ti", weight, np.einsum("tnij,tnj->tni", across, places))
        point = np.linalg.solve(normal, right[..., None])[..., 0]
        gap = point[:, None] - places
        distance = np.linalg.norm(gap, axis=2)
        is_good &= np.where(there, distance, np.inf).min(axis=1) >= 0.1
        distance = np.maximum(distance, 1e-9)
        weight = there / distance**2
    information = np.einsum("tn,tnij->tij", weight, across)
    is_good &= np.linalg.eigvalsh(information)[:, 0] > 0.0
    is_good &= np.where(there, (gap * rays).sum(axis=2), np.inf).min(axis=1) >= 0.0
    error = np.einsum("tnij,tnj->tni", across, gap) / distance[..., None]
    squares = np.where(there, (error**2).sum(axis=2), 0.0).sum(axis=1)
    return point, information, np.sqrt(squares / there.sum(axis=1)), is_good
