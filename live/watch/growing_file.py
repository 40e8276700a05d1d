"""Samples from a file that grows while a rover drives: a table of points, the log of a receiver, or a recording."""

import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep
from typing import Any

import numpy as np
from pyproj import CRS

from live.watch.sample import Sample
from survey.core.arrays import FloatArray
from survey.core.crs import equal_crs
from survey.core.errors import InputError
from survey.core.transformation import transformed
from survey.data.recording import Recording, table_file
from survey.data.sensors.records import GpsFixes
from survey.data.surface_points import SurfacePoints
from vision_slam.readers.gps_files import read_gps

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

    Parameters
    ----------
    path : pathlib.Path
        Table of points (``.csv``, as ``firnline reconstruct`` reads them; with a column ``time_s`` or one second apart),
        the log of a receiver (``.nmea``, ``.txt``, ``.log``, ``.ubx``), or the folder of a recording, whose fixes count
        as the ground below the antenna.
    crs : CRS
        Of the samples.
    follows : bool
        Whether to wait for more lines, without end.
    least_sigma_m : float
        Standard deviation that no sample falls below [m].

    Yields
    ------
    dict
        Samples.
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
