"""The vision fidelity: a rover drives a route over fine ground, and its instruments and camera record it.

Open loop, the rover steers by where it really is; closed loop, by where a navigator
believes it to be from what was recorded so far. How the drive ends is named: see `Ending`.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from sim.config.mission import MissionConfig
from sim.instruments.camera import rover_camera
from sim.instruments.suite import Instruments, Log, Readings
from sim.simulate.assembly import eye_of, physics_of, stakes_beside
from sim.simulate.faults import Faults
from sim.simulate.preview import write_contact_sheet, write_preview
from sim.vehicle.motion import RoverMotion
from sim.vehicle.physics import RoverState
from sim.vehicle.pursuit import BackingOff, PurePursuit
from sim.world.hazards import Hazard
from sim.world.scenery import FineTerrain, fine_terrain
from survey.core.arrays import FloatArray
from survey.core.documents import write_json
from survey.core.errors import ConfigError, InputError
from survey.data.camera import Camera, Frames, FrameWriter
from survey.data.dem import Dem
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.trajectory import Trajectory
from survey.data.truth import Truth
from survey.interchange.tum_euroc import write_tum_list
from survey.io.tables import write_table
from survey.io.vector import write_features
from vision_slam.odometry.onboard import write_seen
from vision_slam.odometry.visual_slam import VisualOdometry

LOGGED_HZ = 80
"""States kept per second: sensors read from them, and `Truth` holds some."""
STEERED_HZ = 20
ONBOARD = "onboard"
"""Folder, within the recording's, of what the onboard computer made of the images."""

_STAND_S = 1.0
_KEPT_S = 0.5
_TIPPED_COS = np.cos(np.radians(65.0))
_FELL_M = 0.8
_EDGE_M = 3.0  # a rover that turns at the end of a swath swings out by so much
_STALLED_S, _STALLED_M = 20.0, 0.5
_SILENT_WHEN_CARRIED = ("inertial", "barometer", "compass", "weather", "stake_sightings")


class Ending(Enum):
    """How a drive ended."""

    ARRIVED = "arrived"
    STALLED = "stalled"
    TIPPED_OVER = "tipped over"
    FELL = "fell"
    BATTERY_EMPTY = "battery empty"
    LEFT_THE_MAP = "left the map"
    OUT_OF_TIME = "out of time"


class PoseEstimate(NamedTuple):
    """Where a navigator thinks that the rover is: ``xy`` (2,) [m] and ``heading_rad`` from east."""

    xy: FloatArray
    heading_rad: float


class Navigator(Protocol):
    """Steers by estimate: gets what was sensed and nothing else."""

    def step(self, readings: Readings, /) -> PoseEstimate:
        """Take the readings since the last call in, the newest frame among them, and say where the rover is."""
        ...

    def finish(self, readings: Readings, /) -> VisualOdometry | None:
        """Take what was read after the last frame in; return what the images gave, if they were looked at."""
        ...


@dataclass(frozen=True)
class Start:
    """What a navigator knows before the drive: the calibration, and where it is said to begin.

    ``position`` (3,) [m] and ``heading_rad`` from east are those of the recording: a
    kidnapped rover is told wrong ones.
    """

    camera: Camera
    position: FloatArray
    heading_rad: float


