"""Samples of the ground as they arrive, from a file that grows or from telemetry, and a gate that refuses wrong ones.

`SampleGate` refuses samples that are malformed or impossible, given the site and the sample before. `file_entries` reads
a table of points, the log of a receiver or a recording, and waits for more lines. `TelemetryReader` turns the fixes of a
vehicle's receiver into samples, less the height of the antenna.
"""

import shutil
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any, NamedTuple

import numpy as np
from pyproj import CRS

from live.link import Vehicle
from survey import InputError, Recording, SurfacePoints
from survey.core.arrays import Bounds, FloatArray
from survey.core.crs import equal_crs
from survey.core.transformation import WGS84, transformed
from survey.data.recording import table_file
from survey.data.sensors.records import GpsFixes
from vision_slam.readers.gps_files import read_gps

# Two samples contradict one another where no rover drives so fast, or no ground is so steep.
_MOST_SPEED_M_S, _MOST_SLOPE = 8.0, 1.5
_MOST_PAUSE_S = 900.0
_SIGMAS, _SLACK_M = 6.0, 1.0
_MOST_SIGMA_M = 20.0
# So many samples in a row that agree with one another are accepted: the rover was moved, or its clock was set.
_AGREEING = 8


class Sample(NamedTuple):
    """Height of the ground at a place and a time.

    `time_s`: by the clock of the rover or of the file [s]. `x_m`, `y_m`, `z_m`: easting, northing and height
    in the CRS of the area [m]. `sigma_m`: standard deviation of the height [m]. `battery`: share of the
    charge that is left.
    """

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    sigma_m: float
    battery: float | None = None


@dataclass
class SampleGate:
    """Test of samples against the site and the one before.

    A sample is refused that is not finite, far outside the site, imprecise beyond use, not later than the one before, or
    farther from it than a rover drives in the time between. Refused samples that agree with one another are accepted
    after a while, so that one wrong sample never blocks those that follow.

    `bounds`: west, south, east and north of the ground where a rover may be [m].

    >>> gate = SampleGate((0.0, 0.0, 100.0, 100.0))
    >>> gate.reason(Sample(0.0, 5.0, 5.0, 900.0, 0.05)) is None
    True
    >>> gate.reason(Sample(1.0, 80.0, 5.0, 900.0, 0.05))
    '75 m from the sample 1 s before'
    """

    bounds: Bounds
    last: Sample | None = None
    _others: list[Sample] = field(default_factory=list)

    def reason(self, sample: Sample) -> str | None:
        """Return why a sample is refused, or None where it is taken."""
        wrong = self._malformed(sample)
        if wrong is None and self.last is not None:
            wrong = _contradiction(self.last, sample)
            if wrong is not None:
                wrong = self._unless_agreeing(sample, wrong)
        if wrong is None:
            self.last, self._others = sample, []
        return wrong

    def _malformed(self, sample: Sample) -> str | None:
        if not np.isfinite(sample[:5]).all():
            return "not finite"
        west, south, east, north = self.bounds
        if not (west <= sample.x_m <= east and south <= sample.y_m <= north):
            return "far outside the site"
        if not 0.0 < sample.sigma_m <= _MOST_SIGMA_M:
            return f"standard deviation {sample.sigma_m:g} m"
        return None

    def _unless_agreeing(self, sample: Sample, wrong: str) -> str | None:
        """Return the reason, unless as many refused samples in a row agree."""
        if self._others and _contradiction(self._others[-1], sample) is not None:
            self._others = []
        self._others.append(sample)
        return None if len(self._others) >= _AGREEING else wrong


def _contradiction(before: Sample, after: Sample) -> str | None:
    """Return why a sample cannot follow another, or None."""
    seconds = after.time_s - before.time_s
    if not 0.0 < seconds <= _MOST_PAUSE_S:
        return f"{seconds:.3g} s after the sample before"
    distance_m = float(np.hypot(after.x_m - before.x_m, after.y_m - before.y_m))
    slack_m = _SLACK_M + _SIGMAS * (before.sigma_m + after.sigma_m)
    if distance_m > _MOST_SPEED_M_S * seconds + slack_m:
        return f"{distance_m:.0f} m from the sample {seconds:.3g} s before"
    rise_m = abs(after.z_m - before.z_m)
    if rise_m > _MOST_SLOPE * distance_m + slack_m:
        return f"{rise_m:.0f} m above or below the sample before, {distance_m:.0f} m away"
    return None


