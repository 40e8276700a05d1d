"""What a rover senses and nothing else: the only thing that localization is given."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from pyproj import CRS

from survey.arrays import FloatArray, IntArray, checked
from survey.config import Section
from survey.errors import InputError
from survey.geodesy import projected_crs
from survey.io.files import replacing
from survey.io.tables import read_table, write_table


@dataclass(frozen=True)
class GpsFixes:
    """Positions from a satellite receiver: ``time_s`` (N,), ``position`` (N, 3) east, north, up [m]."""

    time_s: FloatArray
    position: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", _times(self.time_s, "GPS fixes"))
        object.__setattr__(
            self, "position", checked(self.position, (len(self.time_s), 3), "the GPS positions")
        )


@dataclass(frozen=True)
class Odometry:
    """Incremental motion from vision and wheels.

    Parameters
    ----------
    time_s : (N,) array_like
        Times of the poses [s].
    step : (N - 1, 3) array_like
        Motion from each pose to the next [m], in the body frame of the earlier one
        (x forward, y left, z up).
    attitude_rad : (N, 3) array_like
        Roll, pitch (nose down positive) and yaw (counter-clockwise from east), of the
        body in the world.
    """

    time_s: FloatArray
    step: FloatArray
    attitude_rad: FloatArray

    def __post_init__(self) -> None:
        time_s = _times(self.time_s, "odometry")
        object.__setattr__(self, "time_s", time_s)
        object.__setattr__(
            self, "step", checked(self.step, (len(time_s) - 1, 3), "the steps of the odometry")
        )
        object.__setattr__(
            self, "attitude_rad", checked(self.attitude_rad, (len(time_s), 3), "the attitudes")
        )


@dataclass(frozen=True)
class Barometer:
    """Pressure altitude: ``time_s`` (N,), ``height_m`` (N,) above an unknown datum."""

    time_s: FloatArray
    height_m: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", _times(self.time_s, "barometer readings"))
        object.__setattr__(
            self, "height_m", checked(self.height_m, (len(self.time_s),), "the barometer heights")
        )


@dataclass(frozen=True)
class Sightings:
    """Landmarks as triangulated from the rover.

    Parameters
    ----------
    pose : (M,) array_like of int
        Index of the odometry pose from which the landmark is given.
    offset : (M, 3) array_like
        Landmark relative to the body [m], body frame.
    covariance : (M, 3, 3) array_like
        Of `offset` [m²].
    range_m : (M,) array_like
        Distance at first sight [m].
    """

    pose: IntArray
    offset: FloatArray
    covariance: FloatArray
    range_m: FloatArray

    def __post_init__(self) -> None:
        pose = np.array(self.pose, dtype=np.int64)
        pose.flags.writeable = False
        m = len(pose)
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "offset", checked(self.offset, (m, 3), "the landmark offsets"))
        object.__setattr__(
            self, "covariance", checked(self.covariance, (m, 3, 3), "the landmark covariances")
        )
        object.__setattr__(self, "range_m", checked(self.range_m, (m,), "the landmark ranges"))


class RecordingHeader(Section):
    """What stands in ``recording.json``."""

    format: str = "firnline-recording-1"
    crs: str
    """WKT of the projected CRS."""
    vertical_datum: str
    """What heights count from."""
    start_m: tuple[float, float, float]
    """Surveyed position of the start: easting, northing, elevation [m]."""
    antenna_height_m: float
    """Height of the GPS antenna above the ground [m]."""


@dataclass(frozen=True)
class Recording:
    """The records of one drive.

    Without odometry it is a kinematic GPS survey: the fixes themselves are the path.

    Parameters
    ----------
    crs : str or pyproj.CRS
        Of the fixes and the start.
    start : (3,) array_like
        Surveyed position of the start [m]; the paper starts from a known place too.
    gps : GpsFixes
        In `crs`.
    odometry, barometer, sightings : optional
        What else the rover carries; sightings need odometry.
    antenna_height_m : float
        Height of the GPS antenna above the ground [m].
    vertical_datum : str
        What heights count from.
    """

    crs: CRS
    start: FloatArray
    gps: GpsFixes
    odometry: Odometry | None = None
    barometer: Barometer | None = None
    sightings: Sightings | None = None
    antenna_height_m: float = 0.0
    vertical_datum: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "crs", projected_crs(self.crs, "the recording"))
        object.__setattr__(self, "start", checked(self.start, (3,), "the start of the recording"))
        if self.sightings is not None:
            if self.odometry is None:
                raise InputError(
                    "the recording has sightings and no odometry to place them from; add odometry.csv."
                )
            n_poses = len(self.odometry.time_s)
            if (
                len(self.sightings.pose)
                and not 0 <= self.sightings.pose.min() <= self.sightings.pose.max() < n_poses
            ):
                raise InputError(
                    f"a sighting names a pose outside 0 … {n_poses - 1}; odometry and sightings do not belong together."
                )

    def write(self, folder: str | Path) -> None:
        """Write ``recording.json`` and one CSV table a sensor into a new folder."""
        place = Path(folder)
        if place.exists() and any(place.iterdir()):
            raise InputError(f"the recording folder {place} exists and is not empty; choose another one.")
        place.mkdir(parents=True, exist_ok=True)
        east, north, up = self.start.tolist()
        header = RecordingHeader(
            crs=self.crs.to_wkt(),
            vertical_datum=self.vertical_datum,
            start_m=(east, north, up),
            antenna_height_m=self.antenna_height_m,
        )
        with replacing(place / "recording.json") as draft:
            draft.write_text(header.model_dump_json(indent=2) + "\n", encoding="utf-8")
        for name, columns in self._tables().items():
            write_table(place / f"{name}.csv", columns)

    def _tables(self) -> dict[str, dict[str, FloatArray]]:
        tables = {"gps": {"time_s": self.gps.time_s, **_columns(_GPS[1:], self.gps.position)}}
        if self.odometry is not None:
            # The first pose is reached by no step: a row of zeros keeps one row a pose.
            steps = np.vstack([np.zeros((1, 3)), self.odometry.step])
            tables["odometry"] = {
                "time_s": self.odometry.time_s,
                **_columns(_ODOMETRY[1:], np.hstack([steps, self.odometry.attitude_rad])),
            }
        if self.barometer is not None:
            tables["barometer"] = {"time_s": self.barometer.time_s, "height_m": self.barometer.height_m}
        if self.sightings is not None:
            s = self.sightings
            covariance = s.covariance[:, _UPPER[0], _UPPER[1]]
            body = np.column_stack([s.pose.astype(np.float64), s.offset, s.range_m, covariance])
            tables["sightings"] = _columns(_SIGHTINGS, body)
        return tables

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read a recording that `write` wrote.

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
        return cls(
            projected_crs(header.crs, str(file)),
            np.array(header.start_m),
            _read_gps(place),
            _read_odometry(place),
            _read_barometer(place),
            _read_sightings(place),
            header.antenna_height_m,
            header.vertical_datum,
        )


_GPS = ("time_s", "easting_m", "northing_m", "height_m")
_ODOMETRY = ("time_s", "forward_m", "left_m", "up_m", "roll_rad", "pitch_rad", "yaw_rad")
_SIGHTINGS = (
    *("pose", "forward_m", "left_m", "up_m", "range_m"),
    *("var_ff_m2", "cov_fl_m2", "cov_fu_m2", "var_ll_m2", "cov_lu_m2", "var_uu_m2"),
)
_UPPER = np.triu_indices(3)


def _times(time_s: Any, what: str) -> FloatArray:
    times = checked(time_s, (None,), f"the times of the {what}")
    if len(times) < 2:
        raise InputError(f"there are {len(times)} {what}; at least 2 are needed.")
    if (np.diff(times) <= 0).any():
        raise InputError(f"the times of the {what} do not increase; sort them or remove repeats.")
    return times


def _columns(names: tuple[str, ...], array: FloatArray) -> dict[str, FloatArray]:
    return dict(zip(names, array.T, strict=True))


def _read_gps(place: Path) -> GpsFixes:
    table = read_table(place / "gps.csv", _GPS, what="the GPS table")
    return GpsFixes(table["time_s"], np.column_stack([table[name] for name in _GPS[1:]]))


def _read_odometry(place: Path) -> Odometry | None:
    if not (place / "odometry.csv").exists():
        return None
    table = read_table(place / "odometry.csv", _ODOMETRY, what="the odometry table")
    body = np.column_stack([table[name] for name in _ODOMETRY[1:]])
    return Odometry(table["time_s"], body[1:, :3], body[:, 3:])


def _read_barometer(place: Path) -> Barometer | None:
    if not (place / "barometer.csv").exists():
        return None
    table = read_table(place / "barometer.csv", ("time_s", "height_m"), what="the barometer table")
    return Barometer(table["time_s"], table["height_m"])


def _read_sightings(place: Path) -> Sightings | None:
    if not (place / "sightings.csv").exists():
        return None
    table = read_table(place / "sightings.csv", _SIGHTINGS, what="the table of sightings")
    body = np.column_stack([table[name] for name in _SIGHTINGS])
    covariance = np.empty((len(body), 3, 3))
    covariance[:, _UPPER[0], _UPPER[1]] = covariance[:, _UPPER[1], _UPPER[0]] = body[:, 5:]
    return Sightings(body[:, 0].astype(np.int64), body[:, 1:4], covariance, body[:, 4])
