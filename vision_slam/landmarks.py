"""Landmarks: from sightings in the body frame to surface points in the world."""

import numpy as np

from survey.arrays import FloatArray
from survey.errors import InputError
from survey.recording import Recording
from survey.surface_points import SurfacePoints
from vision_slam.config import LocalizationConfig
from vision_slam.rotation import rotations
from vision_slam.smoother import SmoothedPath
from vision_slam.ties import pose_jacobian


def placed_landmarks(recording: Recording, path: SmoothedPath, config: LocalizationConfig) -> SurfacePoints:
    """Place the landmarks that pass the gates, with the covariance of sighting and path together.

    With R the attitude and o the offset in the body frame, the landmark is p + R o and
    its covariance R C Rᵀ + J P Jᵀ, J = [I, ∂(R o)/∂ψ, ∂(R o)/∂θ, ∂(R o)/∂φ]. The first
    part is the landmark's own; the second it shares with its neighbours, which the
    keyframe tells that each point carries.

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
    attitude = path.attitude_rad[pose]
    rotation = rotations(attitude)
    arm = np.einsum("nij,nj->ni", rotation, sightings.offset[keep])
    own = _symmetric(rotation @ sightings.covariance[keep] @ rotation.transpose(0, 2, 1))
    jacobian = pose_jacobian(arm, attitude)
    shared = jacobian @ path.covariance[pose] @ jacobian.transpose(0, 2, 1)
    assert recording.odometry is not None
    return SurfacePoints(
        path.position[pose] + arm,
        covariance=_symmetric(own + shared),
        origins=path.position[pose],
        range_m=sightings.range_m[keep],
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
        own_covariance=own,
        keyframe=path.error.keyframe_at(recording.odometry.time_s[pose]),
        heading_rad=attitude[:, 2],
    )


def _symmetric(matrices: FloatArray) -> FloatArray:
    symmetric: FloatArray = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    return symmetric