@dataclass(frozen=True)
class SimulatedDrive:
    """What came of a drive.

    Parameters
    ----------
    recording : Recording
        What was sensed; frames are in the drive's folder.
    truth : Truth
        The ground and the real path, 20 poses a second.
    ending : Ending
        How it ended.
    progress_m : float
        How far along its route the rover got [m].
    energy_j : float
        What the battery gave [J].
    route_m : float
        Length of the route [m].
    hazards : tuple of Hazard
        Crevasses, channels, pools and cones of the ground.
    seen : VisualOdometry, optional
        What the images gave on board.
    believed : (N, 4) ndarray, optional
        Of a drive that was steered by estimate, at every frame: time [s], easting and northing
        [m] and heading [rad] that were believed.
    """

    recording: Recording
    truth: Truth
    ending: Ending
    progress_m: float
    energy_j: float
    route_m: float
    hazards: tuple[Hazard, ...]
    seen: VisualOdometry | None = None
    believed: FloatArray | None = None

    def write(self, folder: Path) -> None:
        """Write recording and truth, how the drive went (``drive.json``), its hazards, and what it looks like."""
        self.recording.write(folder / "recording")
        if self.seen is not None:
            write_seen(self.seen, folder / "recording" / ONBOARD)
        self.truth.write(folder / "truth")
        content = {
            "ending": self.ending.value,
            "progress_m": round(self.progress_m, 2),
            "route_m": round(self.route_m, 2),
            "duration_s": float(self.truth.trajectory.time_s[-1]),
            "energy_j": round(self.energy_j, 1),
        }
        write_json(folder / "drive.json", content)
        if self.believed is not None:
            columns = dict(
                zip(("time_s", "easting_m", "northing_m", "heading_rad"), self.believed.T, strict=True)
            )
            write_table(folder / "believed.csv", columns)
        if self.hazards:
            kinds = np.array([hazard.kind for hazard in self.hazards], dtype=object)
            outlines = [hazard.outline for hazard in self.hazards]
            write_features(
                folder / "hazards.geojson", outlines, {"kind": kinds}, self.recording.crs, layer="hazards"
            )
        if self.recording.frames is not None:
            write_tum_list(self.recording.frames, folder / "recording")
            write_preview(self.recording.frames, folder / "preview.mp4")
            write_contact_sheet(self.recording.frames, folder / "contact_sheet.png")


def simulate_vision(
    terrain: Dem,
    route: Route,
    mission: MissionConfig,
    folder: Path,
    navigate: Callable[[Start], Navigator] | None = None,
    *,
    steers: bool = True,
) -> SimulatedDrive:
    """Drive a route over fine ground and record what instruments and camera sense.

    Parameters
    ----------
    terrain : Dem
        The site; fine relief and hazards of ``mission.scenery`` are put on it.
    route : Route
        Of one rover.
    mission : MissionConfig
        Everything else.
    folder : pathlib.Path
        Where the recording is to be; its images are written while the rover drives.
    navigate : callable, optional
        Gives, for the start, the navigator that steers by estimate; without one the rover
        keeps to its route by where it really is.
    steers : bool
        Whether the navigator does; else it looks on, and the rover keeps to its route.

    Raises
    ------
    InputError
        The route leaves the terrain, or the folder exists and is not empty.
    ConfigError
        The rates of physics and instruments do not go together, or Bullet is missing.
    """
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"the recording folder {folder} exists and is not empty; choose another one.")
    ground = fine_terrain(terrain, mission.scenery, mission.seed)
    path = route.path()
    _check(ground, path, mission)
    run = _Run(ground, path, mission)
    navigator = None if navigate is None else navigate(run.start)
    with FrameWriter(folder / "frames") as writer:
        ending = run.until_the_end(writer, navigator, steers=steers and navigator is not None)
    return run.result(ending, folder)


