r"""What the odometry of images is wrong by, and the wheels, on drives that nothing is judged on.

Run with ``python -m benchmarks.odometry_errors``. The figures are what `localization.images` and the wheels' settings
assume, printed beside; the drives are those of ``examples/glacier_drive.toml`` with the seeds 11 to 13, of 280 m, and of
``examples/mendenhall_like.toml`` with the seeds 61 and 62, of 2.85 km, on which a heading shows whether it walks away
(``FIRNLINE_ERROR_SURVEYS="61"`` takes fewer, an empty one none). They are rendered and read once, and stored in the
system's folder for temporary files. Errors are estimated minus real. A Gauss–Markov error of standard
deviation σ and correlation length Λ changes over a distance d by

.. math:: E (x(t + d) − x(t))^2 = 2 σ² (1 − e^{−d/Λ}) + w² d

where it also walks by w per square root of a metre, and its mean over a stretch d has, without that, the variance
2 σ² (Λ/d) (1 − (Λ/d)(1 − e^{−d/Λ})).
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from benchmarks.image_surveys import seen, survey_in_images
from benchmarks.report import Row, main
from benchmarks.stored_parts import simulated_folder
from sim.simulate.error_model import (
    STRETCH_M,
    OdometryErrors,
    correlated_sigma_deg,
    mean_square_change_deg2,
    odometry_errors,
)
from survey.core.arrays import BoolArray, FloatArray, root_mean_square
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry
from survey.data.trajectory import Trajectory
from vision_slam.config import LocalizationConfig

SEEDS = (11, 12, 13)
SURVEYS = tuple(int(seed) for seed in os.environ.get("FIRNLINE_ERROR_SURVEYS", "61 62").split())
DRIVES = simulated_folder("dev")
MISSION = Path(__file__).parents[1] / "examples" / "glacier_drive.toml"
_STRAIGHT_RAD = 0.1


class Drive(NamedTuple):
    """The errors of a drive's odometry, and what its wheels rolled too far in every 5 m [m]."""

    errors: OdometryErrors
    wheels_m: FloatArray

    @classmethod
    def of(cls, recording: Recording, odometry: Odometry, real: Trajectory) -> Self:
        """Hold odometry and wheels against the real path."""
        errors, wheels = odometry_errors(odometry, real), recording.wheels
        assert wheels is not None
        rolled = np.interp(errors.mark_s, wheels.time_s, 0.5 * (wheels.left_m + wheels.right_m))
        return cls(errors, np.diff(rolled) - errors.length_m)

    @property
    def is_straight(self) -> BoolArray:
        """Which stretches turn little."""
        straight: BoolArray = self.errors.turned_rad < _STRAIGHT_RAD
        return straight


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
        command = [
            sys.executable,
            "-m",
            "firnline.cli.main",
            "simulate",
            str(MISSION),
            "--set",
            f"seed={seed}",
        ]
        command += ["--runs", str(drives / str(seed))]
        subprocess.run(command, check=True, capture_output=True, stdin=subprocess.DEVNULL)
    return made


def _measured(seed: int) -> Drive:
    made = simulated_drive(seed, DRIVES)
    recording = Recording.read(made / "recording")
    real = Trajectory.read(made / "truth" / "trajectory.tum", recording.crs)
    return Drive.of(recording, seen(made.parent, recording).odometry, real)


def _surveyed(seed: int) -> Drive:
    survey = survey_in_images(seed)
    return Drive.of(survey.recording, survey.found.odometry, survey.real.trajectory)


