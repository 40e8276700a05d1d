"""Velocities of real stakes: first halves of series predict the second halves."""

import csv
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from benchmarks.report import Row
from survey.core.arrays import FloatArray
from survey.core.crs import projected_crs
from survey.core.transformation import transformed
from survey.reconstruction.motion.stakes import predict_position
from vision_slam.readers.gps_files import read_positions

_DAY_S, _Z95 = 86400.0, 1.959964
BOWDOIN = ("B14BH1_2014", "B14BH1_2015", "B1501", "B1502", "B1503")
RESET_M, LEAST = 0.5, 24
"""A jump between two readings that is a new installation, and the readings that a series needs."""


def series(data: Path) -> list[tuple[str, FloatArray, FloatArray]]:
    """Return names, times (N,) [days] and positions (N, 2) [m] of all series of the folder of real data."""
    found = [(name, *_bowdoin(data / "ice_gnss_bowdoin_stakes" / f"{name}_15min.dat")) for name in BOWDOIN]
    markers = data / "ice_markers_columbia_glacier"
    found += _columbia(markers / "1984_markers.csv", "t") + _columbia(markers / "1984_marker-11.csv", "t")
    found += _columbia(markers / "2004_positions.csv", "t_begin")
    parts = [(name, *part) for name, time, place in found for part in _without_resets(time, place)]
    return [(name, time, place) for name, time, place in parts if len(time) >= LEAST]


def _bowdoin(file: Path) -> tuple[FloatArray, FloatArray]:
    time_s, place, *_ = read_positions(file)
    xy = transformed(place[:, :2], CRS("OGC:CRS84"), projected_crs("EPSG:32619", "the stakes"), str(file))
    return time_s / _DAY_S, xy


def _columbia(file: Path, when: str) -> list[tuple[str, FloatArray, FloatArray]]:
    """Return the series of the markers of a table."""
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    found = []
    for name in dict.fromkeys(row.get("marker", "gps") for row in rows):
        mine = [row for row in rows if row.get("marker", "gps") == name]
        time = np.array([datetime.fromisoformat(row[when]).timestamp() for row in mine]) / _DAY_S
        place = np.array([(float(row["x"]), float(row["y"])) for row in mine])
        time, index = np.unique(time, return_index=True)
        found.append((f"{file.stem} {name}", time, place[index]))
    return found


def _without_resets(time: FloatArray, place: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return a series in parts between new installations, at which it jumps within minutes."""
    step, gap = np.linalg.norm(np.diff(place, axis=0), axis=1), np.diff(time)
    cuts = np.flatnonzero((step > RESET_M) & (step / gap > 40.0)) + 1
    return list(zip(np.split(time, cuts), np.split(place, cuts), strict=True))


def predicted(data: Path) -> list[dict[str, Any]]:
    """Return the errors of the second halves in standard deviations, with the speeds."""
    found = []
    for name, time, place in series(data):
        half = int(np.searchsorted(time, 0.5 * (time[0] + time[-1])))
        later = np.array([(half + len(time)) // 2, len(time) - 1])
        if half < LEAST // 3 or len(time) - half < LEAST // 3:
            continue
        guess = [predict_position(time[:half], place[:half, axis], time[later]) for axis in (0, 1)]
        scores = [
            ((place[later, axis] - guess[axis].position_m) / guess[axis].sigma_m).tolist() for axis in (0, 1)
        ]
        speed = float(np.hypot(*(one.velocity_m_per_day for one in guess)))
        sigma = float(np.hypot(*(one.velocity_sigma_m_per_day for one in guess)))
        found.append(
            {
                "name": name,
                "scores": scores,
                "speed": speed,
                "sigma": sigma,
                "days": float(time[-1] - time[0]),
            }
        )
    return found


def rows(found: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Yield the rows of real stakes."""
    ends, middles = (np.array([axis[k] for one in found for axis in one["scores"]]) for k in (-1, 0))
    yield Row("real stakes: series", float(len(found)), "1")
    yield Row("real stakes: slowest", min(one["speed"] for one in found), "m/day")
    yield Row("real stakes: fastest", max(one["speed"] for one in found), "m/day")
    within = float(np.mean(np.abs(ends) < _Z95))
    yield Row.of(
        "real stakes: mean velocities of second halves within 95 % of the first", within, "1", ">=", 0.93
    )
    yield Row(
        "real stakes: positions in the middle of second halves within 95 %",
        float(np.mean(np.abs(middles) < _Z95)),
        "1",
    )
    sigma = float(np.median([one["sigma"] / one["speed"] for one in found]))
    yield Row("real stakes: standard deviation of the velocity over the speed, median", sigma, "1")