_POLL_S = 1.0
_HEADER = "recording.json"
_NMEA = (".nmea", ".txt", ".log", ".ubx")
_DEFAULT_SIGMA_M = 0.05
# Standard deviation of a height over the horizontal one that a receiver states.
_VERTICAL_SHARE = 1.5


def file_entries(
    path: Path, crs: CRS, *, follows: bool, least_sigma_m: float = 0.01
) -> Iterator[dict[str, Any]]:
    """Yield the inputs of a watch from a file, and those of lines that are added to it.

    `least_sigma_m`: standard deviation that no sample falls below [m].
    """
    n_read, size = 0, -1
    file = _required_table(path) if path.is_dir() else path
    while True:
        if file.stat().st_size != size:
            size = file.stat().st_size
            samples = _samples(file, crs, least_sigma_m)
            for sample in samples[n_read:]:
                yield {"in": "sample", "sample": list(sample)}
            n_read = len(samples)
        if not follows:
            return
        sleep(_POLL_S)


def _required_table(folder: Path) -> Path:
    """Return the table of fixes of a recording's folder."""
    file = folder / table_file("gps")
    if not file.is_file() or not (folder / _HEADER).is_file():
        raise InputError(
            f"{folder} is no recording ({_HEADER} and {file.name} were expected); name the folder of a recording, a table of "
            "points or the log of a receiver."
        )
    return file


def _samples(path: Path, crs: CRS, least_sigma_m: float) -> list[Sample]:
    """Read the complete lines of a file; none while there is no point yet."""
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        content = path.read_bytes()
        copy.write_bytes(content[: content.rfind(b"\n") + 1])
        try:
            return _reader(path)(copy, crs, least_sigma_m)
        except InputError as error:
            if content.count(b"\n") > 2:
                raise InputError(str(error).replace(str(copy), str(path))) from error
            return []


def _reader(path: Path) -> Callable[[Path, CRS, float], list[Sample]]:
    """Return the function that reads a file."""
    if (header := path.parent / _HEADER).is_file() and path.name == table_file("gps"):
        return partial(_recorded, header)
    return _fixes if path.suffix in _NMEA else _points


def _recorded(header: Path, path: Path, crs: CRS, least_sigma_m: float) -> list[Sample]:
    """Read the fixes of a recording, less the height of its antenna."""
    shutil.copy(header, path.with_name(_HEADER))
    recording = Recording.read(path.parent)
    places = recording.gps.position
    if not equal_crs(recording.crs, crs):
        places = np.column_stack([transformed(places[:, :2], recording.crs, crs, "the fixes"), places[:, 2]])
    return _of_fixes(recording.gps, places - [0.0, 0.0, recording.antenna_height_m], least_sigma_m)


def _points(path: Path, crs: CRS, least_sigma_m: float) -> list[Sample]:
    points = SurfacePoints.read(path, crs=crs)
    times = points.values.get("time_s", np.arange(len(points), dtype=np.float64))
    stated = points.sigma_m if points.covariance is None else np.sqrt(points.covariance[:, 2, 2])
    sigma = np.maximum(np.asarray(stated, dtype=np.float64), least_sigma_m)
    rows = np.column_stack([times, points.xyz, sigma]).tolist()
    return [Sample(*row) for row in rows]


def _fixes(path: Path, crs: CRS, least_sigma_m: float) -> list[Sample]:
    fixes, _ = read_gps(path).fixes(crs)
    return _of_fixes(fixes, fixes.position, least_sigma_m)


def _of_fixes(fixes: GpsFixes, places: FloatArray, least_sigma_m: float) -> list[Sample]:
    """Return samples of the ground at places (N, 3) [m]."""
    stated = np.full(len(fixes.time_s), _DEFAULT_SIGMA_M) if fixes.sigma_m is None else fixes.sigma_m
    sigma = np.maximum(_VERTICAL_SHARE * stated, least_sigma_m)
    rows = np.column_stack([fixes.time_s, places, sigma]).tolist()
    return [Sample(*row) for row in rows]


