"""What fixes, barometer and ties make of odometry: 2.7 km surveys, online and smoothed, their honesty, and their mishaps.

Run with ``python -m benchmarks.localization``. Missions are of the statistical fidelity, on seeds used for nothing
else, and the estimator assumes what is drawn, as if datasheets were right. Two levels of odometry are shown: what the
statistical fidelity draws by default, and what `benchmarks.odometry_errors` measures of images and wheels,
whose heading walks away unless a gyro holds it.
Nothing is aligned. Errors are over all poses of a run; rows are over runs. Finished parts are stored in the system's
folder for temporary files for as long as the code stays the same, so that a run can be continued.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import norm

import planners
from benchmarks.report import Row, main
from benchmarks.stored_parts import parts_folder, stored_rows
from papers.glacier.joint_map import AREA, site
from planners import LawnmowerConfig
from sim.config.mission import AidsConfig, MissionConfig, SensorConfig
from sim.config.world import RandomTerrain
from sim.simulate.simulation import simulate_statistical
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.path_error import POSE
from survey.data.recording import Recording
from survey.data.sensors.records import Inertial
from survey.data.trajectory import Trajectory
from vision_slam.config import ImageOdometryErrors, LocalizationConfig
from vision_slam.evaluation import consistency
from vision_slam.fusion.online import OnlinePath, filter_path, gate_fixes
from vision_slam.fusion.particle_filter import ParticleFilter
from vision_slam.fusion.smoother import SmoothedPath, smooth
from vision_slam.motion import dead_reckoning

FIRST_SEED = 51_000
_JUDGED = ("SBAS", "3 m, tau 60 s")
_SPACING_M = 150.0
_INSET = 20.0 / _SPACING_M
_GYRO_BIAS_DEG_H = 36.0

RECEIVERS: dict[str, dict[str, Any]] = {
    "white 3 m": {"gps_bias_sigma_m": 0.01, "gps_white_sigma_m": 3.0, "gps_correlation_time_s": 60.0},
    "SBAS": {"gps_bias_sigma_m": 1.0, "gps_white_sigma_m": 0.5, "gps_correlation_time_s": 120.0},
    "3 m, tau 60 s": {"gps_bias_sigma_m": 3.0, "gps_white_sigma_m": 1.0, "gps_correlation_time_s": 60.0},
    "3 m, tau 300 s": {"gps_bias_sigma_m": 3.0, "gps_white_sigma_m": 1.0, "gps_correlation_time_s": 300.0},
}
_ONLINE_BARS = {"white 3 m": 0.6, "SBAS": 0.8, "3 m, tau 60 s": 1.2}
_SMOOTHED_BARS = {"3 m, tau 60 s": 1.0}
_HEIGHT_BARS = {"white 3 m": 0.30, "3 m, tau 60 s": 0.80, "3 m, tau 300 s": 0.80}
_IMAGES = ImageOdometryErrors()
ODOMETRY: dict[str, dict[str, Any]] = {
    "odometry as drawn": {},
    "odometry as images give": {
        "yaw_sigma_deg": _IMAGES.yaw_sigma_deg,
        "heading_walk_deg_sqrt_m": _IMAGES.heading_walk_deg_sqrt_m,
        "tilt_sigma_deg": _IMAGES.tilt_sigma_deg,
        "attitude_correlation_m": _IMAGES.attitude_correlation_m,
        # The wheels hold the scale of images from metre to metre; their random walk is what they leave of it.
        "scale_sigma": _IMAGES.scale_sigma,
        "step_sigma_m": float(np.hypot(_IMAGES.step_sigma_m, LocalizationConfig().wheel_step_sigma_m)),
    },
}


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    folder = parts_folder("localization", "benchmarks/localization.py", "sim/simulate", "sim/instruments")
    for name, make in _parts(quick).items():
        yield from stored_rows(folder / f"{name.replace(' ', '-')}.json", make)


def _parts(quick: bool) -> dict[str, Callable[[], Iterator[Row]]]:
    """Return what makes the rows of each part, by its name."""
    n_honest, few, label = (8, 2, "quick ") if quick else (50, 10, "")
    parts: dict[str, Callable[[], Iterator[Row]]] = {
        "linear case": _linear_case,
        "carried off": partial(_carried_off, 20 if quick else 100),
    }
    for receiver in RECEIVERS if not quick else ("SBAS",):
        n = n_honest if receiver in _JUDGED else 20
        parts[f"as drawn {receiver}"] = partial(_accuracy, "odometry as drawn", receiver, n)
        if receiver in _JUDGED:
            parts[f"honesty {receiver}"] = partial(_honesty, n_honest, (receiver,))
        parts[f"as images {receiver}"] = partial(
            _accuracy, "odometry as images give", receiver, 3 if quick else 12
        )
    for receiver in ("white 3 m", "3 m, tau 60 s", "3 m, tau 300 s"):
        parts[f"tied {receiver}"] = partial(_tied, receiver, few)
    parts |= {"outage": partial(_outage, few), "jump": partial(_jump, few), "threads": _threads}
    return {f"{label}{name}": make for name, make in parts.items()}


@dataclass(frozen=True)
class Run:
    """One survey: its recording, what was made of it, and where the rover really was (N, 3)."""

    recording: Recording
    reckoned: FloatArray
    online: OnlinePath
    smoothed: SmoothedPath
    place: FloatArray


@cache
def _terrain() -> Any:
    return site(FIRST_SEED)[0]


def _mission(seed: int, odometry: str, receiver: str, *, ties: int = 0) -> MissionConfig:
    drawn = {**ODOMETRY[odometry], **RECEIVERS[receiver]}
    return MissionConfig(
        schema_version=1,
        name="localization",
        seed=seed,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=4, inset_share=_INSET, tie_lines=ties),
        sensors=SensorConfig(**drawn, landmarks_per_m=0.05),
        aids=AidsConfig(recognition=1.0 if ties else 0.0),
        localization=LocalizationConfig(**drawn),
    )


def _drawn(mission: MissionConfig) -> tuple[Recording, FloatArray]:
    route = planners.plan(AREA, None, mission.planner)
    recording, real = simulate_statistical(_terrain(), route, mission)
    if mission.sensors.heading_walk_deg_sqrt_m > 0.0:
        recording = replace(recording, inertial=_gyro(real.trajectory, mission))
    return recording, real.trajectory.position


def _gyro(real: Trajectory, mission: MissionConfig) -> Inertial:
    """Draw what a gyro says in each second; of an accelerometer there is nothing."""
    config, rng = mission.assumed, stream(mission.seed, "localization", "gyro")
    attitude, seconds = Rotation.from_quat(real.quaternion), np.diff(real.time_s)[:, None]
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    turn *= 1.0 + config.gyro_scale_sigma * rng.standard_normal()
    noise, walk = np.radians(
        [config.gyro_noise_deg_sqrt_h / 60.0, config.gyro_bias_walk_deg_h_sqrt_h / 60.0**3]
    )
    bias = np.radians(_GYRO_BIAS_DEG_H / 3600.0) * rng.standard_normal(3)
    drawn = rng.standard_normal((2, *turn.shape))
    bias = bias + np.cumsum(walk * np.sqrt(seconds) * drawn[0], axis=0)
    rates = (turn + noise * np.sqrt(seconds) * drawn[1]) / seconds + bias
    return Inertial(real.time_s[1:], rates, np.zeros_like(rates))


def _localized(mission: MissionConfig, recording: Recording, place: FloatArray) -> Run:
    assert recording.odometry is not None
    reckoned = dead_reckoning(recording.odometry, recording.start)
    online = filter_path(recording, reckoned, mission.assumed)
    smoothed = smooth(gate_fixes(recording, online), reckoned, mission.assumed)
    return Run(recording, reckoned, online, smoothed, place)


@cache
def _run(seed: int, odometry: str, receiver: str) -> Run:
    mission = _mission(seed, odometry, receiver)
    return _localized(mission, *_drawn(mission))


def survey(k: int, odometry: str, receiver: str) -> tuple[Run, LocalizationConfig]:
    """Return the k-th survey with some odometry and receiver, and the errors that it was drawn with."""
    return _run(FIRST_SEED + k, odometry, receiver), _mission(FIRST_SEED + k, odometry, receiver).assumed


def _runs(odometry: str, receiver: str, n: int) -> list[Run]:
    return [_run(FIRST_SEED + k, odometry, receiver) for k in range(n)]


def _accuracy(odometry: str, receiver: str, n: int) -> Iterator[Row]:
    name = f"{odometry}, GPS {receiver}"
    done = _runs(odometry, receiver, n)
    alone = np.array([_horizontal(run.reckoned, run.place) for run in done])
    online = np.array([_horizontal(run.online.position, run.place) for run in done])
    smoothed = np.array([_horizontal(run.smoothed.position, run.place) for run in done])
    height = np.array([_vertical(run.smoothed.position, run.place) for run in done])
    yield Row(f"{name}: odometry alone, horizontal, median", float(np.median(alone)), "m")
    for shown, errors, bar in (
        ("online, horizontal", online, _ONLINE_BARS.get(receiver)),
        ("smoothed, horizontal", smoothed, _SMOOTHED_BARS.get(receiver)),
        ("smoothed with barometer, elevation", height, _HEIGHT_BARS.get(receiver)),
    ):
        yield _barred(f"{name}: {shown}, median", float(np.median(errors)), bar)
        yield Row(f"{name}: {shown}, worst", float(errors.max()), "m")
    worse = float(np.median(smoothed) / np.median(alone))
    yield Row.of(f"{name}: smoothed over odometry alone, medians", worse, "1", "<=", 1.0)
    worse = float(np.median(online) / np.median(alone))
    yield Row.of(f"{name}: online over odometry alone, medians", worse, "1", "<=", 1.0)
    yield Row(f"{name}: share of surveys in which smoothing is worse", float(np.mean(smoothed > alone)), "1")
    by_luck = float(np.mean([_worse_by_luck(run) for run in done]))
    yield Row(f"{name}: the same, as the smoother's covariances would have it", by_luck, "1")


def _worse_by_luck(run: Run) -> float:
    """Return how likely it is, by what the smoother claims, that odometry alone came out nearer.

    No estimate is nearer in every draw: a scale or a heading that happens to be drawn right cannot be known to be. Smoothing
    moves the path by m; with e the error it leaves, the odometry's is e + m, and the less where 2 e·m < −|m|².
    """
    odometry, error = run.recording.odometry, run.smoothed.error
    assert odometry is not None
    moved = (run.reckoned - run.smoothed.position)[:, :2]
    at = error.keyframe_at(odometry.time_s)
    side = np.zeros(error.n_unknowns)
    for axis in (0, 1):
        side += error.rows(at, np.tile(np.eye(POSE)[axis], (len(at), 1))).T @ moved[:, axis]
    return float(norm.cdf(-0.5 * (moved**2).sum() / np.sqrt(side @ error.solve(side))))


def _tied(receiver: str, n: int) -> Iterator[Row]:
    """Cross the swaths by two tie lines, whose crossings are recognised."""
    level, height = [], []
    for k in range(n):
        mission = _mission(FIRST_SEED + k, "odometry as drawn", receiver, ties=2)
        recording, place = _drawn(mission)
        assert recording.odometry is not None
        path = smooth(recording, dead_reckoning(recording.odometry, recording.start), mission.assumed)
        level.append(_horizontal(path.position, place))
        height.append(_vertical(path.position, place))
    name = f"two tie lines, GPS {receiver}"
    for shown, errors in (("horizontal", level), ("elevation", height)):
        yield Row(f"{name}: smoothed, {shown}, median", float(np.median(errors)), "m")
        yield Row(f"{name}: smoothed, {shown}, worst", float(np.max(errors)), "m")


def _honesty(n: int, receivers: tuple[str, ...]) -> Iterator[Row]:
    """Judge covariances at the middle and at the end of independent runs, and normalised errors over all poses."""
    for receiver in receivers:
        done = _runs("odometry as drawn", receiver, n)
        for kind in ("online", "smoothed"):
            paths = [getattr(run, kind) for run in done]
            covariances = [path.covariance[:, :3, :3] for path in paths]
            errors = [path.position - run.place for path, run in zip(paths, done, strict=True)]
            for where, at in (("half-way", 0.5), ("at the end", 1.0)):
                index = int(at * (len(errors[0]) - 1))
                judged = consistency(
                    np.array([error[index] for error in errors]),
                    np.array([covariance[index] for covariance in covariances]),
                )
                band = f"{judged.lowest:.2f} to {judged.highest:.2f}"
                shown = f"GPS {receiver}, {kind}: NEES {where}, {n} runs"
                yield Row(shown, judged.mean, "1", band, judged.is_honest)
            ratio = _normalized(errors, covariances)
            held = 0.8 <= ratio <= 1.3
            yield Row(f"GPS {receiver}, {kind}: normalised pose error", ratio, "1", "0.8 to 1.3", held)
            pairs = zip(errors, covariances, strict=True)
            squared = [np.mean(error[20:, 2] ** 2 / spread[20:, 2, 2]) for error, spread in pairs]
            ratio = float(np.sqrt(np.mean(squared)))
            held = 0.8 <= ratio <= 1.3
            yield Row(f"GPS {receiver}, {kind}: normalised elevation error", ratio, "1", "0.8 to 1.3", held)


def _normalized(errors: list[FloatArray], covariances: list[FloatArray]) -> float:
    """Root of the mean eᵀ P⁻¹ e per dimension; the first 20 poses, where the start is known exactly, left out."""
    squared = [
        np.einsum("ni,nij,nj->n", error[20:], np.linalg.inv(spread[20:]), error[20:]).mean() / 3.0
        for error, spread in zip(errors, covariances, strict=True)
    ]
    return float(np.sqrt(np.mean(squared)))


def _outage(n: int) -> Iterator[Row]:
    """Take the fixes away for ten minutes."""
    errors, claimed = [], []
    for k in range(n):
        mission = _mission(FIRST_SEED + 500 + k, "odometry as drawn", "SBAS")
        recording, place = _drawn(mission)
        fixes = recording.gps
        kept = (fixes.time_s < 1000.0) | (fixes.time_s > 1600.0)
        cut = replace(fixes, time_s=fixes.time_s[kept], position=fixes.position[kept])
        run = _localized(mission, replace(recording, gps=cut), place)
        last = int(np.searchsorted(run.online.time_s, 1600.0)) - 1
        off = run.online.position[last] - place[last]
        errors.append(float(np.hypot(off[0], off[1])))
        claimed.append(float(np.sqrt(np.trace(run.online.covariance[last, :2, :2]))))
    name = "no fix for 10 minutes (600 m), online at its end"
    yield Row(f"{name}: horizontal error, median", float(np.median(errors)), "m")
    yield Row.of(f"{name}: horizontal error, worst", float(np.max(errors)), "m", "<=", 10.0)
    worst = float(np.max(np.array(errors) / np.array(claimed)))
    yield Row.of(f"{name}: worst error over declared standard deviation", worst, "1", "<=", 3.0)


def _jump(n: int) -> Iterator[Row]:
    """Let the fixes jump by 15 m for a minute, as when satellites change."""
    begin_s, end_s = 1000.0, 1060.0
    during, after, late, smoothed = [], [], [], []
    for k in range(n):
        mission = _mission(FIRST_SEED + 700 + k, "odometry as drawn", "SBAS")
        recording, place = _drawn(mission)
        fixes = recording.gps
        jumped = (fixes.time_s >= begin_s) & (fixes.time_s < end_s)
        direction = 2.0 * np.pi * k / n
        jump = 15.0 * np.array([np.cos(direction), np.sin(direction), 0.0])
        moved = replace(fixes, position=fixes.position + jumped[:, None] * jump)
        run = _localized(mission, replace(recording, gps=moved), place)
        time_s = run.online.time_s
        error = np.hypot(*(run.online.position - place)[:, :2].T)
        inside = (time_s >= begin_s) & (time_s < end_s)
        during.append(float(error[inside].max()))
        after.append(float(error[(time_s >= end_s) & (time_s < end_s + 120.0)].max()))
        declared = np.flatnonzero(run.online.is_lost[inside])
        late.append(float(time_s[inside][declared[0]] - begin_s) if len(declared) else np.inf)
        smoothed.append(_horizontal(run.smoothed.position, place))
    name = "fixes off by 15 m for a minute"
    yield Row.of(f"{name}: online, worst error while it lasts", max(during), "m", "<=", 5.0)
    yield Row.of(f"{name}: online, worst error in the two minutes after", max(after), "m", "<=", 5.0)
    yield Row.of(f"{name}: declared after, longest", max(late), "s", "<=", 5.0)
    yield Row.of(f"{name}: smoothed, horizontal, worst survey", max(smoothed), "m", "<=", 1.5)


def _carried_off(n: int) -> Iterator[Row]:
    """Share of runs that, a minute after they were set down elsewhere or began anywhere, know where they are."""
    for shown, kidnapped in (("carried off by 30 m and 90 deg", True), ("started anywhere", False)):
        good, silent = 0, 0
        for run in range(n):
            error, is_lost = _minute_after(run, kidnapped)
            good += error < 3.0 and not is_lost
            silent += error >= 5.0 and not is_lost
        yield Row.of(f"{shown}: within 3 m after 60 s, share of {n} runs", good / n, "1", ">=", 0.95)
        yield Row(f"{shown}: wrong by 5 m and not declared lost, share", silent / n, "1")


def _minute_after(run: int, kidnapped: bool) -> tuple[float, bool]:
    config, rng = LocalizationConfig(), np.random.default_rng(FIRST_SEED + 3000 + run)
    level = np.array([1.0, 1.0, config.gps_vertical_factor])
    memory = np.exp(-1.0 / config.gps_correlation_time_s)
    bias = config.gps_bias_sigma_m * level * rng.standard_normal(3)
    filtered = ParticleFilter(config, rng, start=np.zeros(3) if kidnapped else None)
    place, heading = np.zeros(3), 0.0 if kidnapped else float(rng.uniform(-np.pi, np.pi))
    for second in range(120 if kidnapped else 60):
        if kidnapped and second == 60:
            place, heading = place + [30.0, 0.0, 0.0], heading + np.pi / 2
        place = place + [np.cos(heading), np.sin(heading), 0.0]
        renewed = config.gps_bias_sigma_m * level * np.sqrt(1.0 - memory**2)
        bias = memory * bias + renewed * rng.standard_normal(3)
        noise = config.step_sigma_m * rng.standard_normal(3)
        filtered.move(np.array([1.0, 0.0, 0.0]) + noise, 1.0)
        filtered.correct(place + bias + config.gps_white_sigma_m * level * rng.standard_normal(3))
    now = filtered.estimate()
    return float(np.linalg.norm((now.position - place)[:2])), now.is_lost


def _linear_case() -> Iterator[Row]:
    """Compare with Kalman's filter, written down axis by axis, where heading, tilt and scale are exact."""
    exact: dict[str, Any] = {"yaw_sigma_deg": 1e-7, "tilt_sigma_deg": 1e-7, "tilt_bias_sigma_deg": 0.0}
    config = LocalizationConfig(
        **exact, scale_sigma=1e-10, step_sigma_m=0.2, start_sigma_m=0.5, gps_correlation_time_s=30.0
    )
    rng = np.random.default_rng(FIRST_SEED)
    filtered = ParticleFilter(config, rng, start=np.zeros(3))
    level = np.array([1.0, 1.0, config.gps_vertical_factor])
    white, bias = (config.gps_white_sigma_m * level) ** 2, (config.gps_bias_sigma_m * level) ** 2
    memory = float(np.exp(-1.0 / config.gps_correlation_time_s))
    x = np.zeros((3, 2))
    p = np.array([np.diag([config.start_sigma_m**2, b]) for b in bias])
    move = np.diag([1.0, memory])
    worst = 0.0
    for _ in range(200):
        step, fix = np.array([1.0, 0.0, 0.0]), 3.0 * rng.standard_normal(3)
        fix = fix + filtered.estimate().position
        filtered.move(step, 1.0)
        accepted = filtered.correct(fix)
        for axis in range(3):
            x[axis] = move @ x[axis] + [step[axis], 0.0]
            noise = np.diag([config.step_sigma_m**2, (1.0 - memory**2) * bias[axis]])
            p[axis] = move @ p[axis] @ move + noise
            gain = p[axis].sum(axis=1) / (p[axis].sum() + white[axis]) * accepted
            x[axis], p[axis] = (
                x[axis] + gain * (fix[axis] - x[axis].sum()),
                p[axis] - np.outer(gain, p[axis].sum(axis=0)),
            )
        now = filtered.estimate()
        off = np.abs(now.position - x[:, 0]) / np.sqrt(p[:, 0, 0])
        worst = max(worst, float(off.max()), float(np.abs(np.diag(now.covariance) / p[:, 0, 0] - 1.0).max()))
    name = "linear case: filter against Kalman's, largest difference in standard deviations"
    yield Row.of(name, worst, "1", "<=", 1e-6)


