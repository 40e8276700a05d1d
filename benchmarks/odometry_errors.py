r"""What the odometry of images is wrong by, and the wheels, on drives that nothing is judged on.

Run with ``python -m benchmarks.odometry_errors``. The figures are what `localization.images` and the wheels' settings
assume, printed beside; the drives are those of ``examples/glacier_drive.toml`` with the seeds 11 to 13, of 280 m, and of
``examples/mendenhall_like.toml`` with the seeds 51 to 53, of 2.85 km, on which a heading shows whether it walks away. They
are rendered once and kept in the system's folder for temporary files. Errors are estimated minus real. A Gauss–Markov error of standard
deviation σ and correlation length Λ changes over a distance d by

.. math:: E (x(t + d) − x(t))^2 = 2 σ² (1 − e^{−d/Λ}) + w² d

where it also walks by w per square root of a metre, and its mean over a stretch d has, without that, the variance
2 σ² (Λ/d) (1 − (Λ/d)(1 − e^{−d/Λ})).
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.joint_mapping_images import survey_in_images
from benchmarks.report import Row, main
from survey.arrays import FloatArray
from survey.recording import Recording
from survey.sensors import Odometry
from survey.trajectory import Trajectory
from vision_slam.config import LocalizationConfig
from vision_slam.visual_slam import visual_odometry

SEEDS = (11, 12, 13)
SURVEYS = (51, 52, 53)
DRIVES = Path(tempfile.gettempdir()) / "firnline-dev"
MISSION = Path(__file__).parents[1] / "examples" / "glacier_drive.toml"
_STRETCH_M, _APART_M = 5.0, 60.0
_STRAIGHT_RAD = 0.1
# Stretches farther from the others than this were followed wrongly: they are counted apart, not fitted.
_TORN = 0.15


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    drives = [_measured(seed) for seed in (SEEDS[:1] if quick else SEEDS)]
    surveys = [] if quick else [_surveyed(seed) for seed in SURVEYS]
    yield from fitted(drives + surveys)
    yield _heading_over(drives + surveys, 60.0)
    if surveys:
        yield _heading_over(surveys, 300.0)


def simulated_drive(seed: int, drives: Path) -> Path:
    """Return the folder of a drive's recording and of what was real; render where that was not done before."""
    made = drives / str(seed) / "glacier-drive" / "latest" / "2-simulate"
    if not (made / "recording" / "recording.json").exists():
        command = [sys.executable, "-m", "sim.cli.main", "simulate", str(MISSION), "--set", f"seed={seed}"]
        command += ["--runs", str(drives / str(seed))]
        subprocess.run(command, check=True, capture_output=True, stdin=subprocess.DEVNULL)
    return made


def _measured(seed: int) -> dict[str, FloatArray]:
    made = simulated_drive(seed, DRIVES)
    recording = Recording.read(made / "recording")
    real = Trajectory.read(made / "truth" / "trajectory.tum", recording.crs)
    return errors_of(recording, visual_odometry(recording).odometry, real)


def _surveyed(seed: int) -> dict[str, FloatArray]:
    survey = survey_in_images(seed)
    return errors_of(survey.recording, survey.found.odometry, survey.real.trajectory)


def errors_of(recording: Recording, odometry: Odometry, real: Trajectory) -> dict[str, FloatArray]:
    """Return the errors of one drive: attitude every 5 m [deg], and of every 5 m scale, steps, wheels and turns."""
    times = odometry.time_s
    place = np.column_stack([np.interp(times, real.time_s, axis) for axis in real.position.T])
    turns = Slerp(real.time_s, Rotation.from_quat(real.quaternion))(times.clip(*real.time_s[[0, -1]]))
    attitude = turns.as_euler("xyz")
    off = odometry.attitude_rad - attitude
    off = np.unwrap((off + np.pi) % (2.0 * np.pi) - np.pi, axis=0)
    moves = np.einsum("nji,nj->ni", turns.as_matrix()[:-1], np.diff(place, axis=0))
    travel = np.r_[0.0, np.cumsum(np.linalg.norm(moves, axis=1))]
    marks = np.unique(np.searchsorted(travel, np.arange(0.0, travel[-1], _STRETCH_M)))
    length = np.diff(travel[marks])

    def summed(steps: FloatArray) -> FloatArray:
        return np.diff(np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])[marks], axis=0)

    wrong = summed(odometry.step - moves)
    assert recording.wheels is not None
    wheels = recording.wheels
    rolled = np.interp(times, wheels.time_s, 0.5 * (wheels.left_m + wheels.right_m))
    turned = np.abs(np.diff(np.unwrap(attitude[:, 2])))
    at = np.arange(0.0, travel[-1], _STRETCH_M)
    return {
        "attitude": np.degrees(np.column_stack([np.interp(at, travel, axis) for axis in off.T])),
        "scale": wrong[:, 0] / length,
        "aside": wrong[:, 1:] / np.sqrt(length)[:, None],
        "length": length,
        "wheels": np.diff(rolled[marks]) - length,
        "turned": np.diff(np.r_[0.0, np.cumsum(turned)][marks]),
    }


