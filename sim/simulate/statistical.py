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

On moving ice the sensors that measure relative to it draw from the path on the ice of the start
of the drive, receivers and barometers from the path in fixed coordinates.

Odometry and landmarks are given in the body frame, so errors of attitude reach the map as
they do in the field. Not modelled: times without vision, slip, wrong matches. Each sensor's
model is in `sim.instruments`.
"""

from dataclasses import replace

from sim.config.mission import MissionConfig
from sim.instruments.registry import SENSORS
from sim.instruments.sensor import StatisticalDrive
from sim.simulate.aiding import with_unknown_start
from sim.simulate.ice_records import truth_of_epoch
from sim.vehicle.exact_motion import exact_drive, poses_at_rest
from sim.world.moving_ice import MovingIce, epoch_of, moving_ice
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.truth import Truth


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
    ice = moving_ice(mission, terrain)
    drive = _drive(terrain, route, mission, ice)
    fixed = drive if ice is None else replace(drive, trajectory=ice.carried(drive.trajectory))
    trajectory = fixed.trajectory
    tables = {
        sensor.name: sensor.draw(fixed if sensor.is_fixed else drive)
        for sensor in SENSORS
        if sensor.draw is not None
    }
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
    if ice is not None:
        return recording, truth_of_epoch(Truth(terrain, drive.trajectory), ice, epoch_of(recording, mission))
    return recording, Truth(terrain, trajectory)


def _drive(terrain: Dem, route: Route, mission: MissionConfig, ice: MovingIce | None) -> StatisticalDrive:
    """Return the drive relative to the ice of its start: the rover follows the route in fixed coordinates."""
    if ice is None:
        trajectory, attitude = exact_drive(terrain, route, mission.rover.speed_m_s)
    else:
        samples = route.sample(mission.rover.speed_m_s * ice.config.pose_interval_s)
        time_s = samples.distance_m / mission.rover.speed_m_s
        starts = ice.starts(samples.xy, time_s)
        trajectory, attitude = poses_at_rest(terrain, starts, samples.heading_rad, time_s)
    return StatisticalDrive(terrain, route, trajectory, attitude, mission, ice)
