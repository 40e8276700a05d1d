"""Error, coverage and cost of a joint estimate of map and path: surveys of 2.7 km.

Run with ``python -m benchmarks.joint_mapping``. The seeds were used for nothing else; no error is debiased.
The scenario is that of `firnline reproduce joint-map-comparison`; the estimator takes the errors of the receiver
to last 300 s, whatever they do.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import planners
from benchmarks.report import Row, fastest, main
from papers.glacier.joint_map import (
    AREA,
    CASES,
    CRS,
    GRAVITY,
    KERNEL,
    NODES,
    SIDE_M,
    Case,
    SurveyOutcome,
    judged,
    mission_of,
    site,
    survey_once,
)
from sim.simulate.simulation import simulate_statistical
from survey.data.grid import Grid
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.prior import SatelliteErrors
from vision_slam import localize
from vision_slam.fusion.smoother import smooth
from vision_slam.motion import dead_reckoning

FIRST_SEED = 6000
TAUS_S = (60.0, 300.0)
_CONVINCING = 5.4
MEASURED, LEVEL, STAKED = CASES[3], CASES[4], CASES[5]
OFFSET_KNOWN = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=1.0, datum_sigma_m=1.0))
UNKNOWN_START = Case("unknown start", aids={**GRAVITY, "start": "unknown"})
SATELLITE_OFFSET = Case("satellite 1 m off", aids=GRAVITY, satellite_offset_m=1.0, joint=OFFSET_KNOWN)
LEARNED = replace(
    LEVEL, name="+ gravity, barometer, kernel learned", gp=GaussianProcessConfig(family="three-scale")
)
_REAL_AND_ASSUMED_S = ((60.0, 60.0), (60.0, 1200.0), (300.0, 300.0), (300.0, 60.0), (300.0, 5.0))
_UNBARRED = Case("statistical sensor")
_MEDIAN_BARS = {MEASURED.name: 0.42, LEVEL.name: 0.29}
_CLASS_BARS = {LEVEL.name: 1.0}
_FINE_BARS = {STAKED.name: 0.95}


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    yield from _cost(quick)
    n = 2 if quick else 30
    if quick:
        for case in (MEASURED, LEVEL, STAKED):
            yield from _rows(case, 300.0, n)
    else:
        for case in (MEASURED, LEVEL, STAKED, CASES[0]):
            for tau_s in TAUS_S:
                yield from _rows(case, tau_s, n)
        for case in (UNKNOWN_START, SATELLITE_OFFSET, CASES[2], CASES[1], LEARNED):
            yield from _rows(case, 300.0, n)
        yield from _own_sensor(n)
    yield from _closures(1 if quick else 6)
    yield from _time_constants(1 if quick else 6)


def _rows(case: Case, tau_s: float, n: int) -> Iterator[Row]:
    done = [survey_once(seed, tau_s, case) for seed in range(FIRST_SEED, FIRST_SEED + n)]
    yield from _summary(f"{case.name}, tau {tau_s:.0f} s", case, done)


def _summary(name: str, case: Case, done: list[SurveyOutcome]) -> Iterator[Row]:
    rmse = np.array([out.rmse_m for out in done])
    coverage = np.array([out.coverage for out in done])
    yield _barred(f"{name}: RMSE, median", float(np.median(rmse)), "m", _MEDIAN_BARS.get(case.name))
    yield Row(f"{name}: RMSE, 95th percentile", float(np.percentile(rmse, 95.0)), "m")
    yield Row(f"{name}: RMSE, worst", float(rmse.max()), "m")
    offset = float(np.sqrt(np.mean([out.offset_m**2 for out in done])))
    yield Row(f"{name}: site-mean error, RMS", offset, "m")
    covered = float(coverage.mean())
    if case.errors == "joint" and case.satellite:
        held = 0.92 <= covered <= 0.97
        yield Row(f"{name}: coverage of 95 %", covered, "1", "0.92 to 0.97", held)
    else:
        yield Row(f"{name}: coverage of 95 %", covered, "1")
    yield Row(f"{name}: coverage of the worst survey", float(coverage.min()), "1")
    for limit, share in ((0.4572, _CLASS_BARS.get(case.name)), (0.28, _FINE_BARS.get(case.name))):
        within = float(np.mean(rmse <= limit))
        shown = f"{name}: share of surveys within {limit:g} m"
        yield Row(shown, within, "1") if share is None else Row.of(shown, within, "1", ">=", share)


def _barred(name: str, value: float, unit: str, limit: float | None) -> Row:
    return Row(name, value, unit) if limit is None else Row.of(name, value, unit, "<=", limit)


def _own_sensor(n: int) -> Iterator[Row]:
    """Survey with the landmarks of the statistical fidelity itself, which reach less far to the side."""
    for case, name in ((MEASURED, "joint + satellite"), (LEVEL, "+ gravity, barometer")):
        done = [_surveyed_by_own_sensor(seed, case) for seed in range(FIRST_SEED, FIRST_SEED + n)]
        yield from _summary(f"landmarks of the statistical sensor, {name}, tau 300 s", _UNBARRED, done)


def _surveyed_by_own_sensor(seed: int, case: Case) -> SurveyOutcome:
    terrain, cells = site(seed)
    mission = mission_of(seed, 300.0, case)
    recording, real = simulate_statistical(terrain, planners.plan(AREA, None, mission.planner), mission)
    localized = localize(recording, mission.assumed)
    trajectory, points = localized.trajectory, localized.points
    assert trajectory.error is not None
    found = JointTerrain(trajectory.error, cells, case.gp, case.joint).map(points, NODES)
    return judged(found, terrain, trajectory, real.trajectory)


def _closures(n: int) -> Iterator[Row]:
    """Recognise places on two tie lines; make two recognitions wrong, by 6 m."""
    right = replace(LEVEL, name="ties", tie_lines=2, aids={**GRAVITY, "recognition": 1.0})
    wrong = replace(right, aids={**right.aids, "wrong_closures": 2})
    off = {"tie_gate": 1e9}
    pairs = [
        [survey_once(seed, 300.0, case) for case in (right, wrong, replace(wrong, assumed=off))]
        for seed in range(FIRST_SEED, FIRST_SEED + n)
    ]
    for k, name in ((1, "gated"), (2, "not gated")):
        change = max(abs(out[k].rmse_m - out[0].rmse_m) for out in pairs)
        shown = f"2 wrong closures, {name}: largest change of the map's RMSE"
        yield Row.of(shown, change, "m", "<=", 0.01) if k == 1 else Row(shown, change, "m")
        path = float(np.median([out[k].path_before_m for out in pairs]))
        yield Row(f"2 wrong closures, {name}: vertical error of the path before the map, median", path, "m")
    path = float(np.median([out[0].path_before_m for out in pairs]))
    yield Row("no wrong closure: vertical error of the path before the map, median", path, "m")


def _time_constants(n: int) -> Iterator[Row]:
    """Assume the receiver's errors to last longer, and shorter, than they do."""
    seeds = range(FIRST_SEED, FIRST_SEED + n)
    for real_s, assumed_s in _REAL_AND_ASSUMED_S:
        case = replace(LEVEL, name="tau", assumed={"gps_correlation_time_s": assumed_s})
        done = [survey_once(seed, real_s, case) for seed in seeds]
        name = f"GPS errors last {real_s:.0f} s, taken for {assumed_s:.0f} s"
        yield Row(f"{name}: RMSE, median", float(np.median([out.rmse_m for out in done])), "m")
        yield Row(f"{name}: coverage of 95 %", float(np.mean([out.coverage for out in done])), "1")
        caught = float(np.mean([_gain(seed, real_s, case) > _CONVINCING for seed in seeds]))
        shown = f"{name}: share in which the innovations say too short"
        if assumed_s < real_s:
            yield Row.of(shown, caught, "1", ">=", 0.95)
        else:
            yield Row.of(shown, caught, "1", "<=", 0.05)


