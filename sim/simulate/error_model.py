r"""Error model of the statistical fidelity, fitted to drives in images.

The visual odometry of a run is compared with the real path. Errors are estimated minus real.
An attitude error with correlation length Λ, and a random walk of w per square root of a
metre, changes over a distance d by

.. math:: E (x(t + d) - x(t))^2 = 2 \sigma^2 (1 - e^{-d/\Lambda}) + w^2 d

For the stated Λ the changes over 60 m and over 300 m give σ and w of the heading; roll and
pitch, which gravity constrains, do not walk: their changes give σ, and their mean over a drive
the constant part. The landmarks' error across the line of sight follows from their heights above
the real ground at grazing angles; the error along it is not observable, and their claim is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sim.config.mission import SensorConfig
from sim.simulate.simulated_drive import ONBOARD
from survey import InputError, Recording, Trajectory, Truth
from survey.core import BoolArray, FloatArray, root_mean_square
from survey.core.run_folder import RunFolder
from survey.data.sensors.odometry import Odometry
from vision_slam import LocalizationConfig
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.onboard import read_visual_odometry
from vision_slam.places.relocalization import align_heading

STRETCH_M = 5.0
APART_M, FAR_APART_M = 60.0, 300.0
_NEAREST_PER_CENT, _FARTHEST_PER_CENT = 1.0, 99.0
_N_BINS = 8
_NORMAL_MAD = 1.4826
# Stretches with a scale error farther from the median than this are mistracked: they are counted, not fitted.
_TORN = 0.15


@dataclass(frozen=True)
class OdometryErrors:
    """Errors of the odometry of one drive.

    ``attitude_deg`` (N, 3) every 5 m of travel; of the stretches between, which end at
    ``mark_s`` (N,): ``length_m`` (N - 1,), ``turned_rad`` (N - 1,), ``scale`` (N - 1,) and
    ``aside`` (N - 1, 2) [m per root metre].
    """

    attitude_deg: FloatArray
    mark_s: FloatArray
    length_m: FloatArray
    turned_rad: FloatArray
    scale: FloatArray
    aside: FloatArray

    @property
    def is_torn(self) -> BoolArray:
        """Mistracked stretches (N - 1,)."""
        torn: BoolArray = np.abs(self.scale - np.median(self.scale)) > _TORN
        return torn


@dataclass(frozen=True)
class DriveErrors:
    """Errors of odometry and landmarks of one drive in images.

    Of the landmarks of a map: ``range_m`` (M,) at first sight, ``height_m`` (M,)
    above the ground, and ``along_m`` (M,), the standard deviation claimed along the line of sight.
    """

    odometry: OdometryErrors
    range_m: FloatArray
    height_m: FloatArray
    along_m: FloatArray

    @property
    def driven_m(self) -> float:
        """Length of the drive [m]."""
        return float(self.odometry.length_m.sum())


def errors_of(run: RunFolder) -> DriveErrors:
    """Compare the visual odometry of a run with its truth."""
    place = run.folder("simulate")
    if not (place / "recording" / ONBOARD).is_dir():
        raise InputError(f"{run.path} holds no drive in images; run a mission of fidelity vision first.")
    run.verify("simulate")
    recording = Recording.read(place / "recording")
    return drive_errors(
        recording, read_visual_odometry(place / "recording" / ONBOARD), Truth.read(place / "truth")
    )


def drive_errors(recording: Recording, found: VisualOdometry, real: Truth) -> DriveErrors:
    """Compare visual odometry, aligned to the heading of the fixes, with the truth."""
    _, found = align_heading(recording, found)
    errors = odometry_errors(found.odometry, real.trajectory)
    return DriveErrors(errors, *_landmark_errors(found, real))


def odometry_errors(odometry: Odometry, real: Trajectory) -> OdometryErrors:
    """Compare an odometry with the real path."""
    place, turns = _really(odometry, real)
    attitude = turns.as_euler("xyz")
    off = odometry.attitude_rad - attitude
    off = np.unwrap((off + np.pi) % (2.0 * np.pi) - np.pi, axis=0)
    moves = np.einsum("nji,nj->ni", turns.as_matrix()[:-1], np.diff(place, axis=0))
    travel = np.r_[0.0, np.cumsum(np.linalg.norm(moves, axis=1))]
    at = np.arange(0.0, travel[-1], STRETCH_M)
    marks = np.unique(np.searchsorted(travel, at))
    wrong = np.vstack([np.zeros(3), np.cumsum(odometry.step - moves, axis=0)])
    wrong, length = np.diff(wrong[marks], axis=0), np.diff(travel[marks])
    turned = np.r_[0.0, np.cumsum(np.abs(np.diff(np.unwrap(attitude[:, 2]))))]
    return OdometryErrors(
        np.degrees(np.column_stack([np.interp(at, travel, axis) for axis in off.T])),
        odometry.time_s[marks],
        length,
        np.diff(turned[marks]),
        wrong[:, 0] / length,
        wrong[:, 1:] / np.sqrt(length)[:, None],
    )


def _really(odometry: Odometry, real: Trajectory) -> tuple[FloatArray, Rotation]:
    """Return real positions (N, 3) and attitudes at the odometry's times."""
    times = odometry.time_s.clip(*real.time_s[[0, -1]])
    place = np.column_stack([np.interp(times, real.time_s, axis) for axis in real.position.T])
    return place, Slerp(real.time_s, Rotation.from_quat(real.quaternion))(times)


