r"""The statistical fidelity: what a rover would sense, drawn from a model of its errors.

One documented model stands for camera, visual odometry and receivers; missions take
seconds. The rover keeps to its route exactly. With p the real position, R the real
attitude and R̂ the sensed one:

* attitude: R̂ differs from R by roll, pitch and yaw that are Ornstein–Uhlenbeck in travel; yaw may also
  walk, and roll and pitch have a constant part;
* odometry: step = Rᵀ Δp (1 + s) + w, one scale error s for the mission, w ~ N(0, q² L);
* GPS, every second: p + antenna + b + ν, b Gauss–Markov in time, vertical errors larger;
* barometer, every second: height + datum + Gauss–Markov drift + ν;
* landmarks: Poisson many per metre, at ranges r with density ∝ r^(−3/2) and bearings within
  ±70° of the heading, kept when the line of sight from the camera clears the ground; the
  error is Gaussian, a₀ + a₂ r² along the line of sight (parallax) and c₀ + c₁ r across it.

Odometry and landmarks are tied to the body, so errors of attitude reach the map as they
do in the field. What it leaves out: moments without vision, slip, wrong matches.
"""

import numpy as np

from sim.config.mission import MissionConfig, SensorConfig
from sim.instruments.gauss_markov import gauss_markov
from sim.simulate.aiding import with_aids
from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.sensors import Barometer, GpsFixes, Odometry, Sightings
from survey.data.trajectory import Trajectory
from survey.data.truth import Truth
from vision_slam.rotation import quaternions, rotations

_MAX_BEARING_RAD = np.radians(70.0)


def drive(terrain: Dem, route: Route, speed_m_s: float) -> tuple[Trajectory, FloatArray]:
    """Drive a route exactly: the real poses every second and their roll, pitch, yaw (N, 3) [rad].

    Raises
    ------
    InputError
        When the route leaves the known terrain.
    """
    samples = route.sample(speed_m_s)
    height = terrain.at(samples.xy)
    if np.isnan(height).any():
        east, north = samples.xy[np.flatnonzero(np.isnan(height))[0]]
        raise InputError(
            f"the route leaves the known terrain at ({east:.1f}, {north:.1f}); cut the area to the terrain "
            "(area.clip_to_terrain) or take a larger raster."
        )
    attitude = _resting_attitude(terrain, samples.xy, samples.heading_rad)
    position = np.column_stack([samples.xy, height])
    zero = np.zeros((len(position), 3, 3))
    time_s = samples.distance_m / speed_m_s
    return Trajectory(time_s, position, quaternions(attitude), zero, route.crs), attitude


def simulate_statistical(terrain: Dem, route: Route, mission: MissionConfig) -> tuple[Recording, Truth]:
    """Draw the recording of a drive along a route over real terrain.

    Returns
    -------
    recording : Recording
        What the rover sensed, and nothing else.
    truth : Truth
        The terrain and the path, for scoring alone.
    """
    trajectory, attitude = drive(terrain, route, mission.rover.speed_m_s)
    sensors, seed = mission.sensors, mission.seed
    recording = Recording(
        route.crs,
        trajectory.position[0],
        _gps(trajectory, mission, stream(seed, "sensors", "gps")),
        odometry=_odometry(trajectory, attitude, sensors, stream(seed, "sensors", "odometry")),
        barometer=_barometer(trajectory, sensors, stream(seed, "sensors", "barometer")),
        sightings=_sightings(terrain, trajectory, attitude, mission, stream(seed, "sensors", "landmarks")),
        antenna_height_m=mission.rover.antenna_height_m,
        vertical_datum=terrain.vertical_datum,
        camera_height_m=mission.rover.camera_height_m,
    )
    return with_aids(recording, trajectory, attitude, route, mission), Truth(terrain, trajectory)


