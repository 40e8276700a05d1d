r"""The error model of the statistical fidelity, fitted to drives in images.

What the images of a run gave on board is held against where the rover really was. Errors are
estimated minus real. An attitude error that forgets itself over Λ changes over a distance d by

.. math:: E (x(t + d) - x(t))^2 = 2 \sigma^2 (1 - e^{-d/\Lambda})

which tells σ for the stated Λ. What landmarks err by across the line of sight is read from their
heights above the real ground, seen at grazing angles; what they err by along it is not seen, and
is what they claim.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sim.config import SensorConfig
from sim.drive import ONBOARD
from survey.arrays import FloatArray
from survey.errors import InputError
from survey.recording import Recording
from survey.store import RunFolder
from survey.truth import Truth
from vision_slam import LocalizationConfig
from vision_slam.onboard import read_seen
from vision_slam.pipeline import headed
from vision_slam.visual_slam import VisualOdometry

_STRETCH_M, _APART_M = 5.0, 60.0
_NEAREST_PER_CENT, _FARTHEST_PER_CENT = 1.0, 99.0
_N_BINS = 8
_NORMAL_MAD = 1.4826


@dataclass(frozen=True)
class DriveErrors:
    """What one drive in images was wrong by.

    ``attitude_deg`` (N, 3) every 5 m; per stretch of 5 m ``scale`` (N - 1,) and ``aside``
    (N - 1, 2) [m per root metre]; of the landmarks that a map is made of ``range_m`` (M,) at
    first sight, ``height_m`` (M,) above the ground, and ``along_m`` (M,), the standard deviation
    claimed along the line of sight; ``length_m`` of the drive.
    """

    attitude_deg: FloatArray
    scale: FloatArray
    aside: FloatArray
    range_m: FloatArray
    height_m: FloatArray
    along_m: FloatArray
    length_m: float


def errors_of(run: RunFolder) -> DriveErrors:
    """Hold what the onboard computer saw on a run against what was real.

    Raises
    ------
    InputError
        The run has no drive in images.
    """
    place = run.folder("simulate")
    if not (place / "recording" / ONBOARD).is_dir():
        raise InputError(f"{run.path} holds no drive in images; run a mission of fidelity vision first.")
    real = Truth.read(place / "truth")
    recording = Recording.read(place / "recording")
    _, found = headed(recording, read_seen(place / "recording" / ONBOARD))
    path = real.trajectory
    times = found.odometry.time_s.clip(*path.time_s[[0, -1]])
    position = np.column_stack([np.interp(times, path.time_s, axis) for axis in path.position.T])
    turns = Slerp(path.time_s, Rotation.from_quat(path.quaternion))(times)
    moves = np.einsum("nji,nj->ni", turns.as_matrix()[:-1], np.diff(position, axis=0))
    travel = np.r_[0.0, np.cumsum(np.linalg.norm(moves, axis=1))]
    marks = np.unique(np.searchsorted(travel, np.arange(0.0, travel[-1], _STRETCH_M)))
    wrong = np.add.reduceat(found.odometry.step - moves, marks[:-1], axis=0)[:-1]
    length = np.diff(travel[marks])[:-1]
    off = found.odometry.attitude_rad - turns.as_euler("xyz")
    off = np.unwrap((off + np.pi) % (2.0 * np.pi) - np.pi, axis=0)
    return DriveErrors(
        np.degrees(off[marks]),
        wrong[:, 0] / length,
        wrong[:, 1:] / np.sqrt(length)[:, None],
        *_landmark_errors(found, position, turns.as_matrix(), real),
        float(travel[-1]),
    )


def _landmark_errors(
    found: VisualOdometry, position: FloatArray, turns: FloatArray, real: Truth
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return range, height above the ground, and claimed σ along the ray, of the landmarks that pass the gates."""
    seen, gates = found.sightings, LocalizationConfig()
    kept = (seen.range_m > gates.landmark_min_range_m) & (
        np.linalg.eigvalsh(seen.covariance)[:, -1] <= gates.landmark_max_sigma_m**2
    )
    pose, offset = seen.pose[kept], seen.offset[kept]
    xyz = position[pose] + np.einsum("nij,nj->ni", turns[pose], offset)
    height = xyz[:, 2] - real.dem.at(xyz[:, :2])
    ray = offset / np.linalg.norm(offset, axis=1)[:, None]
    along = np.sqrt(np.einsum("ni,nij,nj->n", ray, seen.covariance[kept], ray))
    known = np.isfinite(height)
    return seen.range_m[kept][known], height[known], along[known]


