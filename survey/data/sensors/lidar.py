"""LiDAR scans of a drive: geometry of the scanner, returns of each turn, and their folder.

A `Scanner` is a spinning LiDAR with its stated errors. `LidarReturns` are ranges as it records them; `SensorScan` has the
places of returns in the frame of the vehicle. `LidarScans` stores the scans of a drive minute by minute.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, NonNegativeFloat, PositiveFloat

from survey.core import (
    DataObject,
    FloatArray,
    InputError,
    Section,
    checked,
    first_line,
    read_json,
    write_json,
)
from survey.core.time_units import LONGEST_STEP_S, refuse_other_unit
from survey.io.arrays_file import read_npz, write_npz
from survey.io.tables import read_table, write_table


class Scanner(Section):
    """Geometry and stated errors of a spinning LiDAR, as its data sheet and its mounting give them.

    >>> Scanner(elevation_deg=(0.0,), n_columns=4).rays()[1, 0].round(6).tolist()
    [0.0, 1.0, 0.0]
    """

    elevation_deg: tuple[float, ...] = Field(min_length=1, max_length=255)
    """Angles of the beams above the scanner's plane [deg]."""
    n_columns: int = Field(ge=1, le=65535)
    """Directions per turn."""
    turn_s: PositiveFloat = 0.1
    """Duration of a turn [s]."""
    mount_m: tuple[float, float, float] = (0.0, 0.0, 1.5)
    """Place of the scanner in the body's frame: forward, left, up [m]; its axes are those of the body."""
    range_sigma_m: PositiveFloat = 0.03
    """Standard deviation of a range [m]."""
    angle_sigma_deg: NonNegativeFloat = 0.05
    """Standard deviation of a beam's direction, with the divergence of the pulse [deg]."""

    @classmethod
    def hdl_64(cls) -> "Scanner":
        """Return the Velodyne HDL-64: 32 beams from 2° to -8.33° and 32 from -8.83° to -24.33°, 2083 columns."""
        upper, lower = np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.33, 32)
        return cls(elevation_deg=(*upper.tolist(), *lower.tolist()), n_columns=2083)

    def rays(self) -> FloatArray:
        """Return the directions of all beams; columns turn counter-clockwise from ahead.

        Returns (n_columns, n_beams, 3): unit vectors in the body's frame.
        """
        azimuth = 2.0 * np.pi * np.arange(self.n_columns)[:, None] / self.n_columns
        up = np.radians(self.elevation_deg)[None]
        return np.stack(
            [np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up) + 0.0 * azimuth], axis=-1
        )


_KINDS = {"scan": np.uint32, "column": np.uint16, "beam": np.uint8, "range_mm": np.uint32}