def _resting_attitude(terrain: Dem, xy: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Roll, pitch and yaw of a rover of about a metre that stands on the ground."""
    half_m = 0.5
    ahead = half_m * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    left = half_m * np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
    pitch = -np.arctan(_rise(terrain, xy, ahead))
    roll = np.arctan(_rise(terrain, xy, left))
    return np.column_stack([roll, pitch, heading_rad])


def _rise(terrain: Dem, xy: FloatArray, half: FloatArray) -> FloatArray:
    """Slope of the ground from xy − half to xy + half; level where the terrain is not known."""
    rise = (terrain.at(xy + half) - terrain.at(xy - half)) / (2.0 * np.hypot(half[:, 0], half[:, 1]))
    return np.where(np.isfinite(rise), rise, 0.0)


def _gps(trajectory: Trajectory, mission: MissionConfig, rng: np.random.Generator) -> GpsFixes:
    sensors = mission.sensors
    per_axis = np.array([1.0, 1.0, sensors.gps_vertical_factor])
    gaps = np.diff(trajectory.time_s)
    bias = gauss_markov(gaps, sensors.gps_correlation_time_s, sensors.gps_bias_sigma_m, rng, 3)
    white = sensors.gps_white_sigma_m * rng.standard_normal(bias.shape)
    antenna = trajectory.position + [0.0, 0.0, mission.rover.antenna_height_m]
    return GpsFixes(trajectory.time_s, antenna + (bias + white) * per_axis)


def _odometry(
    trajectory: Trajectory, attitude: FloatArray, sensors: SensorConfig, rng: np.random.Generator
) -> Odometry:
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


def _barometer(trajectory: Trajectory, sensors: SensorConfig, rng: np.random.Generator) -> Barometer:
    datum = 10.0 * rng.standard_normal()
    gaps = np.diff(trajectory.time_s)
    drift = gauss_markov(gaps, sensors.barometer_correlation_time_s, sensors.barometer_drift_sigma_m, rng)[
        :, 0
    ]
    white = sensors.barometer_white_sigma_m * rng.standard_normal(len(drift))
    return Barometer(trajectory.time_s, trajectory.position[:, 2] + datum + drift + white)


def _sightings(
    terrain: Dem,
    trajectory: Trajectory,
    attitude: FloatArray,
    mission: MissionConfig,
    rng: np.random.Generator,
) -> Sightings:
    pose, place, distance = _seen_ground(terrain, trajectory, attitude, mission, rng)
    rotation = rotations(attitude[pose])
    offset = np.einsum("nji,nj->ni", rotation, place - trajectory.position[pose])
    covariance = _sighting_covariance(offset, distance, mission)
    root = np.linalg.cholesky(covariance)
    error = np.einsum("nij,nj->ni", root, rng.standard_normal(offset.shape))
    return Sightings(pose, offset + error, covariance, distance)


def _seen_ground(
    terrain: Dem,
    trajectory: Trajectory,
    attitude: FloatArray,
    mission: MissionConfig,
    rng: np.random.Generator,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Places on the ground that the camera sees: pose (M,), position (M, 3), range (M,)."""
    sensors = mission.sensors
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
    """Tell which lines of sight stay above the ground, tested at 24 places along each."""
    clear = np.ones(len(eye), dtype=np.bool_)
    for share in np.linspace(0.05, 0.96, 24):
        on_ray = eye + share * (place - eye)
        clear &= ~(terrain.at(on_ray[:, :2]) > on_ray[:, 2])
    return clear


def _sighting_covariance(offset: FloatArray, distance: FloatArray, mission: MissionConfig) -> FloatArray:
    """Covariance (M, 3, 3) in the body frame: long along the line of sight from the camera, slim across it."""
    sensors = mission.sensors
    ray = offset - [0.0, 0.0, mission.rover.camera_height_m]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    along = sensors.landmark_along_sigma_m[0] + sensors.landmark_along_sigma_m[1] * distance**2
    across = sensors.landmark_cross_sigma_m[0] + sensors.landmark_cross_sigma_m[1] * distance
    outer = ray[:, :, None] * ray[:, None, :]
    return along[:, None, None] ** 2 * outer + across[:, None, None] ** 2 * (np.eye(3) - outer)