_TYPES = ("GPS_RAW_INT", "SYS_STATUS", "BATTERY_STATUS")
_LEAST_FIX = 3
_UNKNOWN_PERCENT = -1
_PER_DEGREE, _MM = 1e7, 1000.0
_SILENCE_S = 5.0


class TelemetryReader:
    """Reader of messages of one vehicle.

    `crs`: of the samples. `antenna_m`: height of the antenna above the ground [m]. `least_sigma_m`: standard
    deviation that no sample falls below [m]; that of receivers which state none.

    >>> from types import SimpleNamespace
    >>> reader = TelemetryReader(CRS("EPSG:32632"), antenna_m=1.0)
    >>> fix = SimpleNamespace(fix_type=6, lat=460000000, lon=90000000, alt=501000, h_acc=20, v_acc=30,
    ...                       time_usec=2000000, get_type=lambda: "GPS_RAW_INT")
    >>> sample = reader.sample_of(fix)
    >>> round(sample.x_m), sample.z_m, sample.sigma_m, sample.time_s
    (500000, 500.0, 0.03, 2.0)
    """

    def __init__(self, crs: CRS, antenna_m: float = 0.0, least_sigma_m: float = 0.01) -> None:
        self.crs, self.antenna_m, self.least_sigma_m = crs, antenna_m, least_sigma_m
        self.battery: float | None = None

    def sample_of(self, message: Any) -> Sample | None:
        """Return the sample that a message holds; None for other messages and for fixes of less than three dimensions."""
        kind = message.get_type()
        if kind in ("SYS_STATUS", "BATTERY_STATUS"):
            if _UNKNOWN_PERCENT < message.battery_remaining <= 100:
                self.battery = message.battery_remaining / 100.0
            return None
        if kind != "GPS_RAW_INT" or message.fix_type < _LEAST_FIX:
            return None
        longitude, latitude = message.lon / _PER_DEGREE, message.lat / _PER_DEGREE
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            return None
        x, y = transformed(np.array([[longitude, latitude]]), WGS84, self.crs, "the fix")[0].tolist()
        sigma = max(message.v_acc / _MM, self.least_sigma_m)
        height = message.alt / _MM - self.antenna_m
        return Sample(message.time_usec / 1e6, x, y, height, sigma, self.battery)


def telemetry_entries(vehicle: Vehicle, reader: TelemetryReader) -> Iterator[dict[str, Any]]:
    """Yield the inputs of a watch as they arrive, silences included; without end."""
    last_s, heard = 0.0, monotonic()
    while True:
        message = vehicle.receive(_TYPES, _SILENCE_S)
        if message is None:
            yield {"in": "silence", "time_s": round(last_s + monotonic() - heard, 1)}
            continue
        sample = reader.sample_of(message)
        heard = monotonic()
        if sample is not None:
            last_s = sample.time_s
            yield {"in": "sample", "sample": list(sample)}


def buffered_entries(vehicle: Vehicle, reader: TelemetryReader) -> Generator[dict[str, Any], None, None]:
    """Yield what `telemetry_entries` does, received by a thread, so that nothing is lost while an advice is computed."""
    arrived: SimpleQueue[dict[str, Any] | Exception] = SimpleQueue()
    over = Event()
    thread = Thread(target=_receive, args=(vehicle, reader, arrived, over), daemon=True)
    thread.start()
    try:
        while True:
            entry = arrived.get()
            if isinstance(entry, Exception):
                raise entry
            yield entry
    finally:
        over.set()
        thread.join()


def _receive(
    vehicle: Vehicle, reader: TelemetryReader, arrived: "SimpleQueue[dict[str, Any] | Exception]", over: Event
) -> None:
    """Put what arrives into a queue; an error as well, which ends it."""
    try:
        for entry in telemetry_entries(vehicle, reader):
            if over.is_set():
                return
            arrived.put(entry)
    except Exception as error:  # raised again where the entries are taken
        arrived.put(error)
