r"""Statistical fidelity: sensor records drawn from error models.

Error models stand for camera, visual odometry and receivers; missions take seconds. The
rover follows its route exactly. With p the real position, R the real attitude and R̂ the
sensed one:

* attitude: R̂ differs from R by roll, pitch and yaw that are Ornstein–Uhlenbeck in travel; yaw may also
  walk, and roll and pitch have a constant part;
* odometry: step = Rᵀ Δp (1 + s) + w, one scale error s for the mission, w ~ N(0, q² L);
* GPS, every second: p + antenna + b + ν, b Gauss–Markov in time, vertical errors larger;
* barometer, every second: height + datum + Gauss–Markov drift + ν;
* landmarks: Poisson many per metre, at ranges r with density ∝ r^(−3/2) and bearings within
  ±70° of the heading, where the line of sight from the camera clears the ground; the
  error is Gaussian, a₀ + a₂ r² along the line of sight (parallax) and c₀ + c₁ r across it;
  range and covariance that come with a landmark are those of the measured place.

Odometry and landmarks are given in the body frame, so errors of attitude reach the map as
they do in the field. Not modelled: times without vision, slip, wrong matches. Each sensor's
model is in `sim.instruments`.
"""

import numpy as np

from sim.config.mission import MissionConfig
from sim.instruments.registry import SENSORS
from sim.instruments.sensor import StatisticalDrive
from sim.simulate.aiding import with_unknown_start
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.trajectory import Trajectory
from survey.data.truth import Truth
from vision_slam.rotation import quaternions


def exact_drive(terrain: Dem, route: Route, speed_m_s: float) -> tuple[Trajectory, FloatArray]:
    """Return the real poses of a rover that follows a route exactly, one a second, and their attitudes.

    Parameters
    ----------
    terrain : Dem
        The real terrain.
    route : Route
        The route of one rover.
    speed_m_s : float
        Speed along the route [m/s].

    Returns
    -------
    trajectory : Trajectory
        Real poses.
    attitude_rad : (N, 3) ndarray
        Roll, pitch and yaw [rad].

    Raises
    ------
    InputError
        The route leaves the known terrain.
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
    """Draw the recording of a drive along a route from error models of the sensors.

    Parameters
    ----------
    terrain : Dem
        The real terrain.
    route : Route
        The route of one rover, which it follows exactly.
    mission : MissionConfig
        Speed, errors of the sensors (``sensors``), aiding sensors (``aids``), seed.

    Returns
    -------
    recording : Recording
        Sensor records, without images.
    truth : Truth
        Terrain and path, for scoring alone.

    Raises
    ------
    InputError
        The route leaves the known terrain.
    """
    trajectory, attitude = exact_drive(terrain, route, mission.rover.speed_m_s)
    drive = StatisticalDrive(terrain, route, trajectory, attitude, mission)
    tables = {sensor.name: sensor.draw(drive) for sensor in SENSORS if sensor.draw is not None}
    recording = Recording(
        route.crs,
        trajectory.position[0],
        **tables,
        antenna_height_m=mission.rover.antenna_height_m,
        vertical_datum=terrain.vertical_datum,
        camera_height_m=mission.rover.camera_height_m,
    )
    if mission.aids.start == "unknown":
        recording = with_unknown_start(recording, mission)
    return recording, Truth(terrain, trajectory)


def _resting_attitude(terrain: Dem, xy: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (N, 3) of a rover of about a metre at rest on the ground [rad]."""
    half_m = 0.5
    ahead = half_m * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    left = half_m * np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
    pitch = -np.arctan(_rise(terrain, xy, ahead))
    roll = np.arctan(_rise(terrain, xy, left))
    return np.column_stack([roll, pitch, heading_rad])


def _rise(terrain: Dem, xy: FloatArray, half: FloatArray) -> FloatArray:
    """Return the slope of the ground from xy − half to xy + half; level where the terrain is not known."""
    rise = (terrain.at(xy + half) - terrain.at(xy - half)) / (2.0 * np.hypot(half[:, 0], half[:, 1]))
    return np.where(np.isfinite(rise), rise, 0.0)