class LidarReturns(NamedTuple):
    """Returns of some scans, in the order of the scans.

    `scan` (N,): number of the scan in the recording. `column` (N,): direction of the turn. `beam` (N,):
    number of the beam. `range_mm` (N,): distance from the scanner [mm].
    """

    scan: npt.NDArray[np.uint32]
    column: npt.NDArray[np.uint16]
    beam: npt.NDArray[np.uint8]
    range_mm: npt.NDArray[np.uint32]

    @classmethod
    def of(cls, scan: Any, column: Any, beam: Any, range_m: FloatArray) -> Self:
        """Return the returns of whole numbers and ranges (N,) [m], which are rounded to millimetres.

        `scan`, `column`, `beam` (N,) int: as in the class. `range_m` (N,): distances [m].
        """
        columns = zip(_KINDS.values(), (scan, column, beam, np.rint(1e3 * range_m)), strict=True)
        return cls(*(np.asarray(values).astype(kind) for kind, values in columns))

    def part(self, begin: int, end: int) -> Self:
        """Return the returns from one number up to another."""
        return type(self)(
            self.scan[begin:end], self.column[begin:end], self.beam[begin:end], self.range_mm[begin:end]
        )

    def write(self, path: str | Path) -> None:
        """Write one compressed ``.npz`` file; equal returns give equal bytes."""
        write_npz(path, self._asdict())

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read what `write` wrote."""
        stored = read_npz(path, "the minute of LiDAR scans", "make the recording again")
        found = {name: (values.dtype, values.ndim) for name, values in stored.items()}
        wanted = {name: (np.dtype(kind), 1) for name, kind in _KINDS.items()}
        if found != wanted or len({len(values) for values in stored.values()}) != 1:
            raise InputError(
                f"{path} holds {', '.join(found) or 'nothing'}; columns {', '.join(wanted)} of equal length were "
                "expected, make the recording again."
            )
        return cls(**{name: stored[name] for name in _KINDS})


class SensorScan(NamedTuple):
    """Returns of one scan in the frame of the vehicle that carried the sensor.

    Parameters
    ----------
    time_s : (N,) ndarray
        Time of each return [s].
    xyz : (N, 3) ndarray
        Places: forward, left, up [m], each in the frame of the vehicle at its own time.
    sensor : (3,) ndarray
        Place of the sensor in that frame [m].
    """

    time_s: FloatArray
    xyz: FloatArray
    sensor: FloatArray


MINUTE_S = 60.0
"""Time whose returns are stored in one file [s]."""
_SCANNER, _TIMES = "scanner.json", "scans.csv"


class Minutes(Protocol):
    """Returns of consecutive minutes, read or made when they are used."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> LidarReturns: ...