def _landmark_errors(found: VisualOdometry, real: Truth) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return range, height above the ground, and claimed σ along the ray, of the landmarks that pass the gates."""
    seen, gates = found.sightings, LocalizationConfig()
    position, turned = _really(found.odometry, real.trajectory)
    turns = turned.as_matrix()
    usable = (seen.range_m > gates.landmark_min_range_m) & (
        np.linalg.eigvalsh(seen.covariance)[:, -1] <= gates.landmark_max_sigma_m**2
    )
    pose, offset = seen.pose[usable], seen.offset[usable]
    xyz = position[pose] + np.einsum("nij,nj->ni", turns[pose], offset)
    height = xyz[:, 2] - real.dem.at(xyz[:, :2])
    ray = offset / np.linalg.norm(offset, axis=1)[:, None]
    along = np.sqrt(np.einsum("ni,nij,nj->n", ray, seen.covariance[usable], ray))
    known = np.isfinite(height)
    return seen.range_m[usable][known], height[known], along[known]


def fit_sensor_errors(drives: Sequence[DriveErrors], correlation_m: float = APART_M) -> SensorConfig:
    """Fit the sensor errors of the statistical fidelity to drives; receivers keep their defaults.

    `correlation_m`: travel over which attitude errors stay correlated, as the model states it [m].

    The random walk of the heading needs drives of more than 600 m; without one all of its change
    is taken for correlated error. Not modelled: scale errors that vary from metre to metre, and
    errors in turns.
    """
    driven = [drive.odometry for drive in drives if drive.driven_m > 2.0 * APART_M]
    if not driven:
        raise InputError(
            f"errors of attitude need a drive of more than {2.0 * APART_M:g} m; take a longer one."
        )
    across, along = _by_range(drives, 1), _by_range(drives, 2)
    ranges = np.concatenate([drive.range_m for drive in drives])
    near, far = np.percentile(ranges, [_NEAREST_PER_CENT, _FARTHEST_PER_CENT])
    yaw, walk = _wandering_and_walk(driven, correlation_m)
    levels = np.array([drive.attitude_deg[:, :2].mean(axis=0) for drive in driven])
    values = {
        "yaw_sigma_deg": yaw,
        "heading_walk_deg_sqrt_m": walk,
        "tilt_sigma_deg": correlated_sigma_deg(driven, [0, 1], correlation_m),
        "tilt_bias_sigma_deg": root_mean_square(levels),
        "attitude_correlation_m": correlation_m,
        "scale_sigma": root_mean_square(np.array([np.median(drive.odometry.scale) for drive in drives])),
        "step_sigma_m": root_mean_square(
            np.concatenate([d.odometry.aside[~d.odometry.is_torn] for d in drives])
        ),
        "landmarks_per_m": len(ranges) / sum(drive.driven_m for drive in drives),
    }
    rounded = {name: float(f"{value:.3g}") for name, value in values.items()}
    pairs = {
        "landmark_range_m": (near, far),
        "landmark_cross_sigma_m": across,
        "landmark_along_sigma_m": along,
    }
    rounded_pairs = {name: tuple(float(f"{value:.3g}") for value in pair) for name, pair in pairs.items()}
    return SensorConfig.model_validate(rounded | rounded_pairs)


def _wandering_and_walk(driven: Sequence[OdometryErrors], correlation_m: float) -> tuple[float, float]:
    """Return σ of the correlated heading error [deg], and its random walk [deg per root metre]."""
    # Two equations for two unknowns: the correlated part saturates with distance, the random walk grows on.
    near, far = _mean_square_change(APART_M, correlation_m), _mean_square_change(FAR_APART_M, correlation_m)
    change = mean_square_change_deg2(driven, [2])
    long_enough = [drive for drive in driven if drive.length_m.sum() > 2.0 * FAR_APART_M]
    walked = 0.0
    if long_enough:
        beyond = (
            mean_square_change_deg2(long_enough, [2], FAR_APART_M)
            - mean_square_change_deg2(long_enough, [2]) * far / near
        )
        walked = max(beyond / (FAR_APART_M - APART_M * far / near), 0.0)
    return float(np.sqrt(max(change - walked * APART_M, 0.0) / near)), float(np.sqrt(walked))


def correlated_sigma_deg(driven: Sequence[OdometryErrors], axes: list[int], correlation_m: float) -> float:
    """Return σ of attitude errors without a random walk [deg]."""
    return float(np.sqrt(mean_square_change_deg2(driven, axes) / _mean_square_change(APART_M, correlation_m)))


def mean_square_change_deg2(
    driven: Sequence[OdometryErrors], axes: list[int], apart_m: float = APART_M
) -> float:
    """Return the mean square change of attitude errors over a distance [deg²]; axes are roll, pitch, yaw."""
    lag = round(apart_m / STRETCH_M)
    changes = [drive.attitude_deg[lag:, axes] - drive.attitude_deg[:-lag, axes] for drive in driven]
    return float(np.mean(np.concatenate(changes) ** 2))


def _mean_square_change(apart_m: float, correlation_m: float) -> float:
    """Return the mean square change of a correlated error of variance 1 over a distance."""
    return float(2.0 * (1.0 - np.exp(-apart_m / correlation_m)))


def _by_range(drives: Sequence[DriveErrors], power: int) -> tuple[float, float]:
    """Fit a + b r^power, neither below 0, to landmark errors across (1) or along (2) the line of sight."""
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