def _check(ground: FineTerrain, path: FloatArray, mission: MissionConfig) -> None:
    """Refuse what cannot be driven before anything is written."""
    xmin, ymin, xmax, ymax = ground.bounds
    outside = ((path < [xmin + _EDGE_M, ymin + _EDGE_M]) | (path > [xmax - _EDGE_M, ymax - _EDGE_M])).any(
        axis=1
    )
    if outside.any():
        east, north = path[outside][0]
        raise InputError(
            f"the route comes at ({east:.1f}, {north:.1f}) within {_EDGE_M:g} m of where the terrain ends, whose bounds are "
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
    """A drive on its way."""

    def __init__(self, ground: FineTerrain, path: FloatArray, mission: MissionConfig) -> None:
        self._ground, self._mission = ground, mission
        self._faults = Faults(mission.faults, mission.seed)
        self._pursuit = PurePursuit(path, mission.rover.speed_m_s, mission.physics)
        self._backing = BackingOff(mission.rover.speed_m_s)
        self._physics = physics_of(ground, path, mission)
        self._every = mission.physics.rate_hz // LOGGED_HZ
        self._states = [self._physics.state]
        self._recent = [self._physics.state]
        antenna = np.array([0.0, 0.0, mission.rover.antenna_height_m])
        self._start = np.array(self._physics.state.position)
        self._believed_xy = self._start[:2]
        stakes = stakes_beside(ground, self._pursuit, mission)
        self._instruments = Instruments(
            mission.instruments, mission.rover.antenna_height_m, self._start + antenna, stakes, mission.seed
        )
        self._log = Log()
        self._camera = rover_camera(mission.imaging)
        self._eye = eye_of(ground, self._faults.appearance(mission.appearance), self._camera, mission)
        self._n_frames, self._frame_times = 0, list[float]()
        self._seen: VisualOdometry | None = None
        self._believed: list[tuple[float, ...]] = []

    @property
    def start(self) -> Start:
        """What is said of the start."""
        camera = self._faults.calibration(self._camera)
        return Start(camera, self._faults.start(self._start), _heading(self._states[0]))

    def until_the_end(self, writer: FrameWriter, navigator: Navigator | None, *, steers: bool) -> Ending:
        """Drive until something ends the drive."""
        belief: PoseEstimate | None = None
        while True:
            self._drive_on(belief if steers else self._really())
            if self._frame_is_due():
                readings = self._sensed(writer)
                belief = None if navigator is None else navigator.step(readings)
                if belief is not None and steers:
                    self._believed.append((self._states[-1].time_s, *belief.xy.tolist(), belief.heading_rad))
            ending = self._ending()
            if ending is not None:
                last = self._read(RoverMotion.of(self._recent))
                self._log.add(last)
                self._seen = None if navigator is None else navigator.finish(last)
                return ending

    def _really(self) -> PoseEstimate:
        state = self._states[-1]
        return PoseEstimate(np.array(state.position[:2]), _heading(state))

    def _drive_on(self, belief: PoseEstimate | None) -> None:
        """Drive for a tick of the steering; stand still for a second first, and while nothing is believed."""
        time_s = self._states[-1].time_s
        waits = belief is None or time_s < _STAND_S
        self._believed_xy = self._start[:2] if belief is None else belief.xy
        left, right = 0.0, 0.0
        if belief is not None and not waits:
            wanted = self._pursuit.track_speeds(*belief)
            left, right = self._backing.track_speeds(time_s, belief.xy, wanted)
        self._faults.drive(self._physics, time_s)
        for _ in range(LOGGED_HZ // STEERED_HZ):
            for _ in range(self._every):
                self._physics.step(left, right)
            self._recent.append(self._physics.state)
        self._states.append(self._physics.state)

    def _frame_is_due(self) -> bool:
        """Tell whether the rover has moved on until the last row of the next frame is exposed."""
        camera, imaging = self._camera, self._mission.imaging
        lasts_s = camera.row_readout_s * (camera.height - 1) + 0.5 * imaging.exposure_s
        return self._states[-1].time_s + 1e-9 >= self._next_frame_s + lasts_s

    @property
    def _next_frame_s(self) -> float:
        return self._n_frames / self._mission.instruments.frame_rate_hz

    def _sensed(self, writer: FrameWriter) -> Readings:
        """Take the next frame and read the instruments."""
        motion, time_s, index = RoverMotion.of(self._recent), self._next_frame_s, self._n_frames
        image = self._faults.image(time_s, index, self._eye.frame(motion.pose_at, time_s, index))
        self._n_frames += 1
        if image is not None:
            writer.add(time_s, image)
            self._frame_times.append(time_s)
        readings = self._read(motion)
        self._log.add(readings)
        return replace(readings, frame=None if image is None else (time_s, image))

    def _read(self, motion: RoverMotion) -> Readings:
        """Read the instruments up to now, and forget motion that nobody reads any more."""
        readings = self._instruments.read(motion)
        kept_from = min(self._next_frame_s, self._recent[-1].time_s) - _KEPT_S
        self._recent = [state for state in self._recent if state.time_s >= kept_from]
        faults = self._faults
        awake = {name: faults.awake(getattr(readings, name)) for name in _SILENT_WHEN_CARRIED}
        gps, wheels = faults.fixes(readings.gps), faults.counts(readings.wheels)
        return replace(readings, gps=gps, wheels=wheels, **awake)

    def _ending(self) -> Ending | None:
        """Return how the drive has ended, if it has."""
        state, battery_j = self._states[-1], self._mission.rover.battery_j
        xmin, ymin, xmax, ymax = self._ground.bounds
        x, y, z = state.position
        a_second_ago = self._states[max(len(self._states) - 1 - STEERED_HZ, 0)]
        limit_s = 3.0 * self._pursuit.length_m / self._mission.rover.speed_m_s + 60.0
        reasons = {
            Ending.LEFT_THE_MAP: not (xmin < x < xmax and ymin < y < ymax),
            Ending.TIPPED_OVER: _upright(state) < _TIPPED_COS,
            Ending.FELL: a_second_ago.position[2] - z > _FELL_M,
            Ending.BATTERY_EMPTY: battery_j is not None and state.energy_j > battery_j,
            Ending.ARRIVED: self._pursuit.is_done(self._believed_xy),
            Ending.STALLED: self._is_stuck(),
            Ending.OUT_OF_TIME: state.time_s > limit_s,
        }
        return next((ending for ending, is_so in reasons.items() if is_so), None)

    def _is_stuck(self) -> bool:
        """Tell whether the rover is where it was some time ago."""
        n = round(_STALLED_S * STEERED_HZ)
        if len(self._states) <= n + _STAND_S * STEERED_HZ:
            return False
        then, now = self._states[-1 - n].position, self._states[-1].position
        return bool(np.hypot(now[0] - then[0], now[1] - then[1]) < _STALLED_M)

    def _frames(self, folder: Path) -> Frames | None:
        """Return the frames that arrived; without any there is no folder of frames either."""
        if self._frame_times:
            return Frames.read(folder)
        shutil.rmtree(folder)
        return None

    def result(self, ending: Ending, folder: Path) -> SimulatedDrive:
        """Put recording and truth together."""
        records = self._log.records()
        if records["gps"] is None:
            raise InputError(
                f"the drive ended after {self._states[-1].time_s:.1f} s ({ending.value}) with fewer than two GPS fixes; "
                "there is nothing to localize, drive longer or leave the receiver on."
            )
        ground, mission = self._ground, self._mission
        frames = self._frames(folder / "frames")
        recording = Recording(
            ground.crs,
            self._faults.start(self._start),
            antenna_height_m=mission.rover.antenna_height_m,
            vertical_datum=ground.vertical_datum,
            stakes=self._instruments.spotter.stakes,
            camera=None if frames is None else self._faults.calibration(self._camera),
            frames=frames,
            **records,
        )
        motion = RoverMotion.of(self._states)
        zero = np.zeros((len(self._states), 3, 3))
        trajectory = Trajectory(motion.time_s, motion.position, motion.quaternion, zero, ground.crs)
        return SimulatedDrive(
            recording,
            Truth(ground.dem, trajectory),
            ending,
            self._pursuit.progress_m,
            self._states[-1].energy_j,
            self._pursuit.length_m,
            ground.hazards,
            self._seen,
            np.array(self._believed) if self._believed else None,
        )


def _heading(state: RoverState) -> float:
    x, y, z, w = state.quaternion
    return float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))


def _upright(state: RoverState) -> float:
    """Cosine of the body's tilt."""
    x, y, _, _ = state.quaternion
    return 1.0 - 2.0 * (x * x + y * y)
