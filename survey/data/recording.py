"""Recording of one drive: its tables of sensor records, camera and images; the only input of localization.

`SensorTables` declares the tables: a field of it is written to and read from a CSV file, or a folder, of every recording.
`Readings` are the records of a stretch of a drive, as they arrive on board. `Recording` is a folder of such files with a
header; `OdometryRecording` is one with odometry and sightings.
"""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Self, get_args, get_type_hints

import numpy as np
from pyproj import CRS

from survey.core import DataObject, FloatArray, InputError, Section, checked, projected_crs, write_text
from survey.data.camera import Camera
from survey.data.frames import Frames, FrameWriter, Image
from survey.data.ice_motion import IceMotion
from survey.data.sensors.lidar import LidarScans
from survey.data.sensors.odometry import LoopClosures, Odometry, Sightings
from survey.data.sensors.records import Barometer, Compass, GpsFixes, Inertial, Weather, Wheels
from survey.data.sensors.stakes import Stakes, StakeSightings, StakeSurveys


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SensorTables(DataObject):
    """Optional tables of a recording; None where a sensor gave no readings.

    A field declared here is a table of every recording: it is written to and read from a CSV
    file, or a folder (`table_file`), and the simulator collects its readings.
    """

    odometry: Odometry | None = None
    barometer: Barometer | None = None
    sightings: Sightings | None = None
    wheels: Wheels | None = None
    inertial: Inertial | None = None
    compass: Compass | None = None
    weather: Weather | None = None
    base: GpsFixes | None = None
    base_barometer: Barometer | None = None
    stakes: Stakes | None = None
    stake_surveys: StakeSurveys | None = None
    stake_sightings: StakeSightings | None = None
    loop_closures: LoopClosures | None = None
    lidar: LidarScans | None = None


def table_types() -> dict[str, Any]:
    """Return the record type of every table of a recording, by the table's name.

    >>> table_types()["base"].__name__
    'GpsFixes'
    """
    hints = get_type_hints(SensorTables)
    optional = {field.name: get_args(hints[field.name])[0] for field in fields(SensorTables)}
    return {"gps": GpsFixes} | optional


def table_file(name: str) -> str:
    """Return the name of the file, or folder, of a table in a recording's folder.

    >>> table_file("gps"), table_file("loop_closures")
    ('gps.csv', 'closures.csv')
    """
    return _FILE_NAMES.get(name, f"{name}.csv")


_FILE_NAMES = {"loop_closures": "closures.csv", "lidar": "lidar"}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Readings(SensorTables):
    """Records of all sensors during a stretch of time; None for one without readings.

    The records are those of a `survey.data.recording.Recording`; `frame` is the image at the end
    of the stretch, with the time that the camera's clock shows.
    """

    gps: GpsFixes | None = None
    frame: tuple[float, Image] | None = None