def fitted(drives: Sequence[DriveErrors], correlation_m: float = _APART_M) -> SensorConfig:
    """Return the sensors of the statistical fidelity that err as these drives did; receivers stay as they are.

    Parameters
    ----------
    drives : sequence of DriveErrors
        On which nothing is judged.
    correlation_m : float
        Travel over which attitude errors stay correlated, as the model states it [m].

    Raises
    ------
    InputError
        No drive is longer than twice the distance over which errors are compared.
    """
    long_enough = [drive for drive in drives if drive.length_m > 2.0 * _APART_M]
    if not long_enough:
        raise InputError(
            f"errors of attitude need a drive of more than {2.0 * _APART_M:g} m; take a longer one."
        )
    across, along = _by_range(drives, 1), _by_range(drives, 2)
    ranges = np.concatenate([drive.range_m for drive in drives])
    near, far = np.percentile(ranges, [_NEAREST_PER_CENT, _FARTHEST_PER_CENT])
    metres = sum(drive.length_m for drive in drives)
    values = {
        "yaw_sigma_deg": _changing(long_enough, [2], correlation_m),
        "tilt_sigma_deg": _changing(long_enough, [0, 1], correlation_m),
        "attitude_correlation_m": correlation_m,
        "scale_sigma": _rms(np.array([np.median(drive.scale) for drive in drives])),
        "step_sigma_m": _rms(np.concatenate([drive.aside for drive in drives])),
        "landmarks_per_m": len(ranges) / metres,
    }
    rounded = {name: float(f"{value:.3g}") for name, value in values.items()}
    pairs = {
        "landmark_range_m": (near, far),
        "landmark_cross_sigma_m": across,
        "landmark_along_sigma_m": along,
    }
    told = {name: tuple(float(f"{value:.3g}") for value in pair) for name, pair in pairs.items()}
    return SensorConfig.model_validate(rounded | told)


def _by_range(drives: Sequence[DriveErrors], power: int) -> tuple[float, float]:
    """Fit a + b r^power, neither below 0, to what landmarks err by across (1) or along (2) the line of sight."""
    ranges = np.concatenate([drive.range_m for drive in drives])
    values = np.concatenate([drive.height_m if power == 1 else drive.along_m for drive in drives])
    edges = np.quantile(ranges, np.linspace(0.0, 1.0, _N_BINS + 1))
    which = np.clip(np.searchsorted(edges, ranges) - 1, 0, _N_BINS - 1)
    filled = [index for index in range(_N_BINS) if (which == index).sum() > 1]
    middle = np.array([np.median(ranges[which == index]) for index in filled])
    if power == 1:
        sigma = np.array([_NORMAL_MAD * np.median(np.abs(values[which == index])) for index in filled])
    else:
        sigma = np.array([np.median(values[which == index]) for index in filled])
    slope, constant = np.polyfit(middle**power, sigma, 1)
    if slope < 0.0:
        return float(sigma.mean()), 0.0
    return (float(constant), float(slope)) if constant > 0.0 else (0.0, float(np.mean(sigma / middle**power)))


def _changing(drives: Sequence[DriveErrors], axes: list[int], length_m: float) -> float:
    lag = round(_APART_M / _STRETCH_M)
    changes = [drive.attitude_deg[lag:, axes] - drive.attitude_deg[:-lag, axes] for drive in drives]
    return _rms(np.concatenate(changes)) / float(np.sqrt(2.0 * (1.0 - np.exp(-_APART_M / length_m))))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