def fitted(drives: list[dict[str, FloatArray]]) -> Iterator[Row]:
    """Yield what a model of such errors has to assume, beside what ours does."""
    images, config = LocalizationConfig().images, LocalizationConfig()
    heading = np.array([drive["attitude"][0, 2] for drive in drives])
    yield _beside("heading at the start, by compass", _rms(heading), "deg", images.heading_sigma_deg)
    levelled = np.array([drive["attitude"][:, :2].mean(axis=0) for drive in drives])
    yield _beside("roll and pitch, constant part", _rms(levelled), "deg", images.tilt_bias_sigma_deg)
    tilt_deg = _changing(drives, [0, 1], images.attitude_correlation_m)
    yield _beside("roll and pitch, changing part", tilt_deg, "deg", images.tilt_sigma_deg)
    torn = [np.abs(drive["scale"] - np.median(drive["scale"])) > _TORN for drive in drives]
    yield Row("stretches of 5 m that were followed wrongly", float(np.concatenate(torn).sum()), "1")
    scales = [drive["scale"][~bad] for drive, bad in zip(drives, torn, strict=True)]
    mean = _rms(np.array([scale.mean() for scale in scales]))
    yield _beside("scale, over a drive", 100.0 * mean, "%", 100.0 * images.scale_sigma)
    sigma, length_m = _wander(scales)
    yield _beside("scale, changing part", 100.0 * sigma, "%", 100.0 * images.scale_wander_sigma)
    yield Row("scale, correlation length", length_m, "m", f"assumed {images.scale_wander_m:g}")
    aside = np.concatenate([drive["aside"][~bad] for drive, bad in zip(drives, torn, strict=True)])
    yield _beside("sideways and upwards, per root metre", _rms(aside), "m", images.step_sigma_m)
    turns = [_in_turns(drive["scale"] * drive["length"], drive) for drive in drives]
    yield _beside(
        "turns, along the way, per root radian", _rms(np.concatenate(turns)), "m", images.turn_sigma_m
    )
    yield from _wheels(drives, config)


def _wheels(drives: list[dict[str, FloatArray]], config: LocalizationConfig) -> Iterator[Row]:
    shares, noise, skid = [], [], []
    for drive in drives:
        straight = drive["turned"] < _STRAIGHT_RAD
        share = float((drive["wheels"][straight]).sum() / drive["length"][straight].sum())
        left = drive["wheels"] - share * drive["length"]
        shares.append(share)
        noise.append(_rms(left[straight] / np.sqrt(drive["length"][straight])))
        skid.append(_in_turns(drive["wheels"], drive))
    yield _beside(
        "wheels: share that lasts", 100.0 * _rms(np.array(shares)), "%", 100.0 * config.wheel_scale_sigma
    )
    yield _beside("wheels: random, per root metre", _rms(np.array(noise)), "m", config.wheel_step_sigma_m)
    skidding = _rms(np.concatenate(skid))
    yield _beside("wheels: skidding per root radian", skidding, "m", config.wheel_skid_m)


def _in_turns(along: FloatArray, drive: dict[str, FloatArray]) -> FloatArray:
    """Return what a length is off by in turns, beyond its share on the straight, per root radian."""
    straight = drive["turned"] < _STRAIGHT_RAD
    share = float(along[straight].sum() / drive["length"][straight].sum())
    left: FloatArray = (along - share * drive["length"])[~straight] / np.sqrt(drive["turned"][~straight])
    return left


def _heading_over(drives: list[dict[str, FloatArray]], far_m: float) -> Row:
    """How much the error of the heading changes over a distance, beside what is assumed."""
    images, lag = LocalizationConfig().images, round(far_m / _STRETCH_M)
    changes = [drive["attitude"][lag:, 2] - drive["attitude"][:-lag, 2] for drive in drives]
    forgotten = 2.0 * images.yaw_sigma_deg**2 * (1.0 - np.exp(-far_m / images.attitude_correlation_m))
    assumed = float(np.sqrt(forgotten + images.heading_walk_deg_sqrt_m**2 * far_m))
    return _beside(f"heading, change over {far_m:.0f} m", _rms(np.concatenate(changes)), "deg", assumed)


def _changing(drives: list[dict[str, FloatArray]], axes: list[int], length_m: float) -> float:
    lag = round(_APART_M / _STRETCH_M)
    changes = [drive["attitude"][lag:, axes] - drive["attitude"][:-lag, axes] for drive in drives]
    mean_square = float(np.mean(np.concatenate(changes) ** 2))
    return float(np.sqrt(mean_square / (2.0 * (1.0 - np.exp(-_APART_M / length_m)))))


def _wander(scales: list[FloatArray]) -> tuple[float, float]:
    """Return standard deviation and correlation length [m] of a Gauss–Markov scale, from its means over 5 m."""
    off = [scale - scale.mean() for scale in scales]
    variance = float(np.mean(np.concatenate(off) ** 2))
    next_one = float(np.mean(np.concatenate([x[1:] * x[:-1] for x in off])))
    # Means over neighbouring stretches d covary by (σ Λ/d)² (1 − e^(−d/Λ))².
    lengths_m = np.geomspace(0.5, 60.0, 400)
    ratio = lengths_m / _STRETCH_M
    kept = 1.0 - np.exp(-1.0 / ratio)
    own = 2.0 * ratio * (1.0 - ratio * kept)
    best = int(np.argmin(np.abs((ratio * kept) ** 2 / own - next_one / variance)))
    return float(np.sqrt(variance / own[best])), float(lengths_m[best])


def _beside(name: str, value: float, unit: str, assumed: float) -> Row:
    """Row that holds where no less is assumed than two thirds of what was found; too much is only cautious."""
    return Row(name, value, unit, f"assumed {assumed:.3g}", bool(assumed >= value / 1.5))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main("Odometry errors", measure)
