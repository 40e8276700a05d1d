"""Landmarks: from sightings in the body frame to surface points in the world."""

import numpy as np

from survey.arrays import FloatArray, IntArray
from survey.errors import InputError
from survey.recording import Recording
from survey.surface_points import SurfacePoints
from vision_slam.config import LocalizationConfig
from vision_slam.rotation import rotations, turned
from vision_slam.smoother import SmoothedPath


def placed_landmarks(recording: Recording, path: SmoothedPath, config: LocalizationConfig) -> SurfacePoints:
    """Place the landmarks that pass the gates, with the covariance of sighting and path together.

    With R the attitude and o the offset in the body frame, the landmark is p + R o and
    its covariance R C Rᵀ + J P Jᵀ, J = [I, ∂(R o)/∂ψ, ∂(R o)/∂θ]; the roll, which no
    sensor here corrects, adds its own term.

    Raises
    ------
    InputError
        When no landmark passes the gates.
    """
    assert recording.sightings is not None
    sightings = recording.sightings
    ellipsoid_m = np.sqrt(np.linalg.eigvalsh(sightings.covariance)[:, -1])
    keep = (ellipsoid_m <= config.landmark_max_sigma_m) & (sightings.range_m > config.landmark_min_range_m)
    if not keep.any():
        raise InputError(
            f"none of {len(keep)} landmarks passes the gates (1σ ≤ {config.landmark_max_sigma_m} m, first seen beyond "
            f"{config.landmark_min_range_m} m); loosen localization.landmark_max_sigma_m or landmark_min_range_m."
        )
    pose = sightings.pose[keep]
    rotation = rotations(path.attitude_rad[pose])
    arm = np.einsum("nij,nj->ni", rotation, sightings.offset[keep])
    own = rotation @ sightings.covariance[keep] @ rotation.transpose(0, 2, 1)
    return SurfacePoints(
        path.position[pose] + arm,
        covariance=_symmetric(own + _from_path(path, pose, arm, rotation, config)),
        origins=path.position[pose],
        range_m=sightings.range_m[keep],
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
    )


def _from_path(
    path: SmoothedPath, pose: IntArray, arm: FloatArray, rotation: FloatArray, config: LocalizationConfig
) -> FloatArray:
    by_yaw, by_pitch = turned(arm, path.attitude_rad[pose, 2])
    jacobian = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(pose), 3, 3)), by_yaw[:, :, None], by_pitch[:, :, None]], axis=2
    )
    by_roll = np.cross(rotation[:, :, 0], arm) * np.radians(config.tilt_sigma_deg)
    shared: FloatArray = jacobian @ path.covariance[pose] @ jacobian.transpose(0, 2, 1)
    own_roll: FloatArray = by_roll[:, :, None] * by_roll[:, None, :]
    return shared + own_roll


def _symmetric(matrices: FloatArray) -> FloatArray:
    symmetric: FloatArray = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    return symmetric
