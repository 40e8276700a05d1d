"""Comparison of an estimated path with a reference path."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.errors import InputError
from survey.data.trajectory import Trajectory
from vision_slam.drive_estimate import DriveEstimate
from vision_slam.evaluation import absolute_errors_m, match_times


@dataclass(frozen=True)
class Comparison:
    """Positions of an estimate and of its reference at the same times.

    Parameters
    ----------
    position, reference : (K, 3) ndarray
        Positions of both [m].
    covariance : (K, 3, 3) ndarray, optional
        Claimed covariances of `position` [m²].
    is_lost : (K,) ndarray of bool, optional
        Whether each pose is unreliable.
    """

    position: FloatArray
    reference: FloatArray
    covariance: FloatArray | None
    is_lost: BoolArray | None

    @property
    def figures(self) -> dict[str, float]:
        """Errors without any alignment [m], by name."""
        error = self.position - self.reference
        distance = absolute_errors_m(self.position, self.reference)
        driven = float(np.linalg.norm(np.diff(self.reference, axis=0), axis=1).sum())
        return {
            "horizontal_rms_m": float(np.sqrt(np.mean(error[:, :2] ** 2) * 2.0)),
            "vertical_rms_m": float(np.sqrt(np.mean(error[:, 2] ** 2))),
            "end_error_m": float(distance[-1]),
            "worst_error_m": float(distance.max()),
            "end_error_per_cent": 100.0 * float(distance[-1]) / max(driven, 1e-9),
        }


def compare_in_crs(estimate: Trajectory, reference: Trajectory) -> Comparison:
    """Compare a trajectory with a reference in the same CRS, interpolated to its times.

    Raises
    ------
    InputError
        Another CRS, or no common time.
    """
    same_crs(estimate.crs, reference.crs, "the estimate and its reference")
    common = (estimate.time_s >= reference.time_s[0]) & (estimate.time_s <= reference.time_s[-1])
    if common.sum() < 2:
        raise InputError(
            f"the reference covers {reference.time_s[0]:.1f} to {reference.time_s[-1]:.1f} s and none of the path; "
            "name one of the same drive."
        )
    time_s = estimate.time_s[common]
    real = np.column_stack([np.interp(time_s, reference.time_s, axis) for axis in reference.position.T])
    is_lost = np.asarray(estimate.health)[common] < 0.5
    return Comparison(estimate.position[common], real, estimate.covariance[common], is_lost)


def compare_from_start(estimate: DriveEstimate, time_s: FloatArray, reference: FloatArray) -> Comparison:
    """Compare an estimate with reference poses (R, 4, 4), both relative to the first pose that they share.

    Raises
    ------
    InputError
        Fewer than two poses have a reference within 0.01 s.
    """
    estimated, real = match_times(estimate.time_s, time_s)
    if len(estimated) < 2:
        raise InputError(
            "fewer than two poses have a reference within 0.01 s; give reference poses at the images' times."
        )
    first = reference[real[0]]
    in_first = (reference[real, :3, 3] - first[:3, 3]) @ first[:3, :3]
    origin = estimate.position[estimated[0]]
    return Comparison(
        estimate.position[estimated],
        in_first + origin,
        _rows(estimate.covariance, estimated),
        _rows(estimate.is_lost, estimated),
    )


def _rows(values: Any, chosen: Any) -> Any:
    return None if values is None else values[chosen]
