"""Statistical model of visual odometry: motion, landmarks and loop closures without images."""

import numpy as np

from sim.config.mission import MissionConfig
from sim.instruments.errors import gauss_markov
from sim.instruments.sensor import StatisticalDrive
from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.sensors.loop_closures import LoopClosures
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.sightings import Sightings
from survey.data.shared_views import STRETCH_M, far_share
from survey.data.trajectory import Trajectory
from vision_slam.rotation import rotations

_MAX_BEARING_RAD = np.radians(70.0)
# Two visits are of one place when they are this near, and this much driving apart.
_MEETS_M, _APART_M, _SPACED_M = 7.5, 80.0, 30.0
_RECOGNISED_SIGMA_M = 0.1


def draw_odometry(drive: StatisticalDrive) -> Odometry:
    """Draw visual odometry: correlated attitude errors, one scale error, and random steps."""
    trajectory, attitude, sensors = drive.trajectory, drive.attitude_rad, drive.mission.sensors
    rng = stream(drive.mission.seed, "sensors", "odometry")
    moves = np.diff(trajectory.position, axis=0)
    length = np.linalg.norm(moves, axis=1)
    sigma = np.radians([sensors.tilt_sigma_deg, sensors.tilt_sigma_deg, sensors.yaw_sigma_deg])
    error = gauss_markov(length, sensors.attitude_correlation_m, 1.0, rng, 3) * sigma
    scale = 1.0 + sensors.scale_sigma * rng.standard_normal()
    steps = np.einsum("nji,nj->ni", rotations(attitude[:-1]), moves) * scale
    steps += sensors.step_sigma_m * np.sqrt(length)[:, None] * rng.standard_normal(steps.shape)
    if sensors.heading_walk_deg_sqrt_m > 0.0:
        walked = (
            np.radians(sensors.heading_walk_deg_sqrt_m) * np.sqrt(length) * rng.standard_normal(len(length))
        )
        error[1:, 2] += np.cumsum(walked)
    if sensors.tilt_bias_sigma_deg > 0.0:
        error[:, :2] += np.radians(sensors.tilt_bias_sigma_deg) * rng.standard_normal(2)
    return Odometry(trajectory.time_s, steps, attitude + error)


def draw_sightings(drive: StatisticalDrive) -> Sightings:
    """Draw triangulated landmarks: visible places on the ground, with errors along and across the line of sight.

    Range and covariance are those that an estimator computes from the place that it measures; it does not know the
    place from which the error was drawn.
    """
    mission = drive.mission
    rng = stream(mission.seed, "sensors", "landmarks")
    pose, place, distance = _visible_ground(drive, rng)
    rotation = rotations(drive.attitude_rad[pose])
    offset = np.einsum("nji,nj->ni", rotation, place - drive.trajectory.position[pose])
    root = np.linalg.cholesky(_sighting_covariance(offset, mission))
    error = np.einsum("nij,nj->ni", root, rng.standard_normal(offset.shape))
    error += rotation[:, 2, :] * _common_height_error(drive, pose, distance)[:, None]
    measured = offset + error
    claimed = mission.mismatch.drawn_landmark_ratio(mission.seed) ** 2 * _sighting_covariance(
        measured, mission
    )
    return Sightings(pose, measured, claimed, np.linalg.norm(_from_camera(measured, mission), axis=1))


def _common_height_error(drive: StatisticalDrive, pose: IntArray, distance: FloatArray) -> FloatArray:
    """Draw the errors of height (M,) that landmarks share: those of a stretch of travel, and the bias of far ones [m]."""
    sensors, trajectory = drive.mission.sensors, drive.trajectory
    error: FloatArray = sensors.landmark_far_bias_m * far_share(distance)
    if sensors.landmark_shared_sigma_m > 0.0:
        steps = np.linalg.norm(np.diff(trajectory.position, axis=0), axis=1)
        stretch = (np.r_[0.0, np.cumsum(steps)] / STRETCH_M).astype(np.int64)
        rng = stream(drive.mission.seed, "sensors", "landmarks", "shared")
        error = error + sensors.landmark_shared_sigma_m * rng.standard_normal(stretch[-1] + 1)[stretch[pose]]
    return error


