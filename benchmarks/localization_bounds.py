"""What no estimator can better: online localization beside the Cramér-Rao bound of the same surveys.

Run with ``python -m benchmarks.localization_bounds``. Surveys, odometry and receivers are those of
`benchmarks.localization`, with odometry as images give. All errors are drawn as the estimator assumes them, so
that the posterior covariance of the linear smoother over the records up to some moment is the bound of
Cramér and Rao at that moment: no unbiased estimator of the newest position has a smaller mean square. The bound is
taken at moments spread evenly over each survey, and the errors of the online path at the same moments.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np

from benchmarks.localization import Run, survey
from benchmarks.report import Row, main
from survey.core.arrays import FloatArray
from survey.data.recording import OdometryRecording, Recording
from survey.data.sensors.odometry import Sightings
from survey.data.sensors.records import SensorRecords
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import smooth

Records = TypeVar("Records", bound=SensorRecords | None)

_ODOMETRY = "odometry as images give"
_RECEIVERS = {"SBAS": 0.8, "3 m, tau 60 s": 1.2}
_NEAR_THE_BOUND = 1.15
_N_RUNS, _N_MOMENTS = 12, 16


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    n_runs = 2 if quick else _N_RUNS
    for receiver, wished_m in _RECEIVERS.items():
        found = np.array([_against_bound(*survey(k, _ODOMETRY, receiver)) for k in range(n_runs)])
        yield from _rows(f"GPS {receiver}", found, wished_m)


def _rows(name: str, found: FloatArray, wished_m: float) -> Iterator[Row]:
    """Yield the rows of one receiver from the mean squares (R, 3) of online path, smoother and bound [m²]."""
    online_m, smoothed_m, bound_m = np.sqrt(found).T
    yield Row(f"{name}: bound of the newest position, horizontal, median", float(np.median(bound_m)), "m")
    yield Row(
        f"{name}: bound over the bar of {wished_m:g} m; above 1 the bar cannot be held",
        float(np.median(bound_m)) / wished_m,
        "1",
    )
    yield Row(f"{name}: online, at the same moments, median", float(np.median(online_m)), "m")
    yield Row(f"{name}: smoother of the records so far, median", float(np.median(smoothed_m)), "m")
    ratio = float(np.sqrt(found[:, 0].mean() / found[:, 2].mean()))
    yield Row.of(f"{name}: online over the bound, RMS of all surveys", ratio, "1", "<=", _NEAR_THE_BOUND)


def _against_bound(run: Run, config: LocalizationConfig) -> tuple[float, float, float]:
    """Return the mean squared horizontal errors of the online path and of the smoother, and their bound [m²]."""
    online, smoothed, bound = [], [], []
    for last in np.linspace(0, len(run.place) - 1, _N_MOMENTS + 1).astype(int)[1:].tolist():
        path = smooth(_until(run.recording, last), run.reckoned[: last + 1], config)
        online.append(float(((run.online.position[last] - run.place[last])[:2] ** 2).sum()))
        smoothed.append(float(((path.position[-1] - run.place[last])[:2] ** 2).sum()))
        bound.append(float(np.trace(path.covariance[-1, :2, :2])))
    return float(np.mean(online)), float(np.mean(smoothed)), float(np.mean(bound))


def _until(recording: Recording, last: int) -> OdometryRecording:
    """Return the records up to the pose of an index, without sightings."""
    odometry = recording.odometry
    assert odometry is not None
    last_s = odometry.time_s[last]
    path = replace(
        odometry,
        time_s=odometry.time_s[: last + 1],
        step=odometry.step[:last],
        attitude_rad=odometry.attitude_rad[: last + 1],
    )
    nothing = Sightings(np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    early = replace(
        recording,
        gps=_early(recording.gps, last_s),
        barometer=_early(recording.barometer, last_s),
        inertial=_early(recording.inertial, last_s),
    )
    return early.with_odometry(path, nothing)


def _early(records: Records, last_s: float) -> Records:
    """Return the readings up to a time [s]."""
    return records if records is None else records.select(records.time_s <= last_s)


if __name__ == "__main__":
    main("Localization bounds", measure)
