"""Landmarks: tracks that have ended become places beside the pose that saw them last."""

import numpy as np

from survey.arrays import FloatArray
from survey.camera import Camera
from survey.sensors import Sightings
from vision_slam.tracks import Track
from vision_slam.visual_config import VisualOdometryConfig

_LEAST_SIGHTS = 4
_GREATEST_RANGE_M = 60.0
_GREATEST_ERROR_PX = 1.5


class Landmarks:
    """Triangulates every track that was seen often and near enough, relative to its last keyframe's body.

    Its covariance is that of pixels and of poses together, since the poses within the
    window are themselves estimates: with Λ = Σ JᵀJ the information of the rays about the
    place, σ the pixel's angle, o the arm from the body, φ the attitude error between the
    poses and s that of the window's scale,

        C = (k σ)² Λ⁻¹ + φ² (|o|² I − o oᵀ) + s² o oᵀ + f² I

    where k, φ, s and the floor f are those of `VisualOdometryConfig`, calibrated on a drive
    over ground that is known. A landmark's error is not independent of its neighbours'.
    """

    def __init__(self, camera: Camera, config: VisualOdometryConfig) -> None:
        self._camera, self._config = camera, config
        self._focal_px = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])
        self._frame: list[int] = []
        self._offset: list[FloatArray] = []
        self._covariance: list[FloatArray] = []
        self._range_m: list[float] = []

    def add(self, tracks: list[Track], poses: list[FloatArray], frame_of: dict[int, int]) -> None:
        """Place tracks whose keyframes have these poses; `frame_of` tells the first frame of each keyframe."""
        config, angle_sigma = self._config, self._config.pixel_sigma / self._focal_px
        for track in tracks:
            if track.is_far or len(track.rays) < _LEAST_SIGHTS:
                continue
            seen = _intersected(track, poses, self._camera)
            if seen is None or seen[2] > _GREATEST_ERROR_PX / self._focal_px:
                continue
            point, information, _ = seen
            first, last = poses[track.keyframes[0]], poses[track.keyframes[-1]]
            arm = last[:3, :3].T @ (point - last[:3, 3])
            range_m = float(np.linalg.norm(point - first[:3, 3]))
            if range_m > _GREATEST_RANGE_M:
                continue
            own = last[:3, :3].T @ np.linalg.inv(information) @ last[:3, :3]
            own *= (config.landmark_pixel_factor * angle_sigma) ** 2
            self._frame.append(frame_of[track.keyframes[-1]])
            self._offset.append(arm)
            self._covariance.append(own + _of_poses(arm, config))
            self._range_m.append(range_m)

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


def _intersected(
    track: Track, poses: list[FloatArray], camera: Camera
) -> tuple[FloatArray, FloatArray, float] | None:
    """Point nearest to all rays by angle, information of its place [1/m² per rad²], RMS angle [rad]."""
    eyes = [poses[k] @ camera.T_body_camera for k in track.keyframes]
    rays = np.array([eye[:3, :3] @ ray for eye, ray in zip(eyes, track.rays, strict=True)])
    places = np.array([eye[:3, 3] for eye in eyes])
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    weight = np.ones(len(rays))
    for _ in range(3):
        normal = np.einsum("n,nij->ij", weight, across)
        if np.linalg.det(normal) < 1e-12 * np.trace(normal) ** 3:
            return None
        point = np.linalg.solve(normal, np.einsum("n,nij,nj->i", weight, across, places))
        distance = np.linalg.norm(point - places, axis=1)
        if distance.min() < 0.1:
            return None
        weight = 1.0 / distance**2
    information = np.einsum("n,nij->ij", weight, across)
    if np.linalg.eigvalsh(information)[0] <= 0.0 or ((point - places) * rays).sum(axis=1).min() < 0.0:
        return None
    error = np.einsum("nij,nj->ni", across, point - places) / distance[:, None]
    return point, information, float(np.sqrt(np.mean((error**2).sum(axis=1))))
