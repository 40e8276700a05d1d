"""Vision fidelity: a rover drives a route over fine ground while instruments and camera record.

Open loop, the rover steers by its real pose; closed loop, by the pose that a navigator
estimates from the readings so far; or an `DriveOperator`, such as another program, commands its
velocity. The ending of a drive is one of `Ending`.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from pyproj import CRS

from sim.config.mission import MissionConfig
from sim.instruments.registry import Instruments, ReadingLog
from sim.instruments.sensor import InstrumentSetup
from sim.simulate.assembly import Faults, camera_on_rover, rover_camera, rover_physics, stakes_beside
from sim.simulate.navigator import Navigator, PoseEstimate, Start
from sim.simulate.simulated_drive import (
    LOGGED_HZ,
    STANDING_S,
    STEERED_HZ,
    DriveMonitor,
    Ending,
    SimulatedDrive,
)
from sim.simulate.steering import SteeredPath
from sim.vehicle.motion import RoverMotion, RoverState
from sim.vehicle.pursuit import BackingOff, PurePursuit, skid_speeds
from sim.world.fine_terrain import FineTerrain, fine_terrain
from sim.world.moving_ice import epoch_of, moving_ice
from survey import ConfigError, Dem, InputError, Route, Trajectory, Truth
from survey.core import FloatArray
from survey.data.frames import Frames, FrameWriter
from survey.data.recording import Readings, Recording

_MEMORY_S = 0.5
EDGE_M = 3.0
"""Distance from the edge of the terrain that routes keep to [m]: a rover that turns at the end of a swath swings out."""


def simulate_vision(
    terrain: Dem,
    route: Route,
    mission: MissionConfig,
    folder: Path,
    navigate: Callable[[Start], Navigator] | None = None,
    *,
    steers: bool = True,
    steered: SteeredPath | None = None,
) -> SimulatedDrive:
    """Simulate a drive in the vision fidelity: physics, instruments and rendered images."""
    run = _prepared(terrain, route, mission, folder, steered)
    navigator = None if navigate is None else navigate(run.start)
    with FrameWriter(folder / "frames") as writer:
        ending, last = run.until_the_end(writer, navigator, steers=steers and navigator is not None)
        odometry = None if navigator is None else navigator.finish(last)
    return replace(run.result(ending, folder), visual_odometry=odometry)


class Velocity(NamedTuple):
    """Commanded speed ahead [m/s] and rate of turn, positive to the left [rad/s]."""

    speed_m_s: float
    turn_rate_rad_s: float


class DriveOperator(Protocol):
    """Drives the rover by what it senses."""

    def begin(self, start: Start, crs: CRS, /) -> None:
        """Take calibration and start pose, in the CRS of the fixes; the drive begins when this returns."""
        ...

    def step(self, readings: Readings, state: RoverState, /) -> Velocity | None:
        """Take the readings of a period of the steering, and the real state for scores alone.

        Returns the velocity for the next period, or None to end the drive.
        """
        ...


def drive_by_commands(
    terrain: Dem, route: Route, mission: MissionConfig, folder: Path, operator: DriveOperator
) -> SimulatedDrive:
    """Simulate a drive from the start of a route, at the velocities that an operator commands."""
    run = _prepared(terrain, route, mission, folder)
    operator.begin(run.start, terrain.crs)
    with FrameWriter(folder / "frames") as writer:
        ending = run.follow(operator, writer)
    drive = run.result(ending, folder)
    driven_m = drive.truth.trajectory.length_m
    return replace(drive, progress_m=driven_m, route_m=driven_m)


def _prepared(
    terrain: Dem, route: Route, mission: MissionConfig, folder: Path, steered: SteeredPath | None = None
) -> "_Run":
    """Return a drive before it begins; refuse a folder with files, and routes that cannot be driven."""
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"the recording folder {folder} exists and is not empty; choose another one.")
    ground = fine_terrain(terrain, mission.scenery, mission.site_seed)
    path = route.path()
    _check(ground, path, mission)
    return _Run(ground, path, mission, steered)


def _check(ground: FineTerrain, path: FloatArray, mission: MissionConfig) -> None:
    """Refuse routes and rates that cannot be simulated, before anything is written."""
    xmin, ymin, xmax, ymax = ground.bounds
    outside = ((path < [xmin + EDGE_M, ymin + EDGE_M]) | (path > [xmax - EDGE_M, ymax - EDGE_M])).any(axis=1)
    if outside.any():
        east, north = path[outside][0]
        raise InputError(
            f"the route comes at ({east:.1f}, {north:.1f}) within {EDGE_M:g} m of where the terrain ends, whose bounds are "
            f"{ground.bounds}; a rover needs ground to turn on, so set area.bounds_m further inside, or take a larger terrain."
        )
    rate = mission.physics.rate_hz
    if rate % LOGGED_HZ:
        raise ConfigError(f"physics.rate_hz is {rate}; it must be a multiple of {LOGGED_HZ}.")
    inertial_hz = mission.instruments.inertial.rate_hz
    if LOGGED_HZ % inertial_hz:
        raise ConfigError(
            f"instruments.inertial.rate_hz is {inertial_hz:g}; it must divide {LOGGED_HZ} (80, 40, 20 …)."
        )


class _Run:
    """A drive in progress."""

    def __init__(
        self, ground: FineTerrain, path: FloatArray, mission: MissionConfig, steered: SteeredPath | None
    ) -> None:
        self._ground, self._mission, self._steered = ground, mission, steered
        self._ice = moving_ice(mission, ground.dem)
        self._faults = Faults(mission.faults, mission.seed)
        speed_m_s, physics = mission.rover.speed_m_s, mission.physics
        reference = PurePursuit(path, speed_m_s, physics)
        self._pursuit = (
            reference
            if steered is None
            else PurePursuit(steered.start[None], speed_m_s, physics, is_complete=False)
        )
        self._backing = BackingOff(mission.rover.speed_m_s)
        self._physics = rover_physics(ground, path, mission)
        self._monitor = DriveMonitor(ground, self._pursuit, mission)
        self._states = [self._physics.state]
        self._recent = [self._physics.state]
        self._start = np.array(self._physics.state.position)
        self._steered_xy = self._start[:2]
        self._feet = stakes_beside(ground, reference, mission)
        self._instruments = Instruments(self._setup(), mission.faults)
        self._log = ReadingLog()
        self._camera = rover_camera(mission.imaging)
        look = self._faults.appearance(mission.appearance)
        self._rover_camera = camera_on_rover(ground, look, self._camera, mission)
        self._n_frames, self._frame_times = 0, list[float]()
        self._estimates: list[tuple[float, ...]] = []

    def _setup(self) -> InstrumentSetup:
        mission, antenna_m = self._mission, self._mission.rover.antenna_height_m
        base = self._start + [0.0, 0.0, antenna_m]
        return InstrumentSetup(
            mission.instruments, antenna_m, base, self._feet, mission.seed, mission.site_seed, self._ice
        )

    @property
    def start(self) -> Start:
        """Start as given to a navigator."""
        camera = self._faults.calibration(self._camera)
        return Start(camera, self._faults.start(self._start), self._states[0].heading_rad)

    def until_the_end(
        self, writer: FrameWriter, navigator: Navigator | None, *, steers: bool
    ) -> tuple[Ending, Readings]:
        """Drive until the drive ends; return its ending and the readings after the last frame."""
        estimate: PoseEstimate | None = None
        while True:
            self._drive_on(estimate if steers else self._real_pose())
            if self._frame_is_due():
                readings = self._sensed(writer)
                estimate = None if navigator is None else navigator.step(readings)
                if estimate is not None and steers:
                    row = self._states[-1].time_s, *estimate.xy.tolist(), estimate.heading_rad
                    self._estimates.append(row)
            ending = self._monitor.ending(self._states, self._steered_xy)
            if ending is not None:
                last = self._read(RoverMotion.of(self._recent))
                self._log.add(last)
                return ending, last

    def follow(self, operator: DriveOperator, writer: FrameWriter) -> Ending:
        """Drive at the velocities of an operator until it ends the drive or the rover cannot go on."""
        velocity: Velocity | None = Velocity(0.0, 0.0)
        ending: Ending | None = None
        while velocity is not None and ending is None:
            stands = self._states[-1].time_s < STANDING_S
            self._roll(*((0.0, 0.0) if stands else skid_speeds(*velocity, self._mission.physics)))
            if self._frame_is_due():
                readings = self._sensed(writer)
            else:
                readings = self._read(RoverMotion.of(self._recent))
                self._log.add(readings)
            velocity = operator.step(readings, self._states[-1])
            ending = self._monitor.accident(self._states)
        return ending or Ending.BY_OPERATOR

    def _real_pose(self) -> PoseEstimate:
        state = self._states[-1]
        xy = np.array(state.position[:2])
        if self._ice is not None:
            xy = xy + self._ice.displacement(xy[None], np.array([state.time_s]))[0, :2]
        return PoseEstimate(xy, state.heading_rad)

    def _drive_on(self, estimate: PoseEstimate | None) -> None:
        """Drive for one period of the steering; stand still in the first second and without an estimate."""
        time_s = self._states[-1].time_s
        self._steered_xy = self._start[:2] if estimate is None else estimate.xy
        left, right = 0.0, 0.0
        if estimate is not None and time_s >= STANDING_S:
            if self._steered is not None:
                self._steered.extend(self._pursuit, estimate)
            wanted = self._pursuit.track_speeds(*estimate)
            left, right = self._backing.track_speeds(time_s, estimate.xy, wanted)
        self._roll(left, right)

    def _roll(self, left: float, right: float) -> None:
        """Drive for one period of the steering at speeds of the tracks [m/s]."""
        self._faults.drive(self._physics, self._states[-1].time_s)
        for _ in range(LOGGED_HZ // STEERED_HZ):
            for _ in range(self._mission.physics.rate_hz // LOGGED_HZ):
                self._physics.step(left, right)
            self._recent.append(self._physics.state)
        self._states.append(self._physics.state)
        self._rover_camera.drive_over(self._physics.state)

    def _frame_is_due(self) -> bool:
        """Return whether the rover has moved on until the last row of the next frame is exposed."""
        camera, imaging = self._camera, self._mission.imaging
        lasts_s = camera.row_readout_s * (camera.height - 1) + 0.5 * imaging.exposure_s
        return self._states[-1].time_s + 1e-9 >= self._next_frame_s + lasts_s

    @property
    def _next_frame_s(self) -> float:
        return self._n_frames / self._mission.instruments.frame_rate_hz

    def _sensed(self, writer: FrameWriter) -> Readings:
        """Take the next frame and read the instruments."""
        motion, time_s, index = RoverMotion.of(self._recent), self._next_frame_s, self._n_frames
        image = self._faults.image(time_s, index, self._rover_camera.frame(motion.pose_at, time_s, index))
        self._n_frames += 1
        if image is not None:
            writer.add(time_s, image)
            self._frame_times.append(time_s)
        readings = self._read(motion)
        self._log.add(readings)
        if self._steered is not None:
            self._steered.sense(readings)
        return replace(readings, frame=None if image is None else (time_s, image))

    def _read(self, motion: RoverMotion) -> Readings:
        """Read the instruments up to now, and drop motion that is no longer needed."""
        readings = self._instruments.read(motion)
        needed_from = min(self._next_frame_s, self._recent[-1].time_s) - _MEMORY_S
        self._recent = [state for state in self._recent if state.time_s >= needed_from]
        return readings

    def result(self, ending: Ending, folder: Path) -> SimulatedDrive:
        """Return recording and truth together."""
        recording = self._recording(ending, folder)
        return SimulatedDrive(
            recording,
            self._truth(recording),
            ending,
            self._pursuit.progress_m,
            self._states[-1].energy_j,
            self._pursuit.length_m,
            self._ground.hazards,
            estimates=np.array(self._estimates) if self._estimates else None,
        )

    def _recording(self, ending: Ending, folder: Path) -> Recording:
        records, ground, mission = self._log.records(), self._ground, self._mission
        if "gps" not in records:
            raise InputError(
                f"the drive ended after {self._states[-1].time_s:.1f} s ({ending.value}) with fewer than two GPS fixes; "
                "there is nothing to localize, drive longer or leave the receiver on."
            )
        frames = self._frames(folder / "frames")
        return Recording(
            ground.crs,
            self._faults.start(self._start),
            antenna_height_m=mission.rover.antenna_height_m,
            vertical_datum=ground.vertical_datum,
            camera=None if frames is None else self._faults.calibration(self._camera),
            frames=frames,
            **self._instruments.stake_tables(self._states[-1].time_s),
            **records,
        )

    def _frames(self, folder: Path) -> Frames | None:
        """Return the frames that arrived, or None; the folder of no frames is removed."""
        if self._frame_times:
            return Frames.read(folder)
        shutil.rmtree(folder)
        return None

    def _truth(self, recording: Recording) -> Truth:
        motion = RoverMotion.of(self._states)
        zero = np.zeros((len(self._states), 3, 3))
        trajectory = Trajectory(motion.time_s, motion.position, motion.quaternion, zero, self._ground.crs)
        truth = Truth(self._ground.dem, trajectory)
        if self._ice is None:
            return truth
        return self._ice.fixed_truth(truth, epoch_of(recording, self._mission))
