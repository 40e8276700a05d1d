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

The ideal fidelity samples the terrain along the route without errors.
"""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from planners import LawnmowerConfig
from sim.config.mission import AidsConfig, MissionConfig, SensorConfig
from sim.config.rover import RoverConfig
from sim.config.sensors import InstrumentsConfig
from sim.config.world import SampleTerrain
from sim.instruments.registry import SENSORS
from sim.instruments.sensor import StatisticalDrive
from sim.vehicle.motion import exact_drive, poses_at_rest
from sim.world.moving_ice import MovingIce, epoch_of, moving_ice
from survey import ConfigError, Dem, Recording, Route, Truth
from survey.core import check_types, same_crs, stream
from survey.data.sensors.records import GpsFixes

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
    mission = mission_of_drive(
        seed=seed,
        fidelity=fidelity,
        rover=rover or RoverConfig(),
        sensors=sensors or SensorConfig(),
        aids=aids or AidsConfig(),
        instruments=instruments or InstrumentsConfig(),
    )
    if folder is not None:
        return _simulated_in_images(terrain, route, mission, Path(folder))
    return (simulate_ideal if fidelity == "ideal" else simulate_statistical)(terrain, route, mission)


def mission_of_drive(**settings: Any) -> MissionConfig:
    """Return a mission with some settings for a drive on given terrain along a given route."""
    # Terrain and planner are not read: terrain and route are given.
    terrain, planner = SampleTerrain(source="srtm-sample"), LawnmowerConfig(swaths=1)
    return MissionConfig(schema_version=1, name="drive", terrain=terrain, planner=planner, **settings)


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
    """Draw the recording of a drive along a route from error models of the sensors."""
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
        epoch_s = epoch_of(recording, mission)
        return recording, ice.fixed_truth(Truth(terrain, drive.trajectory), epoch_s)
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
