"""Landmarks: sightings in the body frame to surface points in the world."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.recording import OdometryRecording
from survey.data.surface_points import SurfacePoints
from survey.data.thinning import most_informative
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.pose_constraints import pose_jacobian
from vision_slam.fusion.smoother import SmoothedPath
from vision_slam.rotation import rotations


def place_landmarks(
    recording: OdometryRecording, path: SmoothedPath, config: LocalizationConfig
) -> SurfacePoints:
    """Place the landmarks that pass the gates, with the covariance of sighting and path.

    With R the attitude and o the offset in the body frame, the landmark is p + R o and
    its covariance R C Rᵀ + J P Jᵀ, J = [I, ∂(R o)/∂ψ, ∂(R o)/∂θ, ∂(R o)/∂φ]. The first
    part is independent; the second is shared with its neighbours through the keyframe of
    each point.

    The gates are those of the glacier paper; thinned by information, landmarks of any range
    pass, and those are selected that lower the variance of a map about the path the most.

    Raises
    ------
    InputError
        When no landmark passes the gates.
    """
    sightings = recording.sightings
    ellipsoid_m = np.sqrt(np.linalg.eigvalsh(sightings.covariance)[:, -1])
    by_range = config.landmark_thinning == "range"
    least_range_m = config.landmark_min_range_m if by_range else 0.0
    keep = (ellipsoid_m <= config.landmark_max_sigma_m) & (sightings.range_m > least_range_m)
    if not keep.any():
        raise InputError(
            f"none of {len(keep)} landmarks passes the gates (1σ ≤ {config.landmark_max_sigma_m} m, first seen beyond "
            f"{least_range_m} m); loosen localization.landmark_max_sigma_m or landmark_min_range_m."
        )
    pose = sightings.pose[keep]
    attitude = path.attitude_rad[pose]
    rotation = rotations(attitude)
    arm = np.einsum("nij,nj->ni", rotation, sightings.offset[keep])
    own = _symmetric(rotation @ sightings.covariance[keep] @ rotation.transpose(0, 2, 1))
    jacobian = pose_jacobian(arm, attitude)
    shared = jacobian @ path.covariance[pose] @ jacobian.transpose(0, 2, 1)
    points = SurfacePoints(
        path.position[pose] + arm,
        covariance=_symmetric(own + shared),
        origins=path.position[pose] + rotation @ recording.camera_in_body_m,
        body=path.position[pose],
        range_m=sightings.range_m[keep],
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
        own_covariance=own,
        keyframe=path.error.keyframe_at(recording.odometry.time_s[pose]),
        heading_rad=attitude[:, 2],
    )
    return points if by_range else _most_informative(points, path, config)


def _most_informative(points: SurfacePoints, path: SmoothedPath, config: LocalizationConfig) -> SurfacePoints:
    """Select the landmarks that lower the variance of a map the most, in their order."""
    length_m = float(np.linalg.norm(np.diff(path.position, axis=0), axis=1).sum())
    east, north = path.position[:, 0], path.position[:, 1]
    bounds = (float(east.min()), float(north.min()), float(east.max()), float(north.max()))
    chosen = most_informative(
        points,
        max(round(config.landmarks_per_m * length_m), 1),
        bounds,
        variance_m2=config.terrain_variance_m2,
        length_scale_m=config.terrain_length_scale_m,
    )
    is_chosen = np.zeros(len(points), dtype=np.bool_)
    is_chosen[chosen] = True
    return points.select(is_chosen)


def _symmetric(matrices: FloatArray) -> FloatArray:
    symmetric: FloatArray = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    return symmetric