def fitted(drives: list[Drive]) -> Iterator[Row]:
    """Yield what a model of such errors has to assume, beside what ours does."""
    images, config = LocalizationConfig().images, LocalizationConfig()
    errors = [drive.errors for drive in drives]
    heading = np.array([error.attitude_deg[0, 2] for error in errors])
    yield _beside(
        "heading at the start, by compass", root_mean_square(heading), "deg", images.heading_sigma_deg
    )
    levelled = np.array([error.attitude_deg[:, :2].mean(axis=0) for error in errors])
    yield _beside(
        "roll and pitch, constant part", root_mean_square(levelled), "deg", images.tilt_bias_sigma_deg
    )
    tilt_deg = correlated_sigma_deg(errors, [0, 1], images.attitude_correlation_m)
    yield _beside("roll and pitch, changing part", tilt_deg, "deg", images.tilt_sigma_deg)
    n_torn = sum(int(error.is_torn.sum()) for error in errors)
    yield Row("stretches of 5 m that were followed wrongly", float(n_torn), "1")
    scales = [error.scale[~error.is_torn] for error in errors]
    mean = root_mean_square(np.array([scale.mean() for scale in scales]))
    yield _beside("scale, over a drive", 100.0 * mean, "%", 100.0 * images.scale_sigma)
    sigma, length_m = _wander(scales)
    yield _beside("scale, changing part", 100.0 * sigma, "%", 100.0 * images.scale_wander_sigma)
    yield Row("scale, correlation length", length_m, "m", f"assumed {images.scale_wander_m:g}")
    aside = np.concatenate([error.aside[~error.is_torn] for error in errors])
    yield _beside("sideways and upwards, per root metre", root_mean_square(aside), "m", images.step_sigma_m)
    turns = [_in_turns(drive.errors.scale * drive.errors.length_m, drive) for drive in drives]
    yield _beside(
        "turns, along the way, per root radian",
        root_mean_square(np.concatenate(turns)),
        "m",
        images.turn_sigma_m,
    )
    yield from _wheels(drives, config)


def _wheels(drives: list[Drive], config: LocalizationConfig) -> Iterator[Row]:
    shares, noise, skid = [], [], []
    for drive in drives:
        straight, length = drive.is_straight, drive.errors.length_m
        share = float(drive.wheels_m[straight].sum() / length[straight].sum())
        left = drive.wheels_m - share * length
        shares.append(share)
        noise.append(root_mean_square(left[straight] / np.sqrt(length[straight])))
        skid.append(_in_turns(drive.wheels_m, drive))
    yield _beside(
        "wheels: share that lasts",
        100.0 * root_mean_square(np.array(shares)),
        "%",
        100.0 * config.wheel_scale_sigma,
    )
    yield _beside(
        "wheels: random, per root metre", root_mean_square(np.array(noise)), "m", config.wheel_step_sigma_m
    )
    skidding = root_mean_square(np.concatenate(skid))
    yield _beside("wheels: skidding per root radian", skidding, "m", config.wheel_skid_m)


def _in_turns(along: FloatArray, drive: Drive) -> FloatArray:
    """Return what a length is off by in turns, beyond its share on the straight, per root radian."""
    straight, length = drive.is_straight, drive.errors.length_m
    share = float(along[straight].sum() / length[straight].sum())
    left: FloatArray = (along - share * length)[~straight] / np.sqrt(drive.errors.turned_rad[~straight])
    return left


def _heading_over(drives: list[Drive], far_m: float) -> Row:
    """How much the error of the heading changes over a distance, beside what is assumed."""
    images = LocalizationConfig().images
    change = float(np.sqrt(mean_square_change_deg2([drive.errors for drive in drives], [2], far_m)))
    forgotten = 2.0 * images.yaw_sigma_deg**2 * (1.0 - np.exp(-far_m / images.attitude_correlation_m))
    assumed = float(np.sqrt(forgotten + images.heading_walk_deg_sqrt_m**2 * far_m))
    return _beside(f"heading, change over {far_m:.0f} m", change, "deg", assumed)


def _wander(scales: list[FloatArray]) -> tuple[float, float]:
    """Return standard deviation and correlation length [m] of a Gauss–Markov scale, from its means over 5 m."""
    off = [scale - scale.mean() for scale in scales]
    variance = float(np.mean(np.concatenate(off) ** 2))
    next_one = float(np.mean(np.concatenate([x[1:] * x[:-1] for x in off])))
    # Means over neighbouring stretches d covary by (σ Λ/d)² (1 − e^(−d/Λ))².
    lengths_m = np.geomspace(0.5, 60.0, 400)
    ratio = lengths_m / STRETCH_M
    kept = 1.0 - np.exp(-1.0 / ratio)
    own = 2.0 * ratio * (1.0 - ratio * kept)
    best = int(np.argmin(np.abs((ratio * kept) ** 2 / own - next_one / variance)))
    return float(np.sqrt(variance / own[best])), float(lengths_m[best])


def _beside(name: str, value: float, unit: str, assumed: float) -> Row:
    """Row that holds where no less is assumed than two thirds of what was found; too much is only cautious."""
    return Row(name, value, unit, f"assumed {assumed:.3g}", bool(assumed >= value / 1.5))


if __name__ == "__main__":
    main("Odometry errors", measure)