@dataclass(frozen=True, eq=False, repr=False)
class LidarScans(DataObject):
    """Scans of a spinning LiDAR on a drive.

    Iterating gives each scan as a `SensorScan`, with the time of every return.

    Parameters
    ----------
    scanner : Scanner
        Geometry and stated errors.
    time_s : (S,) array_like
        Times at which the turns begin [s], increasing.
    minutes : Minutes
        Returns of each minute since the first scan, such as a list of `LidarReturns`.

    Raises
    ------
    InputError
        No scan, times that do not increase, or another number of minutes than the times take.

    Examples
    --------
    >>> scanner = Scanner(elevation_deg=(-30.0,), n_columns=4, mount_m=(0.0, 0.0, 1.0))
    >>> one = LidarScans(scanner, [5.0], [LidarReturns.of([0], [1], [0], np.array([2.0]))])
    >>> next(iter(one)).xyz.round(3).tolist()
    [[0.0, 1.732, 0.0]]
    """

    scanner: Scanner
    time_s: FloatArray
    minutes: Minutes

    def __post_init__(self) -> None:
        times = checked(self.time_s, (None,), "the times of the scans")
        if len(times) == 0 or (np.diff(times) <= 0.0).any():
            raise InputError(
                f"there are {len(times)} scans, or their times do not increase; at least one in order of time is needed."
            )
        refuse_other_unit(times, "the times of the scans", LONGEST_STEP_S)
        object.__setattr__(self, "time_s", times)
        if len(self.minutes) != n_minutes(times):
            raise InputError(
                f"the scans take {n_minutes(times)} minutes, and returns of {len(self.minutes)} are there; make the "
                "recording again."
            )

    def __len__(self) -> int:
        return len(self.time_s)

    def _summary(self) -> str:
        return f"{len(self)} scans of {len(self.scanner.elevation_deg)} beams"

    def _compared(self) -> dict[str, Any]:
        minutes = [tuple(self.minutes[k]) for k in range(len(self.minutes))]
        return {"scanner": self.scanner, "time_s": self.time_s, "minutes": minutes}

    def __iter__(self) -> Iterator[SensorScan]:
        rays = self.scanner.rays()
        first_minute = minute_of(self.time_s)
        for number in range(len(self.minutes)):
            minute = self._checked_minute(number)
            for scan in np.flatnonzero(first_minute == number).tolist():
                begin, end = np.searchsorted(minute.scan, [scan, scan + 1])
                yield self._scan(scan, minute.part(begin, end), rays)

    def _scan(self, number: int, returns: LidarReturns, rays: FloatArray) -> SensorScan:
        """Return one scan in the vehicle's frame."""
        scanner, mount = self.scanner, np.array(self.scanner.mount_m)
        time_s = self.time_s[number] + scanner.turn_s * returns.column / scanner.n_columns
        xyz = mount + 1e-3 * returns.range_mm[:, None] * rays[returns.column, returns.beam]
        return SensorScan(time_s, xyz, mount)

    def _checked_minute(self, number: int) -> LidarReturns:
        """Return the returns of a minute, or refuse those of another scanner."""
        minute, scanner = self.minutes[number], self.scanner
        if not len(minute.scan):
            return minute
        if (np.diff(minute.scan.astype(np.int64)) < 0).any() or minute.scan[-1] >= len(self):
            raise InputError(
                f"minute {number} of the scans names scans out of order or beyond {len(self) - 1}; make the recording again."
            )
        if minute.column.max() >= scanner.n_columns or minute.beam.max() >= len(scanner.elevation_deg):
            raise InputError(
                f"minute {number} of the scans names a direction that the scanner of {scanner.n_columns} columns and "
                f"{len(scanner.elevation_deg)} beams does not have; make the recording again."
            )
        return minute

    def write(self, folder: str | Path) -> None:
        """Write ``scanner.json``, ``scans.csv`` with the times, and one ``minute-NNNN.npz`` for each minute.

        Parameters
        ----------
        folder : str or pathlib.Path
            Folder that is made.

        Raises
        ------
        InputError
            The folder exists, or cannot be written to.
        """
        place = Path(folder)
        if place.exists():
            raise InputError(f"the folder of scans {place} exists; choose another one.")
        place.mkdir(parents=True)
        for number in range(len(self.minutes)):
            self.minutes[number].write(place / _minute_file(number))
        write_table(place / _TIMES, {"time_s": self.time_s})
        write_json(place / _SCANNER, self.scanner.model_dump())

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read the files of `write`; returns are read minute by minute when they are used.

        Parameters
        ----------
        folder : str or pathlib.Path
            Folder that `write` wrote to.

        Returns
        -------
        LidarScans
            Equal to the one written.

        Raises
        ------
        InputError
            A file is missing or damaged.
        """
        place = Path(folder)
        scanner = _read_scanner(place / _SCANNER)
        times = read_table(place / _TIMES, ["time_s"], what="the times of the scans")["time_s"]
        return cls(scanner, times, StoredMinutes(place, n_minutes(times)))


class StoredMinutes:
    """Returns of minutes in files, read when they are used.

    `folder`: folder of the files. `n`: number of minutes.
    """

    def __init__(self, folder: Path, n: int) -> None:
        self._folder, self._n = folder, n

    def __len__(self) -> int:
        return self._n

    def __getitem__(self, number: int) -> LidarReturns:
        return LidarReturns.read(self._folder / _minute_file(number))


def minute_of(time_s: FloatArray) -> FloatArray:
    """Return the number of the minute, since the first, of times (S,) [s]."""
    minutes: FloatArray = np.floor((time_s - time_s[0]) / MINUTE_S)
    return minutes


def n_minutes(time_s: FloatArray) -> int:
    """Return the number of minutes that times (S,) [s] take.

    >>> n_minutes(np.array([10.0, 69.9])), n_minutes(np.array([10.0, 70.0]))
    (1, 2)
    """
    return int(minute_of(time_s)[-1]) + 1


def is_lidar_folder(folder: str | Path) -> bool:
    """Return whether a folder holds the scans of a recording."""
    return (Path(folder) / _SCANNER).is_file()


def _minute_file(number: int) -> str:
    return f"minute-{number:04d}.npz"


def _read_scanner(file: Path) -> Scanner:
    content = read_json(file, "the description of the scanner")
    try:
        return Scanner.model_validate_json(json.dumps(content))
    except ValueError as error:
        raise InputError(f"{file} is damaged ({first_line(error)}); make the recording again.") from error
