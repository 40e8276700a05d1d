"""Visual measurements without images: odometry, landmarks, loop closures, and surveyed stakes.

`draw_odometry`, `draw_sightings` and `draw_loop_closures` are the statistical model of visual odometry. Landmarks are
seen where the line of sight from the camera clears the ground. Stakes stand at surveyed places: their bearings and
ranges are drawn in both fidelities, and on moving ice their surveys are repeated.
"""

import numpy as np

from sim.config.mission import MissionConfig
from sim.config.sensors import StakeConfig
from sim.instruments.sensor import StatisticalDrive, gauss_markov
from sim.vehicle.motion import RoverMotion
from sim.world.moving_ice import MovingIce
from survey import Dem, Route, Trajectory
from survey.core import BoolArray, FloatArray, IntArray, stream
from survey.data.landmarks import STRETCH_M, far_share
from survey.data.sensors.odometry import LoopClosures, Odometry, Sightings
from survey.data.sensors.stakes import Stakes, StakeSightings, StakeSurveys
from vision_slam.attitude import rotations

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
    # The inverse of the distribution function of ranges with a density ∝ r^(-3/2).
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
    # Short of the place itself, which lies on the ground.
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


# A stake stands this far beside the way; it is seen when the rover is nearest.
_BESIDE_M = 1.5
_SEEN_SIGMA_M = 0.03


def survey_stakes(config: StakeConfig, foot: FloatArray, seed: int) -> Stakes | None:
    """Return the stakes as surveyed, from their real places (K, 3) [m]; None without stakes."""
    rng = stream(seed, "instruments", "stakes", "survey")
    surveyed = foot + config.survey_sigma_m * rng.standard_normal(foot.shape)
    return Stakes(surveyed, np.full(len(foot), config.survey_sigma_m)) if len(foot) else None


class StakeSpotter:
    """Detector of stakes, once a second within range.

    `config`: number and errors. `foot` (K, 3): real places of the stakes [m]. `seed`: the mission's seed.
    """

    def __init__(self, config: StakeConfig, foot: FloatArray, seed: int) -> None:
        self._config, self._foot = config, foot
        self._rng = stream(seed, "instruments", "stakes", "seen")
        self._n_seconds = 0

    def sense(self, motion: RoverMotion) -> StakeSightings | None:
        """Return the sightings during a stretch."""
        last = int(np.floor(motion.time_s[-1] + 1e-6))
        at_s = np.arange(self._n_seconds, last + 1, dtype=np.float64)
        self._n_seconds = max(self._n_seconds, last + 1)
        gap = self._foot[None] - motion.position_at(at_s)[:, None]
        moment, stake = np.nonzero(np.linalg.norm(gap, axis=2) < self._config.range_m)
        if not len(moment):
            return None
        offset = motion.rotation_at(at_s[moment]).inv().apply(gap[moment, stake])
        covariance = self._covariance(offset)
        error = np.einsum(
            "nij,nj->ni", np.linalg.cholesky(covariance), self._rng.standard_normal(offset.shape)
        )
        return StakeSightings(at_s[moment], stake.astype(np.float64), offset + error, covariance)

    def _covariance(self, offset: FloatArray) -> FloatArray:
        """Return covariances (N, 3, 3) along and across the line of sight [m²]; never below a centimetre."""
        distance = np.linalg.norm(offset, axis=1)
        ray = offset / distance[:, None]
        along = np.hypot(self._config.range_error_share * distance, 0.01)
        across = np.hypot(np.radians(self._config.bearing_error_deg) * distance, 0.01)
        outer = ray[:, :, None] * ray[:, None, :]
        covariance: FloatArray = along[:, None, None] ** 2 * outer + across[:, None, None] ** 2 * (
            np.eye(3) - outer
        )
        return covariance


def draw_stakes(drive: StatisticalDrive) -> Stakes | None:
    """Draw the surveyed places of stakes at the ends of swaths; None where the mission has none."""
    return _drawn_stakes(drive)[0] if drive.mission.aids.stakes else None


def draw_stake_sightings(drive: StatisticalDrive) -> StakeSightings | None:
    """Draw one sighting of each stake; None where the mission has none."""
    return _drawn_stakes(drive)[1] if drive.mission.aids.stakes else None


def draw_stake_surveys(drive: StatisticalDrive) -> StakeSurveys | None:
    """Draw repeated surveys of the stakes on moving ice; None where the mission has none."""
    ice, aids = drive.ice, drive.mission.aids
    if ice is None or not (aids.stakes and ice.config.stake_surveys):
        return None
    return survey_repeatedly(
        _stake_feet(drive)[0], ice, drive.trajectory.time_s[[0, -1]], aids.stake_sigma_m, drive.mission.seed
    )


def survey_repeatedly(
    foot: FloatArray, ice: MovingIce, ends_s: FloatArray, sigma_m: float, seed: int
) -> StakeSurveys:
    """Return surveys of stakes that stand at places (K, 3) at the start, evenly between two times."""
    n = ice.config.stake_surveys
    time_s = np.repeat(np.linspace(ends_s[0], ends_s[1], n), len(foot))
    stake = np.tile(np.arange(len(foot)), n)
    real = foot[stake] + ice.displacement(foot[stake, :2], time_s)
    error = sigma_m * stream(seed, "ice", "stake surveys").standard_normal(real.shape)
    return StakeSurveys(time_s, stake.astype(np.float64), real + error, np.full(len(real), sigma_m))


def _stake_feet(drive: StatisticalDrive) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the real places (K, 3) of the stakes, the poses that see them, and their offsets (K, 3) from these."""
    trajectory = drive.trajectory
    pose = _ends_of_swaths(trajectory, drive.route, drive.mission.aids.stakes)
    left = rotations(drive.attitude_rad[pose])[:, :, 1] * _BESIDE_M
    return trajectory.position[pose] + left, pose, left


def _drawn_stakes(drive: StatisticalDrive) -> tuple[Stakes, StakeSightings]:
    """Place stakes beside the route, survey them, and sight each once."""
    trajectory, sigma_m = drive.trajectory, drive.mission.aids.stake_sigma_m
    real, pose, left = _stake_feet(drive)
    rng, body = stream(drive.mission.seed, "aids", "stakes"), rotations(drive.attitude_rad[pose])
    surveyed = real + sigma_m * rng.standard_normal(real.shape)
    offset = np.einsum("nji,nj->ni", body, left)
    offset = offset + _SEEN_SIGMA_M * rng.standard_normal(offset.shape)
    covariance = np.tile(_SEEN_SIGMA_M**2 * np.eye(3), (len(pose), 1, 1))
    index = np.arange(len(pose), dtype=np.float64)
    sightings = StakeSightings(trajectory.time_s[pose], index, offset, covariance)
    return Stakes(surveyed, np.full(len(pose), sigma_m)), sightings


def _ends_of_swaths(trajectory: Trajectory, route: Route, n_stakes: int) -> IntArray:
    """Return the poses nearest to the far ends of swaths: of the last swath first, then evenly."""
    ends = np.array([swath.xy[-1] for swath in route.swaths])
    chosen = np.unique(np.round(np.linspace(len(ends) - 1, 0, n_stakes + 1)[:-1]).astype(np.int64))
    chosen = chosen if len(chosen) == n_stakes else np.arange(len(ends))[-n_stakes:]
    gaps = np.hypot(*(trajectory.position[:, None, :2] - ends[chosen][None]).transpose(2, 0, 1))
    nearest: IntArray = np.argmin(gaps, axis=0)
    return np.sort(nearest)
