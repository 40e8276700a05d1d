"""Localize with the real errors of receivers on a glacier: ``python -m benchmarks.glacier_receivers``.

Stakes on Bowdoin Glacier carried receivers that stored a position every 15 minutes. The motion of the
ice, a parabola over 10 hours, is removed from each stretch of 40 positions; what is left are errors of a
receiver with their real memory. They are added to the path of a rover that drives 1.8 km in these 10
hours, as they are (millimetres) and 200 times as large (half a metre), with odometry whose errors are
drawn as the configuration assumes. Stated are their true standard deviation and no memory. Nothing was
chosen on these stretches. The bars are those of the normalised squared horizontal error: 2 for true
covariances, at most 3.5 over all stretches and 15 in the worst.
"""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pyproj import CRS

from benchmarks.report import Row, main
from sim.instruments.sensor import gauss_markov
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from vision_slam.config import LocalizationConfig
from vision_slam.motion import dead_reckoning
from vision_slam.pipeline import localize
from vision_slam.readers.gps_files import read_positions

DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[2] / "shared" / "data"))
_N_STRETCHES, _N_FIXES, _INTERVAL_S = 40, 40, 900.0
_POSE_S, _SPEED_M_S, _SIDE_M = 60.0, 0.05, 150.0
_M_PER_DEG = 111320.0
# Share of the variance that lasts, of a receiver of which nothing else is known.
_LASTING = 0.8


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    folder = DATA / "ice_gnss_bowdoin_stakes"
    if not folder.is_dir():
        sys.exit("the positions of the stakes are not here; set FIRNLINE_DATA.")
    errors = stretches(folder)[: 5 if quick else _N_STRETCHES]
    yield Row("stretches of 10 h", float(len(errors)), "1")
    sigma_m = float(np.sqrt(np.mean(errors**2)))
    yield Row("standard deviation of their errors", 1000.0 * sigma_m, "mm")
    yield Row("correlation of errors 15 minutes apart", _correlation(errors), "1")
    for name, larger in (("as they are", 1.0), ("200 times as large", 200.0)):
        runs = [_squared_and_rms(larger * error, larger * sigma_m, k) for k, error in enumerate(errors)]
        squared, rms_m = np.array(runs).T
        yield Row(f"{name}: horizontal error, rms", float(np.sqrt(np.mean(rms_m**2))), "m")
        yield Row.of(f"{name}: NEES, mean", float(squared.mean()), "1", "<=", 3.5)
        yield Row.of(f"{name}: NEES, worst stretch", float(squared.max()), "1", "<=", 15.0)


def stretches(folder: Path) -> FloatArray:
    """Return the errors (S, 40, 2) [m] of all stretches without a gap, east and north."""
    found = []
    for file in sorted(folder.glob("*.dat")):
        time_s, place, *_ = read_positions(file)
        scale = _M_PER_DEG * np.array([np.cos(np.radians(place[0, 1])), 1.0])
        level = (place[:, :2] - place[0, :2]) * scale
        for first in range(0, len(time_s) - _N_FIXES + 1, _N_FIXES):
            part = slice(first, first + _N_FIXES)
            if np.ptp(time_s[part]) == (_N_FIXES - 1) * _INTERVAL_S:
                found.append(_without_motion(time_s[part], level[part]))
    return np.array(found)


def _without_motion(time_s: FloatArray, level: FloatArray) -> FloatArray:
    """Return what a parabola over time leaves (N, 2) [m]."""
    design = np.vander((time_s - time_s[0]) / 1e4, 3)
    return np.asarray(level - design @ np.linalg.lstsq(design, level, rcond=None)[0])


def _correlation(errors: FloatArray) -> float:
    return float((errors[:, 1:] * errors[:, :-1]).mean() / (errors**2).mean())


def _squared_and_rms(error: FloatArray, sigma_m: float, seed: int) -> tuple[float, float]:
    """Return the mean normalised squared error and the horizontal error [m] of one drive."""
    recording, path = _drive(error, seed)
    config = LocalizationConfig(
        gps_bias_sigma_m=float(np.sqrt(_LASTING)) * sigma_m,
        gps_white_sigma_m=float(np.sqrt(1.0 - _LASTING)) * sigma_m,
    )
    found = localize(recording, config).trajectory
    off, spread = (found.position - path)[:, :2], found.covariance[:, :2, :2]
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[:, :, None])[:, :, 0])
    return float(squared.mean()), float(np.sqrt((off**2).sum(axis=1).mean()))


def _drive(error: FloatArray, seed: int) -> tuple[Recording, FloatArray]:
    """Return a drive around a square with drawn odometry and fixes that have the errors, and its real path."""
    rng, config = stream(seed, "glacier receivers", "odometry"), LocalizationConfig()
    fix_s = _INTERVAL_S * np.arange(_N_FIXES)
    time_s = np.arange(0.0, fix_s[-1] + 1.0, _POSE_S)
    step_m = _SPEED_M_S * _POSE_S
    heading = 0.5 * np.pi * np.floor(_SPEED_M_S * time_s / _SIDE_M)
    level = np.zeros_like(time_s)
    attitude = np.column_stack([level, level, heading])
    steps = np.tile([step_m, 0.0, 0.0], (len(time_s) - 1, 1))
    path = dead_reckoning(Odometry(time_s, steps, attitude), np.zeros(3))
    yaw_rad = np.radians(config.yaw_sigma_deg)
    wrong = gauss_markov(np.full(len(steps), step_m), config.attitude_correlation_m, yaw_rad, rng)
    attitude = attitude + np.column_stack([level, level, wrong.ravel()[: len(level)]])
    noise = config.step_sigma_m * np.sqrt(step_m) * rng.standard_normal(steps.shape)
    odometry = Odometry(time_s, (1.0 + config.scale_sigma * rng.standard_normal()) * steps + noise, attitude)
    fixes = np.zeros((_N_FIXES, 3))
    fixes[:] = np.column_stack([np.interp(fix_s, time_s, axis) for axis in path.T])
    fixes[:, :2] += error
    one = Sightings(np.array([3]), np.array([[6.0, 0.0, 0.0]]), 0.01 * np.eye(3)[None], np.array([8.0]))
    return Recording(
        CRS("EPSG:32608"), fixes[0], GpsFixes(fix_s, fixes), odometry=odometry, sightings=one, start_is_surveyed=False
    ), path  # fmt: skip


if __name__ == "__main__":
    main("Glacier receivers", measure)
