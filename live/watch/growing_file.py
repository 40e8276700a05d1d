"""Samples from a file that grows while a rover drives: a table of points, or NMEA of a receiver."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep
from typing import Any

import numpy as np
from pyproj import CRS

from live.watch.sample import Sample
from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints
from vision_slam.io.gps_files import read_gps

_POLL_S = 1.0
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
        Table of points (``.csv``, as ``firnline reconstruct`` reads them; with a column ``time_s`` or one second apart) or
        the log of a receiver (``.nmea``, ``.txt``, ``.log``, ``.ubx``).
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
    while True:
        if path.stat().st_size != size:
            size = path.stat().st_size
            samples = _samples(path, crs, least_sigma_m)
            for sample in samples[n_read:]:
                yield {"in": "sample", "sample": list(sample)}
            n_read = len(samples)
        if not follows:
            return
        sleep(_POLL_S)


def _samples(path: Path, crs: CRS, least_sigma_m: float) -> list[Sample]:
    """Read the complete lines of a file; none while there is no point yet."""
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        content = path.read_bytes()
        copy.write_bytes(content[: content.rfind(b"\n") + 1])
        try:
            return (
                _fixes(copy, crs, least_sigma_m)
                if path.suffix in _NMEA
                else _points(copy, crs, least_sigma_m)
            )
        except InputError:
            if content.count(b"\n") > 2:
                raise
            return []


def _points(path: Path, crs: CRS, least_sigma_m: float) -> list[Sample]:
    points = SurfacePoints.read(path, crs=crs)
    times = points.values.get("time_s", np.arange(len(points), dtype=np.float64))
    stated = points.sigma_m if points.covariance is None else np.sqrt(points.covariance[:, 2, 2])
    sigma = np.maximum(np.asarray(stated, dtype=np.float64), least_sigma_m)
    rows = np.column_stack([times, points.xyz, sigma]).tolist()
    return [Sample(*row) for row in rows]


def _fixes(path: Path, crs: CRS, least_sigma_m: float) -> list[Sample]:
    fixes, _ = read_gps(path).fixes(crs)
    stated = np.full(len(fixes.time_s), _DEFAULT_SIGMA_M) if fixes.sigma_m is None else fixes.sigma_m
    sigma = np.maximum(_VERTICAL_SHARE * stated, least_sigma_m)
    rows = np.column_stack([fixes.time_s, fixes.position, sigma]).tolist()
    return [Sample(*row) for row in rows]
