"""The main path of localization: records in, trajectory and landmarks out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.sensors import Odometry
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import believing, follow
from vision_slam.fusion.sanity_checks import lateness_s, with_credible_start, without_repeats
from vision_slam.fusion.smoother import SmoothedPath, smooth
from vision_slam.inertial.attitude import heading_correction
from vision_slam.landmarks import placed_landmarks
from vision_slam.odometry.config import VisualOdometryConfig
from vision_slam.odometry.visual_slam import VisualOdometry, visual_odometry
from vision_slam.places.loop_closures import closures_by_images
from vision_slam.places.relocalization import rejoined, torn_at
from vision_slam.rotation import quaternions, rotations


def localize(
    recording: Recording,
    config: LocalizationConfig | None = None,
    *,
    told_online: Callable[[Trajectory], None] | None = None,
) -> tuple[Trajectory, SurfacePoints]:
    """Estimate where the rover was and where its landmarks are.

    The odometry is reckoned from the surveyed start, its errors are estimated from GPS
    and barometer, and the landmarks are placed from the corrected path. Images are turned
    into odometry and sightings first, where the recording has no odometry. One without
    either is a kinematic GPS survey: the fixes are the path and the ground
    below the antenna the surface.

    Parameters
    ----------
    recording : Recording
        What the rover sensed.
    config : LocalizationConfig, optional
        What is assumed of the sensors.
    told_online : callable, optional
        Called with the path as it was known at every moment, before anything that came after.

    Returns
    -------
    trajectory : Trajectory
        Poses with covariances of position.
    points : SurfacePoints
        Landmarks with 3 × 3 covariances that hold both the sighting's own error and the
        path's. Neighbouring landmarks share the path's part: as independent points they
        claim more than they know.

    Raises
    ------
    InputError
        Sightings are missing, or none passes the gates.
    """
    settings = config or LocalizationConfig()
    if recording.odometry is None and recording.frames is not None:
        trajectory, points, _ = localize_by_images(recording, settings, told_online=told_online)
        return trajectory, points
    if recording.odometry is None:
        return _kinematic_survey(recording, settings)
    if recording.sightings is None:
        raise InputError(
            "the recording has odometry and no sightings; without landmarks there is no surface to map."
        )
    reckoned = dead_reckoning(recording.odometry, recording.start)
    online = follow(recording, reckoned, settings)
    if told_online is not None:
        told_online(online.trajectory(recording))
    path = smooth(believing(recording, online), reckoned, settings)
    return _trajectory(recording, path), placed_landmarks(recording, path, settings)


def localize_by_images(
    recording: Recording,
    config: LocalizationConfig | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    *,
    told_online: Callable[[Trajectory], None] | None = None,
) -> tuple[Trajectory, SurfacePoints, VisualOdometry]:
    """Localize a recording whose images have not been processed yet; tell also how they were.

    Where the images were blind for too long the trajectory's health is 0.

    Raises
    ------
    InputError
        No images, fewer than two, images that do not fit their calibration, or no landmark
        passes the gates.
    """
    found = visual_odometry(recording, progress=progress)
    return localize_seen(recording, found, config, told_online=told_online)


def localize_seen(
    recording: Recording,
    found: VisualOdometry,
    config: LocalizationConfig | None = None,
    *,
    told_online: Callable[[Trajectory], None] | None = None,
) -> tuple[Trajectory, SurfacePoints, VisualOdometry]:
    """Localize a recording with what its images gave; places that they recognise tie the path.

    Raises
    ------
    InputError
        No landmark passes the gates.
    """
    settings = for_images(config or LocalizationConfig())
    recording = replace(recording, gps=without_repeats(recording.gps))
    if not len(torn_at(recording, found)):
        path = dead_reckoning(found.odometry, recording.start)
        recording, settings = with_credible_start(recording, path, found.odometry.time_s, settings)
        recording = with_credible_fixes(recording, found.odometry, settings)
    seen, found = headed(recording, found)
    trajectory, points = localize(recognised(seen, settings), settings, told_online=told_online)
    return replace(trajectory, health=1.0 - found.is_lost), points, found


def with_credible_fixes(recording: Recording, odometry: Odometry, config: LocalizationConfig) -> Recording:
    """Return the recording with the fixes that the filter believes, moved back in time if they come late."""
    moving = replace(recording, odometry=odometry)
    path = dead_reckoning(odometry, recording.start)
    moving = believing(moving, follow(moving, path, config))
    lag_s = lateness_s(moving, path, config)
    return replace(recording, gps=replace(moving.gps, time_s=moving.gps.time_s - lag_s))


def recognised(recording: Recording, config: LocalizationConfig) -> Recording:
    """Return the recording with the closures that its images tell, unless it has some already."""
    assert recording.odometry is not None
    if recording.frames is None or recording.closures is not None:
        return recording
    path = smooth(recording, dead_reckoning(recording.odometry, recording.start), config)
    sigma_m = np.sqrt(np.linalg.eigvalsh(path.covariance[:, :2, :2])[:, -1])
    return replace(recording, closures=closures_by_images(recording, path.position, sigma_m))


def with_visual_odometry(
    recording: Recording,
    config: VisualOdometryConfig | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Recording, VisualOdometry]:
    """Return the recording with the odometry and the sightings of its images, headed by its fixes.

    Raises
    ------
    InputError
        No images, fewer than two, or images that do not fit their calibration.
    """
    return headed(recording, visual_odometry(recording, config, progress))


def headed(recording: Recording, found: VisualOdometry) -> tuple[Recording, VisualOdometry]:
    """Turn what images gave to the heading that the fixes tell; return it also as part of the recording."""
    if len(torn_at(recording, found)):
        found = rejoined(recording, found)
        return replace(recording, odometry=found.odometry, sightings=found.sightings), found
    odometry = found.odometry
    path = dead_reckoning(odometry, recording.start)
    turn = heading_correction(path, odometry.time_s, recording.gps)
    headed = replace(odometry, attitude_rad=odometry.attitude_rad + [0.0, 0.0, turn])
    found = replace(found, odometry=headed)
    return replace(recording, odometry=headed, sightings=found.sightings), found


def for_images(config: LocalizationConfig) -> LocalizationConfig:
    """Assume of the odometry what is assumed of images."""
    return config.model_copy(update=config.images.model_dump())


def dead_reckoning(odometry: Odometry, start: FloatArray) -> FloatArray:
    """Sum the odometry's steps from the start: positions (N, 3) [m] in the world."""
    steps = np.einsum("nij,nj->ni", rotations(odometry.attitude_rad[:-1]), odometry.step)
    return np.vstack([start, start + np.cumsum(steps, axis=0)])


def _trajectory(recording: Recording, path: SmoothedPath) -> Trajectory:
    assert recording.odometry is not None
    return Trajectory(
        recording.odometry.time_s,
        path.position,
        quaternions(path.attitude_rad),
        path.covariance[:, :3, :3],
        recording.crs,
        error=path.error,
    )


def _kinematic_survey(recording: Recording, config: LocalizationConfig) -> tuple[Trajectory, SurfacePoints]:
    ground = recording.gps.position - [0.0, 0.0, recording.antenna_height_m]
    level = np.array([1.0, 1.0, config.gps_vertical_factor])
    variance = (config.gps_bias_sigma_m**2 + config.gps_white_sigma_m**2) * level**2
    covariance = np.tile(np.diag(variance), (len(ground), 1, 1))
    heading = np.arctan2(np.gradient(ground[:, 1]), np.gradient(ground[:, 0]))
    attitude = np.column_stack([np.zeros_like(heading), np.zeros_like(heading), heading])
    trajectory = Trajectory(recording.gps.time_s, ground, quaternions(attitude), covariance, recording.crs)
    points = SurfacePoints(
        ground,
        covariance=covariance,
        origins=recording.gps.position,
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
    )
    return trajectory, points
