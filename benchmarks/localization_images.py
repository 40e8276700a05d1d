"""What fixes make of the odometry of images: drives of 280 m, several receivers' luck on each.

Run with ``python -m benchmarks.localization_images``. The drives are those of ``examples/glacier_drive.toml`` with seeds
on which nothing was chosen, their images rendered once and stored in the system's folder for temporary files; on each, the
receiver of the mission is drawn eight times, because the luck of one draw would hide the rest. Places that the images
recognise are left out: these drives never meet themselves.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.image_surveys import seen
from benchmarks.odometry_errors import simulated_drive
from benchmarks.report import Row, main
from benchmarks.stored_parts import simulated_folder
from sim.instruments.sensor import gauss_markov
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.recording import Recording
from survey.data.sensors.records import GpsFixes
from survey.data.trajectory import Trajectory
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import filter_path, gate_fixes
from vision_slam.fusion.smoother import smooth
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.places.relocalization import align_heading

SEEDS = (21, 22, 23, 24, 25)
DRIVES = simulated_folder("drives")
_N_DRAWS = 8
_NAMES = ("odometry alone, headed by the fixes", "online", "smoothed")


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    done = []
    for seed in SEEDS[:1] if quick else SEEDS:
        folder = simulated_drive(seed, DRIVES)
        recording = Recording.read(folder / "recording")
        done.append(judged(recording, seen(folder.parent, recording), folder, 2 if quick else _N_DRAWS))
    yield from rows(done)


@dataclass(frozen=True)
class Outcome:
    """Errors of one drive under D draws of the receiver: ``level_m`` and ``height_m`` (3, D), ``squared`` (2, D, 3).

    The last are the mean squares of normalised errors per dimension, online and smoothed: of
    the whole position, of its level part, and of its elevation.
    """

    level_m: FloatArray
    height_m: FloatArray
    squared: FloatArray


def judged(recording: Recording, found: VisualOdometry, folder: Path, n_draws: int) -> Outcome:
    """Localize one drive under several draws of the receiver."""
    config = LocalizationConfig().with_image_errors()
    real = Trajectory.read(folder / "truth" / "trajectory.tum", recording.crs)
    times = found.odometry.time_s
    place = _at(times, real)
    level, height, squared = [], [], []
    for draw in range(n_draws):
        seen, _ = align_heading(replace(recording, gps=_fixes(recording, real, config, draw)), found)
        reckoned = dead_reckoning(seen.odometry, seen.start)
        online = filter_path(seen, reckoned, config)
        smoothed = smooth(gate_fixes(seen, online), reckoned, config)
        errors = [path - place for path in (reckoned, online.position, smoothed.position)]
        level.append([np.sqrt((error[:, :2] ** 2).sum(axis=1).mean()) for error in errors])
        height.append([np.sqrt((error[:, 2] ** 2).mean()) for error in errors])
        spreads = (online.covariance, smoothed.covariance[:, :3, :3])
        squared.append([_squared(error, spread) for error, spread in zip(errors[1:], spreads, strict=True)])
    return Outcome(np.array(level).T, np.array(height).T, np.array(squared).transpose(1, 0, 2))


def rows(done: list[Outcome]) -> Iterator[Row]:
    """Yield what the drives together show."""
    level = np.concatenate([out.level_m for out in done], axis=1)
    height = np.concatenate([out.height_m for out in done], axis=1)
    for k, name in enumerate(_NAMES):
        yield Row(f"{name}: horizontal, median", float(np.median(level[k])), "m")
        yield Row(f"{name}: horizontal, worst", float(level[k].max()), "m")
        yield Row(f"{name}: elevation, median", float(np.median(height[k])), "m")
    ratio = float(np.median(level[2]) / np.median(level[0]))
    yield Row.of("smoothed over odometry alone, horizontal, medians", ratio, "1", "<=", 1.0)
    yield Row("share of draws in which smoothing is worse", float(np.mean(level[2] > level[0])), "1")
    squared = np.concatenate([out.squared for out in done], axis=1)
    for k, name in enumerate(_NAMES[1:]):
        for part, shown in enumerate(("pose", "horizontal", "elevation")):
            ratio = float(np.sqrt(squared[k, :, part].mean()))
            held = 0.8 <= ratio <= 1.3
            yield Row(f"{name}: normalised {shown} error", ratio, "1", "0.8 to 1.3", held)


def _fixes(recording: Recording, real: Trajectory, config: LocalizationConfig, draw: int) -> GpsFixes:
    """Draw the fixes of a receiver such as the mission's."""
    times = recording.gps.time_s
    rng = stream(draw, "localization of images", "receiver")
    tau_s, sigma_m = config.gps_correlation_time_s, config.gps_bias_sigma_m
    error = gauss_markov(np.diff(times), tau_s, sigma_m, rng, 3)
    error = error + config.gps_white_sigma_m * rng.standard_normal(error.shape)
    antenna = _at(times, real) + [0.0, 0.0, recording.antenna_height_m]
    return GpsFixes(times, antenna + error * [1.0, 1.0, config.gps_vertical_factor])


def _squared(error: FloatArray, spread: FloatArray) -> FloatArray:
    """Mean squares of normalised errors per dimension (3,); the first 20 poses, at a known start, left out."""
    return np.array(
        [
            np.einsum("ni,nij,nj->n", part[20:], np.linalg.inv(own[20:]), part[20:]).mean() / part.shape[1]
            for part, own in (
                (error, spread),
                (error[:, :2], spread[:, :2, :2]),
                (error[:, 2:], spread[:, 2:, 2:]),
            )
        ]
    )


def _at(time_s: FloatArray, real: Trajectory) -> FloatArray:
    return np.column_stack([np.interp(time_s, real.time_s, axis) for axis in real.position.T])


if __name__ == "__main__":
    main("Localization of images", measure)