def _visible_ground(
    drive: StatisticalDrive, rng: np.random.Generator
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Draw visible places on the ground; return pose (M,), position (M, 3) and range (M,)."""
    terrain, trajectory, attitude = drive.terrain, drive.trajectory, drive.attitude_rad
    mission, sensors = drive.mission, drive.mission.sensors
    travel = np.r_[0.0, np.linalg.norm(np.diff(trajectory.position, axis=0), axis=1)]
    pose = np.repeat(np.arange(len(travel)), rng.poisson(sensors.landmarks_per_m * travel))
    near, far = sensors.landmark_range_m
    share = rng.random(len(pose))
    ground_m = (near**-0.5 - share * (near**-0.5 - far**-0.5)) ** -2.0
    bearing = attitude[pose, 2] + rng.uniform(-_MAX_BEARING_RAD, _MAX_BEARING_RAD, len(pose))
    xy = trajectory.position[pose, :2] + ground_m[:, None] * np.column_stack(
        [np.cos(bearing), np.sin(bearing)]
    )
    place = np.column_stack([xy, terrain.at(xy)])
    eye = trajectory.position[pose] + [0.0, 0.0, mission.rover.camera_height_m]
    seen = np.isfinite(place[:, 2]) & _clear(terrain, eye, place)
    return pose[seen], place[seen], np.linalg.norm(place - eye, axis=1)[seen]


def _clear(terrain: Dem, eye: FloatArray, place: FloatArray) -> BoolArray:
    """Return which lines of sight stay above the ground, tested at 24 places along each."""
    clear = np.ones(len(eye), dtype=np.bool_)
    for share in np.linspace(0.05, 0.96, 24):
        on_ray = eye + share * (place - eye)
        clear &= ~(terrain.at(on_ray[:, :2]) > on_ray[:, 2])
    return clear


def _sighting_covariance(offset: FloatArray, mission: MissionConfig) -> FloatArray:
    """Return covariances (M, 3, 3) of places in the body frame, along and across the line of sight from the camera."""
    sensors, ray = mission.sensors, _from_camera(offset, mission)
    distance = np.linalg.norm(ray, axis=1)
    ray = ray / distance[:, None]
    along = sensors.landmark_along_sigma_m[0] + sensors.landmark_along_sigma_m[1] * distance**2
    across = sensors.landmark_cross_sigma_m[0] + sensors.landmark_cross_sigma_m[1] * distance
    outer = ray[:, :, None] * ray[:, None, :]
    covariance: FloatArray = along[:, None, None] ** 2 * outer + across[:, None, None] ** 2 * (
        np.eye(3) - outer
    )
    return covariance


def _from_camera(offset: FloatArray, mission: MissionConfig) -> FloatArray:
    """Return vectors (M, 3) from the camera to places in the body frame [m]."""
    ray: FloatArray = offset - [0.0, 0.0, mission.rover.camera_height_m]
    return ray


def draw_loop_closures(drive: StatisticalDrive) -> LoopClosures | None:
    """Draw loop closures where the route meets itself, some of them wrong; None where none is found."""
    trajectory, attitude_rad, aids = drive.trajectory, drive.attitude_rad, drive.mission.aids
    if not aids.recognition > 0.0:
        return None
    rng = stream(drive.mission.seed, "aids", "closures")
    pairs = _meetings(trajectory)
    pairs = pairs[rng.random(len(pairs)) < aids.recognition]
    if not len(pairs):
        return None
    earlier, later = pairs.T
    moved = trajectory.position[later] - trajectory.position[earlier]
    offset = np.einsum("nji,nj->ni", rotations(attitude_rad[earlier]), moved)
    offset = offset + _RECOGNISED_SIGMA_M * rng.standard_normal(offset.shape)
    wrong = np.arange(len(pairs)) < aids.wrong_closures
    offset = offset + wrong[:, None] * np.array([6.0, 0.0, 0.6])
    spread = np.tile(_RECOGNISED_SIGMA_M**2 * np.eye(3), (len(pairs), 1, 1))
    return LoopClosures(trajectory.time_s[later], trajectory.time_s[earlier], offset, spread)


def _meetings(trajectory: Trajectory) -> IntArray:
    """Return pairs of poses (M, 2) at places visited twice: the nearest pair of each meeting, ordered by the later."""
    steps = np.linalg.norm(np.diff(trajectory.position, axis=0), axis=1)
    travel = np.r_[0.0, np.cumsum(steps)]
    xy = trajectory.position[:, :2]
    distance = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    near = (distance < _MEETS_M) & (travel[None] - travel[:, None] > _APART_M)
    i, j = np.nonzero(near)
    pairs: list[tuple[int, int]] = []
    for k in np.argsort(distance[i, j], kind="stable"):
        a, b = int(i[k]), int(j[k])
        if all(abs(travel[b] - travel[d]) > _SPACED_M for _, d in pairs):
            pairs.append((a, b))
    return np.array(sorted(pairs, key=lambda pair: pair[1]), dtype=np.int64).reshape(-1, 2)
