"""Simulation of a drive along a route: what a rover senses on given terrain.

`simulate` chooses the fidelity. In the statistical one error models stand for camera, visual odometry and receivers;
missions take seconds. The rover follows its route exactly. With p the real position, R the real attitude and R̂ the
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

On moving ice the sensors that measure relative to it draw from the path on the ice of the start of the drive, receivers
and barometers from the path in fixed coordinates. Odometry and landmarks are given in the body frame, so errors of
attitude reach the map as they do in the field. Not modelled: times without vision, slip, wrong matches. Each sensor's
model is in `sim.instruments`.

The ideal fidelity samples the terrain along the route without errors. `sensed_attitude` gives roll and pitch with
errors, by which patterns are steered while they are driven.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from planners import LawnmowerConfig
from planners.routes.shortest_paths import FreeGround
from planners.steering import Attitude, AttitudeSensor
from sim.config.mission import AidsConfig, MissionConfig, RoverConfig, SensorConfig
from sim.config.sensors import InstrumentsConfig
from sim.config.world import SampleTerrain
from sim.instruments.registry import SENSORS
from sim.instruments.sensor import StatisticalDrive
from sim.instruments.visual_measurements import truth_of_epoch
from sim.vehicle.motion import exact_drive, poses_at_rest
from sim.world.moving_ice import MovingIce, epoch_of, moving_ice
from survey.core.arguments import check_types
from survey.core.arrays import BoolArray, FloatArray
from survey.core.crs import same_crs
from survey.core.errors import ConfigError, InputError
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Leg, Route
from survey.data.sensors.records import GpsFixes
from survey.data.truth import Truth

logger = logging.getLogger(__name__)


@check_types
def simulate(
    terrain: Dem,
    route: Route,
    *,
    seed: int = 0,
    fidelity: Literal["ideal", "statistical", "vision"] = "statistical",
    rover: RoverConfig | None = None,
    sensors: SensorConfig | None = None,
    aids: AidsConfig | None = None,
    instruments: InstrumentsConfig | None = None,
    folder: str | Path | None = None,
) -> tuple[Recording, Truth]:
    """Simulate a drive along a route over real terrain.

    Parameters
    ----------
    terrain : Dem
        Terrain that the rover drives on; it holds the whole route.
    route : Route
        Route of one rover, in the CRS of the terrain.
    seed : int
        All random errors follow from it.
    fidelity : {"statistical", "ideal", "vision"}
        Sensors with random errors, one perfect sensor, or physics with rendered images.
    rover : RoverConfig, optional
        Speed and the heights of antenna and camera.
    sensors : SensorConfig, optional
        Standard deviations of the sensors' errors; not with ``"vision"``.
    aids : AidsConfig, optional
        Aiding sensors: barometer, stakes, base station …; not with ``"vision"``.
    instruments : InstrumentsConfig, optional
        Instruments of ``"vision"``, and of no other fidelity.
    folder : str or pathlib.Path, optional
        New or empty folder for images, recording, truth and a video; needed by ``"vision"``, and by no other fidelity.

    Returns
    -------
    recording : Recording
        What the rover sensed; the input of `localize`.
    truth : Truth
        The terrain and the path that was driven, for scoring.

    Raises
    ------
    InputError
        The route leaves the terrain, or is in another CRS; the folder is not empty.
    ConfigError
        An argument of another fidelity, or ``"vision"`` without a folder.

    Notes
    -----
    With ``"vision"`` the rover steers by its real pose, and takes about a second of CPU time for a metre. A drive
    that ends early (a crevasse, an empty battery) is logged as a warning and described in ``drive.json``. Camera,
    scenery, faults and a rover that steers by its own estimate are settings of a mission (`run_mission`).

    Examples
    --------
    >>> import numpy as np
    >>> from survey.data.grid import Grid
    >>> from survey.data.route import Leg
    >>> grid = Grid((0.0, 0.0, 60.0, 60.0), 5.0)
    >>> line = Route((Leg("swath", [[10.0, 30.0], [50.0, 30.0]]),), grid.crs, "line")
    >>> recording, truth = simulate(Dem.on(grid, np.zeros(grid.shape)), line)
    >>> len(recording.gps), round(truth.trajectory.length_m)
    (41, 40)
    """
    same_crs(terrain.crs, route.crs, "the terrain and the route")
    _refuse_other_fidelity(
        fidelity, {"sensors": sensors, "aids": aids}, {"instruments": instruments, "folder": folder}
    )
    mission = MissionConfig(
        schema_version=1,
        name="drive",
        seed=seed,
        fidelity=fidelity,
        terrain=SampleTerrain(source="srtm-sample"),  # not read: terrain and route are given
        planner=LawnmowerConfig(swaths=1),
        rover=rover or RoverConfig(),
        sensors=sensors or SensorConfig(),
        aids=aids or AidsConfig(),
        instruments=instruments or InstrumentsConfig(),
    )
    if folder is not None:
        return _simulated_in_images(terrain, route, mission, Path(folder))
    return (simulate_ideal if fidelity == "ideal" else simulate_statistical)(terrain, route, mission)


def _refuse_other_fidelity(fidelity: str, drawn: dict[str, object], rendered: dict[str, object]) -> None:
    """Refuse arguments that the fidelity would not use, and images without a place for them."""
    unused = drawn if fidelity == "vision" else rendered
    for name, value in unused.items():
        if value is not None:
            raise ConfigError(
                f"the fidelity {fidelity!r} does not use {name}; leave it out, or choose another fidelity."
            )
    if fidelity == "vision" and rendered["folder"] is None:
        raise ConfigError(
            "the fidelity 'vision' writes images; give a folder for them, such as folder='drive'."
        )


def _simulated_in_images(
    terrain: Dem, route: Route, mission: MissionConfig, folder: Path
) -> tuple[Recording, Truth]:
    """Simulate a drive with rendered images, and write it."""
    from sim.simulate.vision import simulate_vision  # heavy: physics and compiled rendering

    drive = simulate_vision(terrain, route, mission, folder / "recording")
    drive.write(folder)
    if drive.ending.value != "arrived":
        logger.warning(
            "the drive ended after %.1f m of %.1f m: %s", drive.progress_m, drive.route_m, drive.ending.value
        )
    return drive.recording, drive.truth


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


def with_way_home(route: Route, area: SurveyArea) -> Route:
    """Append the shortest path on free ground from the end of a route back to its start.

    Raises
    ------
    InputError
        No path joins them, or the route is that of several rovers.
    """
    if route.n_rovers > 1:
        raise InputError("aids.way_home is for one rover; leave it out, or set fleet.rovers = 1.")
    start, end = route.legs[0].xy[0], route.legs[-1].xy[-1]
    way = FreeGround(area.free).way(end, start)
    return replace(route, legs=(*route.legs, Leg("transit", way)))


def with_unknown_start(recording: Recording, mission: MissionConfig) -> Recording:
    """Replace the surveyed start by the first fix, and turn the odometry by a random heading error."""
    turn_rad = (
        np.radians(mission.aids.heading_sigma_deg) * stream(mission.seed, "aids", "heading").standard_normal()
    )
    start = recording.gps.position[0] - [0.0, 0.0, recording.antenna_height_m]
    odometry = recording.odometry
    if odometry is not None:
        odometry = replace(odometry, attitude_rad=odometry.attitude_rad + [0.0, 0.0, turn_rad])
    return replace(recording, start=start, odometry=odometry)


def simulate_ideal(terrain: Dem, route: Route, mission: MissionConfig) -> tuple[Recording, Truth]:
    """Return exact positions on the ground every `sensors.sample_step_m` along a route."""
    trajectory, _ = exact_drive(terrain, route, mission.rover.speed_m_s)
    samples = route.sample(mission.sensors.sample_step_m)
    ground = np.column_stack([samples.xy, terrain.at(samples.xy)])
    fixes = GpsFixes(samples.distance_m / mission.rover.speed_m_s, ground)
    recording = Recording(route.crs, ground[0], fixes, vertical_datum=terrain.vertical_datum)
    return recording, Truth(terrain, trajectory)


def sensed_attitude(sense: AttitudeSensor, mission: MissionConfig) -> AttitudeSensor:
    """Return the attitude that the rover of a mission senses while it drives; see `sensed_attitudes`.

    Parameters
    ----------
    sense : callable
        Attitude at rest on the real terrain.
    mission : MissionConfig
        Its sections ``sensors`` and ``rover``, and its seed.

    Returns
    -------
    callable
        An `AttitudeSensor` of one rover, to be called step by step along its way.
    """
    rng = stream(mission.seed, "steering", "sensed")
    return sensed_attitudes(sense, mission.sensors, mission.rover.speed_m_s, [rng])


def sensed_attitudes(
    sense: AttitudeSensor, sensors: SensorConfig, speed_m_s: float, rngs: Sequence[np.random.Generator]
) -> AttitudeSensor:
    """Return the attitudes that rovers sense while they drive: roll and pitch with errors, at their real places.

    Steering (Eq. 10) gets nothing else of the ground. Roll and pitch err by the drawn errors of ``[sensors]``, correlated
    over ``attitude_correlation_m`` of travel, with a constant part. A rover takes itself to be at the places that it is
    called with and is beside them by the slow error of its receiver.

    Parameters
    ----------
    sense : callable
        Attitude at rest on the real terrain, of N rovers.
    sensors : SensorConfig
        Standard deviations and correlations of the errors.
    speed_m_s : float
        Speed of the rovers, by which the receiver's correlation time becomes a length [m/s].
    rngs : sequence of numpy.random.Generator
        One per rover; the errors of a rover depend on its own alone.

    Returns
    -------
    callable
        An `AttitudeSensor` of N rovers, to be called step by step along their ways.

    Notes
    -----
    The few metres between real and estimated place change the ground that is sensed, not the route that is driven.
    """
    correlation_m = sensors.gps_correlation_time_s * speed_m_s
    bias = np.radians(sensors.tilt_bias_sigma_deg) * np.array([rng.standard_normal(2) for rng in rngs])
    errors = _TravelErrors(
        np.array([sensors.gps_bias_sigma_m] * 2 + [np.radians(sensors.tilt_sigma_deg)] * 2),
        np.array([correlation_m] * 2 + [sensors.attitude_correlation_m] * 2),
        rngs,
    )

    def sensed(xy: FloatArray, heading_rad: FloatArray) -> Attitude:
        error = errors.at(xy)
        real = sense(xy + error[:, :2], heading_rad)
        roll, pitch = (error[:, 2:] + bias).T
        return Attitude(real.roll_rad + roll, real.pitch_rad + pitch, heading_rad)

    return sensed


class _TravelErrors:
    """First-order Gauss-Markov errors over the travel of N rovers; a rover that stands draws nothing."""

    def __init__(
        self, sigma: FloatArray, correlation_m: FloatArray, rngs: Sequence[np.random.Generator]
    ) -> None:
        self._sigma, self._correlation_m, self._rngs = sigma, correlation_m, rngs
        self._travel_m = np.zeros(len(rngs))
        self._here: FloatArray | None = None
        self._value = np.zeros((len(rngs), len(sigma)))

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the errors (N, K) when the rovers have reached places (N, 2)."""
        if self._here is None:
            self._here = xy.copy()
            self._value = self._noise(np.ones(len(xy), dtype=bool))
            return self._value
        travel_m = self._travel_m + np.hypot(*(xy - self._here).T)
        moved = travel_m > self._travel_m
        decay = np.exp(-(travel_m - self._travel_m)[:, None] / self._correlation_m)
        driven = np.sqrt(1.0 - decay**2) * self._noise(moved) + decay * self._value
        self._value = np.where(moved[:, None], driven, self._value)
        self._here, self._travel_m = xy.copy(), travel_m
        return self._value

    def _noise(self, moved: BoolArray) -> FloatArray:
        """Draw white noise (N, K) for the rovers that have moved."""
        noise = np.zeros_like(self._value)
        for k in np.flatnonzero(moved).tolist():
            noise[k] = self._sigma * self._rngs[k].standard_normal(len(self._sigma))
        return noise