def _gain(seed: int, tau_s: float, case: Case) -> float:
    terrain, _ = site(seed)
    mission = mission_of(seed, tau_s, case)
    recording, _ = simulate_statistical(terrain, planners.plan(AREA, None, mission.planner), mission)
    assert recording.odometry is not None
    reckoned = dead_reckoning(recording.odometry, recording.start)
    return smooth(recording, reckoned, mission.assumed).gps_evidence


def _cost(quick: bool) -> Iterator[Row]:
    """Time one survey with its variance map on 301 × 301 nodes, and one of 50,000 landmarks."""
    terrain, cells = site(FIRST_SEED)
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 2.0, CRS)
    for n_wanted, limit in ((5_000, 2.0), (50_000, 5.0)):
        mission = mission_of(FIRST_SEED, 300.0, LEVEL)
        sensors = mission.sensors.model_copy(update={"landmarks_per_m": n_wanted / 1400.0})
        mission = mission.model_copy(update={"sensors": sensors})
        route = planners.plan(AREA, None, mission.planner)
        recording, _ = simulate_statistical(terrain, route, mission)
        localized = localize(recording, mission.assumed)
        trajectory, points = localized.trajectory, localized.points
        assert trajectory.error is not None
        points = points.select(np.arange(min(n_wanted, len(points))))
        model = JointTerrain(trajectory.error, cells, KERNEL, LEVEL.joint)
        seconds = fastest(lambda m=model, p=points: m.map(p, grid), 2 if quick else 3)[1]
        shown = f"{len(points):,} landmarks: map, variance and path, kernel known, CPU time"
        yield Row.of(shown, seconds, "s", "<=", limit)
        if not quick and n_wanted == 5_000:
            learnt = JointTerrain(trajectory.error, cells, LEARNED.gp, LEVEL.joint)
            seconds = fastest(lambda m=learnt, p=points: m.map(p, grid), 2)[1]
            yield Row(f"{len(points):,} landmarks: the same with the kernel learned, CPU time", seconds, "s")


if __name__ == "__main__":
    main("Joint mapping", measure, ("numpy", "scipy", "finufft"))