class RecordingHeader(Section):
    """Keys of ``recording.json``."""

    format: str = "firnline-recording-1"
    crs: str
    """WKT of the projected CRS."""
    vertical_datum: str
    """What heights count from."""
    start_m: tuple[float, float, float]
    """Surveyed position of the start: easting, northing, elevation [m]."""
    antenna_height_m: float
    """Height of the GPS antenna above the ground [m]."""
    camera_height_m: float = 0.0
    """Height of the camera above the body's origin [m], for recordings without a camera's calibration."""
    start_is_surveyed: bool = True
    """Whether the start was surveyed; else it is the position of the first fix."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording(SensorTables):
    """The records of one drive.

    Without odometry and frames it is a kinematic GPS survey: the fixes themselves are the
    path. Frames with camera, wheels and inertial records are what visual odometry works
    on; `odometry` and `sightings` are what it gives, and what a recording holds whose
    images were processed before.

    Parameters
    ----------
    crs : str or pyproj.CRS
        Of the fixes and the start.
    start : (3,) array_like
        Surveyed position of the start [m]; the paper starts from a known place too.
    gps : GpsFixes
        In `crs`.
    odometry, barometer, sightings, wheels, inertial, compass, weather : optional
        What else the rover carries; sightings need odometry.
    camera, frames : optional
        Images; each needs the other.
    base, base_barometer : optional
        A second receiver and a second barometer that stand at `start`.
    stakes, stake_sightings : optional
        Benchmarks of surveyed position, and when they were seen.
    stake_surveys : optional
        Repeated surveys of stakes that move with the ice.
    loop_closures : optional
        Places of the drive that were recognized again.
    lidar : optional
        Scans of a LiDAR.
    antenna_height_m : float
        Height of the GPS antenna above the ground [m].
    vertical_datum : str
        What heights count from.
    camera_height_m : float
        Height of the camera above the body's origin [m]; used where there is no `camera`.
    start_is_surveyed : bool
        Whether `start` was surveyed. Else it is the position of the first fix, and localization
        takes it for unknown.
    ice_motion : IceMotion, optional
        Motion by which fixes, start, barometer and stakes were reduced to an epoch
        (`survey.reconstruction.motion.epoch.in_ice_frame`); it is not written to files.
    """

    crs: CRS
    start: FloatArray
    gps: GpsFixes
    antenna_height_m: float = 0.0
    vertical_datum: str = ""
    camera: Camera | None = None
    frames: Frames | None = None
    camera_height_m: float = 0.0
    start_is_surveyed: bool = True
    ice_motion: IceMotion | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "crs", projected_crs(self.crs, "the recording"))
        object.__setattr__(self, "start", checked(self.start, (3,), "the start of the recording"))
        if self.sightings is not None:
            self._check_sightings(self.sightings)
        if (self.camera is None) != (self.frames is None):
            lacking = "camera" if self.camera is None else "frames"
            raise InputError(f"the recording lacks {lacking}; images and calibration are needed together.")
        if self.stake_sightings is not None:
            surveyed = 0 if self.stake_surveys is None else int(self.stake_surveys.index.max()) + 1
            n_stakes = surveyed if self.stakes is None else len(self.stakes)
            seen = self.stake_sightings.index
            if seen.min() < 0 or seen.max() >= n_stakes:
                raise InputError(
                    f"a sighting names a stake outside 0 … {n_stakes - 1}; add it to stakes.csv."
                )

    @property
    def camera_in_body_m(self) -> FloatArray:
        """Place of the camera in the body frame (3,) [m]."""
        if self.camera is None:
            return np.array([0.0, 0.0, self.camera_height_m])
        return self.camera.T_body_camera[:3, 3]

    def _summary(self) -> str:
        sensed = [name for name in (*table_types(), "frames") if getattr(self, name) is not None]
        return f"{', '.join(sensed)}, {self.crs.name}"

    def with_odometry(self, odometry: Odometry, sightings: Sightings) -> "OdometryRecording":
        """Return the recording with another odometry and the landmarks sighted from its poses.

        Parameters
        ----------
        odometry : Odometry
            Steps and attitudes.
        sightings : Sightings
            Landmarks relative to the poses of `odometry`.

        Returns
        -------
        OdometryRecording
            All other records are unchanged.
        """
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return OdometryRecording(**(values | {"odometry": odometry, "sightings": sightings}))

    def _check_sightings(self, sightings: Sightings) -> None:
        if self.odometry is None:
            raise InputError(
                "the recording has sightings and no odometry to place them from; add odometry.csv."
            )
        n_poses = len(self.odometry.time_s)
        if len(sightings.pose) and not 0 <= sightings.pose.min() <= sightings.pose.max() < n_poses:
            raise InputError(
                f"a sighting names a pose outside 0 … {n_poses - 1}; odometry and sightings do not belong together."
            )

    def write(self, folder: str | Path) -> None:
        """Write ``recording.json``, one CSV table per sensor, ``lidar/``, ``camera.toml`` and ``frames/``.

        Frames that a `FrameWriter` has written into ``frames/`` of this folder before are not
        written again.

        Parameters
        ----------
        folder : str or pathlib.Path
            Missing, or empty except for ``frames/``.

        Raises
        ------
        InputError
            The folder holds something else, or may not be written to.
        """
        place = Path(folder)
        if place.exists() and any(item.name != "frames" for item in place.iterdir()):
            raise InputError(f"the recording folder {place} exists and is not empty; choose another one.")
        place.mkdir(parents=True, exist_ok=True)
        if self.frames is not None and not (place / "frames" / "frames.csv").exists():
            with FrameWriter(place / "frames") as writer:
                for index, time_s in enumerate(self.frames.time_s):
                    writer.add(time_s, self.frames[index])
        if self.camera is not None:
            self.camera.write(place / "camera.toml")
        for name in table_types():
            sensor = getattr(self, name)
            if sensor is not None:
                sensor.write(place / table_file(name))
        east, north, up = self.start.tolist()
        header = RecordingHeader(
            crs=self.crs.to_wkt(),
            vertical_datum=self.vertical_datum,
            start_m=(east, north, up),
            antenna_height_m=self.antenna_height_m,
            camera_height_m=self.camera_height_m,
            start_is_surveyed=self.start_is_surveyed,
        )
        write_text(place / "recording.json", header.model_dump_json(indent=2) + "\n")

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read the files of `write`; images are read when they are used.

        Parameters
        ----------
        folder : str or pathlib.Path
            The folder of the recording.

        Returns
        -------
        Recording
            All tables that the folder has.

        Raises
        ------
        InputError
            A table is missing, cut off or holds something that is no number.
        """
        place = Path(folder)
        file = place / "recording.json"
        if not file.is_file():
            raise InputError(
                f"{place} is no recording (it holds no recording.json); name a folder that `simulate` made."
            )
        try:
            header = RecordingHeader.model_validate_json(file.read_bytes())
        except ValueError as error:
            raise InputError(
                f"{file} is damaged ({str(error).splitlines()[0]}); make the recording again."
            ) from error
        sensed: dict[str, Any] = {
            name: kind.read(place / table_file(name))
            for name, kind in table_types().items()
            if name == "gps" or (place / table_file(name)).exists()
        }
        return cls(
            crs=projected_crs(header.crs, str(file)),
            start=np.array(header.start_m),
            antenna_height_m=header.antenna_height_m,
            camera_height_m=header.camera_height_m,
            start_is_surveyed=header.start_is_surveyed,
            vertical_datum=header.vertical_datum,
            camera=Camera.read(place / "camera.toml") if (place / "camera.toml").exists() else None,
            frames=Frames.read(place / "frames") if (place / "frames").exists() else None,
            **sensed,
        )


@dataclass(frozen=True, eq=False, repr=False)
class OdometryRecording(Recording):
    """A recording that has odometry and sightings: what the estimators of a path and its landmarks take.

    `Recording.with_odometry` makes one.

    `crs`: as in `Recording`. `start` (3,): as in `Recording` [m]. `gps`: as in `Recording`.
    `antenna_height_m`, `vertical_datum`, `camera`, `frames`, `camera_height_m`, `start_is_surveyed`: as in
    `Recording`. `odometry`: motion from pose to pose. `sightings`: landmarks seen from these poses.
    `barometer`, `wheels`, `inertial`, `compass`, `weather`, `base`, `base_barometer`, `loop_closures`,
    `lidar`: as in `Recording`. `stakes`, `stake_surveys`, `stake_sightings`, `ice_motion`: as in `Recording`.
    """

    odometry: Odometry = field(kw_only=True)
    sightings: Sightings = field(kw_only=True)
