"""Trajectory evaluation: absolute and relative errors, alignment, consistency."""

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray, IntArray
from survey.core.crs.agreement import same_crs
from survey.core.errors import InputError
from survey.data.trajectory import Trajectory
from vision_slam.alignment import alignment


@dataclass(frozen=True)
class TrajectoryError:
    """Absolute trajectory error, without any alignment.

    Parameters
    ----------
    horizontal_rms_m, vertical_rms_m : float
        Root mean square over all poses [m].
    end_m : float
        Error of the last pose [m].
    end_per_cent : float
        The same as a share of the distance travelled [%].
    worst_m : float
        Largest error of a pose [m].
    normalised_squared : float
        Mean of eᵀ P⁻¹ e; 3 when the covariances are consistent.
    """

    horizontal_rms_m: float
    vertical_rms_m: float
    end_m: float
    end_per_cent: float
    worst_m: float
    normalised_squared: float

    def to_dict(self) -> dict[str, float]:
        """Return the figures by name.

        Returns
        -------
        dict of str to float
            Names as in JSON.
        """
        return asdict(self)


def trajectory_error(estimate: Trajectory, reference: Trajectory) -> TrajectoryError:
    """Compare an estimated trajectory with a reference, pose by pose in time.

    Nothing is aligned: scale, heading and place errors all count. The reference is
    interpolated linearly to the estimate's times.

    Parameters
    ----------
    estimate, reference : Trajectory
        In the same CRS; the reference covers the times of the estimate.

    Returns
    -------
    TrajectoryError
        Errors [m] and the mean normalised squared error.

    Raises
    ------
    InputError
        Different CRS, or times of the estimate that the reference does not cover.

    Examples
    --------
    >>> import numpy as np
    >>> def line(shift):
    ...     place = np.column_stack([np.arange(3.0), np.zeros(3), np.full(3, shift)])
    ...     return Trajectory(np.arange(3.0), place, np.tile([0, 0, 0, 1.0], (3, 1)), np.tile(np.eye(3), (3, 1, 1)), "EPSG:32608")
    >>> trajectory_error(line(0.5), line(0.0)).vertical_rms_m
    0.5
    """
    same_crs(estimate.crs, reference.crs, "the two trajectories")
    first, last = reference.time_s[[0, -1]]
    if estimate.time_s[0] < first - 1e-9 or estimate.time_s[-1] > last + 1e-9:
        raise InputError(
            f"the estimate covers {estimate.time_s[0]:.1f} to {estimate.time_s[-1]:.1f} s, the reference only "
            f"{first:.1f} to {last:.1f} s; cut the estimate or take another reference."
        )
    place = np.column_stack([np.interp(estimate.time_s, reference.time_s, c) for c in reference.position.T])
    error = estimate.position - place
    distance = np.linalg.norm(error, axis=1)
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(estimate.covariance, error[:, :, None])[:, :, 0])
    return TrajectoryError(
        horizontal_rms_m=float(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2))),
        vertical_rms_m=float(np.sqrt(np.mean(error[:, 2] ** 2))),
        end_m=float(distance[-1]),
        end_per_cent=float(100.0 * distance[-1] / reference.length_m),
        worst_m=float(distance.max()),
        normalised_squared=float(squared.mean()),
    )


def absolute_errors_m(
    estimate: FloatArray, reference: FloatArray, kind: Literal["none", "se3", "sim3"] = "none"
) -> FloatArray:
    """Return the absolute trajectory error of each matched position after an alignment.

    Parameters
    ----------
    estimate, reference : (N, 3) ndarray
        Matched positions [m].
    kind : {"none", "se3", "sim3"}
        Alignment before the comparison.

    Returns
    -------
    (N,) ndarray
        Distances [m].

    Examples
    --------
    >>> places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> absolute_errors_m(places + [3.0, 0.0, 4.0], places).tolist()
    [5.0, 5.0, 5.0, 5.0]
    """
    errors: FloatArray = np.linalg.norm(
        alignment(estimate, reference, kind).applied(estimate) - reference, axis=1
    )
    return errors


def relative_errors(
    estimate: FloatArray, reference: FloatArray, distance_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return the relative pose error over stretches of the estimated path: translation [m] and rotation [rad].

    The estimate is cut into stretches of `distance_m`, one after the other (as evo does,
    so that figures can be compared). Over each, E =
    (R_i⁻¹ R_j)⁻¹ (E_i⁻¹ E_j) with R the reference's poses and E the estimated ones; the
    errors are the length of its translation and the angle of its rotation.

    Parameters
    ----------
    estimate, reference : (N, 4, 4) ndarray
        Matched poses, body to world.
    distance_m : float
        Length of a stretch [m].

    Returns
    -------
    translation_m : (S,) ndarray
        Errors of translation [m].
    rotation_rad : (S,) ndarray
        Errors of rotation [rad].

    Raises
    ------
    InputError
        The estimate is shorter than one stretch.
    """
    steps = np.linalg.norm(np.diff(estimate[:, :3, 3], axis=0), axis=1)
    ends, since = [0], 0.0
    for index, step in enumerate(steps.tolist(), start=1):
        since += step
        if since >= distance_m:
            ends.append(index)
            since = 0.0
    if len(ends) < 2:
        raise InputError(
            f"the estimate is {steps.sum():.1f} m long, shorter than the stretch of {distance_m} m; take a shorter one."
        )
    i, j = np.array(ends[:-1]), np.array(ends[1:])
    error = _inverse(_inverse(reference[i]) @ reference[j]) @ _inverse(estimate[i]) @ estimate[j]
    turn = np.asarray(Rotation.from_matrix(error[:, :3, :3]).magnitude())
    return np.linalg.norm(error[:, :3, 3], axis=1), turn


def _inverse(poses: FloatArray) -> FloatArray:
    """Return the inverse of rigid poses (N, 4, 4); text files round rotations, their transpose stays as good."""
    inverse = np.tile(np.eye(4), (len(poses), 1, 1))
    inverse[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    inverse[:, :3, 3] = -np.einsum("nij,nj->ni", inverse[:, :3, :3], poses[:, :3, 3])
    return inverse


def match_times(
    first_s: FloatArray, second_s: FloatArray, within_s: float = 0.01
) -> tuple[IntArray, IntArray]:
    """Pair times: each of the shorter list with its nearest in the other, where not farther than `within_s`.

    Parameters
    ----------
    first_s, second_s : (N,) and (M,) ndarray
        Increasing times [s].
    within_s : float
        Largest difference of a pair [s].

    Returns
    -------
    first, second : (K,) ndarray of int
        Indices of the pairs.

    Examples
    --------
    >>> [list(map(int, side)) for side in match_times(np.array([0.0, 1.0]), np.array([0.001, 0.5, 2.0]))]
    [[0], [0]]
    """
    if len(first_s) > len(second_s):
        second, first = match_times(second_s, first_s, within_s)
        return first, second
    after = np.searchsorted(second_s, first_s).clip(1, max(len(second_s) - 1, 1))
    before_is_nearer = first_s - second_s[after - 1] <= second_s[after.clip(max=len(second_s) - 1)] - first_s
    nearest = np.where(before_is_nearer, after - 1, after.clip(max=len(second_s) - 1))
    keep = np.flatnonzero(np.abs(second_s[nearest] - first_s) <= within_s)
    return keep.astype(np.int64), nearest[keep].astype(np.int64)