def _threads() -> Iterator[Row]:
    """Localize the same recording on one thread and on two."""
    from threadpoolctl import threadpool_limits

    mission = _mission(FIRST_SEED, "odometry as drawn", "SBAS")
    recording, place = _drawn(mission)
    runs = []
    for n_threads in (1, 2):
        with threadpool_limits(n_threads):
            runs.append(_localized(mission, recording, place))
    same = [
        runs[0].online.position.tobytes() == runs[1].online.position.tobytes(),
        runs[0].online.covariance.tobytes() == runs[1].online.covariance.tobytes(),
        runs[0].smoothed.position.tobytes() == runs[1].smoothed.position.tobytes(),
    ]
    yield Row.of("one thread and two: share of equal bytes", float(np.mean(same)), "1", ">=", 1.0)


def _barred(name: str, value: float, bar: float | None) -> Row:
    return Row(name, value, "m") if bar is None else Row.of(name, value, "m", "<=", bar)


def _horizontal(path: FloatArray, place: FloatArray) -> float:
    return float(np.sqrt(((path - place)[:, :2] ** 2).sum(axis=1).mean()))


def _vertical(path: FloatArray, place: FloatArray) -> float:
    return float(np.sqrt(((path - place)[:, 2] ** 2).mean()))


if __name__ == "__main__":
    main("Localization", measure)
