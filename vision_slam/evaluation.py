"""Trajectory evaluation: absolute and relative errors, alignment, comparison with a reference, consistency.

`trajectory_error` compares two trajectories in one CRS without alignment. `alignment` finds the least-squares similarity
transform between matched positions (Umeyama 1991). `Comparison` holds the poses of an estimate and of a reference at the
same times, and gives their errors by name. `consistency` tests the normalised squared errors of independent runs
against the χ² distribution (Bar-Shalom et al. 2001, section 5.4.2).
"""

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp
from scipy.special import gammaincinv

from survey import InputError, Trajectory
from survey.core import BoolArray, FloatArray, IntArray, same_crs

if TYPE_CHECKING:
    from vision_slam.drive_estimate import DriveEstimate


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

    `estimate`, `reference` (N, 3): matched positions [m]. Returns (N,): distances [m].

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

    `estimate`, `reference` (N, 4, 4): matched poses, body to world. `distance_m`: length of a stretch [m].
    Returns `translation_m` (S,): errors of translation [m]. `rotation_rad` (S,): errors of rotation [rad].
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

    `first_s`, `second_s` (N,) and (M,): increasing times [s]. `within_s`: largest difference of a pair [s].
    Returns `first, second` (K,) int: indices of the pairs.

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


@dataclass(frozen=True)
class Alignment:
    """Similarity transform x → s R x + t from one trajectory to another."""

    rotation: FloatArray
    translation: FloatArray
    scale: float

    def applied(self, position: FloatArray) -> FloatArray:
        """Apply the transform to positions (N, 3).

        `position` (N, 3): positions [m]. Returns (N, 3): transformed positions [m].
        """
        moved: FloatArray = self.scale * position @ self.rotation.T + self.translation
        return moved


def alignment(
    estimate: FloatArray, reference: FloatArray, kind: Literal["none", "se3", "sim3"] = "sim3"
) -> Alignment:
    r"""Find the least-squares similarity between matched positions (N, 3) (Umeyama 1991, Eqs. 40-42).

    With Σ the covariance of reference and estimate, UDVᵀ its singular values and S the
    identity whose last entry is the sign of det(U) det(V),

    .. math:: R = U S Vᵀ, \quad s = tr(D S) / σ²_{estimate}, \quad t = μ_{reference} − s R μ_{estimate}

    ``"se3"`` sets s = 1; ``"none"`` aligns nothing.

    `estimate`, `reference` (N, 3): matched positions [m].

    >>> places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> alignment(places, 2.0 * places + 5.0).scale
    2.0
    """
    if estimate.shape != reference.shape or estimate.ndim != 2 or estimate.shape[1] != 3:
        raise InputError(
            f"places of the shapes {estimate.shape} and {reference.shape} cannot be compared; match them by time first."
        )
    if kind == "none":
        return Alignment(np.eye(3), np.zeros(3), 1.0)
    of_estimate, of_reference = estimate.mean(axis=0), reference.mean(axis=0)
    spread = estimate - of_estimate
    u, d, vt = np.linalg.svd((reference - of_reference).T @ spread / len(estimate))
    if np.count_nonzero(d > 1e-12 * max(d[0], 1e-300)) < 2:
        raise InputError("the trajectories run along a line or stand still; no rotation can be fitted.")
    mirror = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = (u * mirror) @ vt
    scale = float(d @ mirror / np.mean((spread**2).sum(axis=1))) if kind == "sim3" else 1.0
    return Alignment(rotation, of_reference - scale * rotation @ of_estimate, scale)


_STRETCH_SHARE = 0.1  # of the path, over which relative errors are taken


@dataclass(frozen=True)
class Comparison:
    """Poses of an estimate and of its reference at the same times.

    `position`, `reference` (K, 3): positions of both [m]. `covariance` (K, 3, 3): claimed covariances of
    `position` [m²]. `is_lost` (K,) bool: whether each pose is unreliable. `attitude`, `reference_attitude`
    (K, 3, 3): rotations of both, body to world; None where the reference has positions only.
    """

    position: FloatArray
    reference: FloatArray
    covariance: FloatArray | None
    is_lost: BoolArray | None
    attitude: FloatArray | None = None
    reference_attitude: FloatArray | None = None

    @property
    def figures(self) -> dict[str, float]:
        """Errors by name: as they are, aligned, relative, and over what is claimed.

        Without alignment: root mean squares, end and worst error [m]. Aligned: ``ate_se3_m`` and
        ``ate_sim3_m``, root mean squares. ``scale_error_per_cent`` of the travel and
        ``scale_drift_per_cent`` from the first to the last third of it. With attitudes of the
        reference ``yaw_rms_deg``, and ``rpe_per_cent`` and ``rpe_deg`` over stretches of a tenth
        of the path. With covariances ``nees_2d`` and ``nees_3d``, 2 and 3 where they are true.
        """
        error = self.position - self.reference
        distance = absolute_errors_m(self.position, self.reference)
        return {
            "horizontal_rms_m": float(np.sqrt(np.mean(error[:, :2] ** 2) * 2.0)),
            "vertical_rms_m": float(np.sqrt(np.mean(error[:, 2] ** 2))),
            "end_error_m": float(distance[-1]),
            "worst_error_m": float(distance.max()),
            "end_error_per_cent": 100.0 * float(distance[-1]) / max(_length(self.reference), 1e-9),
            **self._aligned,
            **self._scale,
            **self._relative,
            **self._normalized,
        }

    @property
    def _aligned(self) -> dict[str, float]:
        """Root mean squares after alignment; none for paths on a line, which fix no rotation."""
        if np.linalg.matrix_rank(self.reference - self.reference.mean(axis=0), tol=1e-6) < 2:
            return {}
        kinds: tuple[Literal["se3", "sim3"], ...] = ("se3", "sim3")
        errors = {kind: absolute_errors_m(self.position, self.reference, kind) for kind in kinds}
        return {f"ate_{kind}_m": float(np.sqrt(np.mean(off**2))) for kind, off in errors.items()}

    @property
    def _scale(self) -> dict[str, float]:
        travel = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(self.reference, axis=0), axis=1))]
        first, last = np.searchsorted(travel, [travel[-1] / 3.0, 2.0 * travel[-1] / 3.0])
        thirds = slice(0, first + 1), slice(last, None)
        ratios = [_length(self.position[part]) / max(_length(self.reference[part]), 1e-9) for part in thirds]
        error = _length(self.position) / max(travel[-1], 1e-9) - 1.0
        drift = ratios[1] / max(ratios[0], 1e-9) - 1.0
        return {"scale_error_per_cent": 100.0 * float(error), "scale_drift_per_cent": 100.0 * drift}

    @property
    def _relative(self) -> dict[str, float]:
        if self.attitude is None or self.reference_attitude is None:
            return {}
        off = self.attitude @ self.reference_attitude.transpose(0, 2, 1)
        yaw = np.degrees(np.arctan2(off[:, 1, 0], off[:, 0, 0]))
        stretch_m = _STRETCH_SHARE * _length(self.position)
        if stretch_m <= 0.0:
            return {"yaw_rms_deg": float(np.sqrt(np.mean(yaw**2)))}
        translation_m, rotation_rad = relative_errors(
            _poses(self.position, self.attitude), _poses(self.reference, self.reference_attitude), stretch_m
        )
        return {
            "yaw_rms_deg": float(np.sqrt(np.mean(yaw**2))),
            "rpe_per_cent": 100.0 * float(np.sqrt(np.mean(translation_m**2))) / stretch_m,
            "rpe_deg": float(np.degrees(np.sqrt(np.mean(rotation_rad**2)))),
        }

    @property
    def _normalized(self) -> dict[str, float]:
        if self.covariance is None:
            return {}
        error = self.position - self.reference
        claimed = np.linalg.eigvalsh(self.covariance)[:, 0] > 0.0
        if not claimed.any():
            return {}
        figures = {}
        for n in (2, 3):
            off, spread = error[claimed, :n], self.covariance[claimed, :n, :n]
            squared = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[:, :, None])[:, :, 0])
            figures[f"nees_{n}d"] = float(squared.mean())
        return figures


def _length(places: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def _poses(position: FloatArray, attitude: FloatArray) -> FloatArray:
    poses = np.tile(np.eye(4), (len(position), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = attitude, position
    return poses


def compare_in_crs(estimate: Trajectory, reference: Trajectory) -> Comparison:
    """Compare a trajectory with a reference in the same CRS, interpolated to its times."""
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
    attitudes: tuple[FloatArray | None, FloatArray | None] = (None, None)
    if np.ptp(reference.quaternion, axis=0).any():  # fixes as a reference have no attitude
        turns = Slerp(reference.time_s, Rotation.from_quat(reference.quaternion))(time_s)
        attitudes = Rotation.from_quat(estimate.quaternion[common]).as_matrix(), turns.as_matrix()
    return Comparison(estimate.position[common], real, estimate.covariance[common], is_lost, *attitudes)


def compare_from_start(estimate: "DriveEstimate", time_s: FloatArray, reference: FloatArray) -> Comparison:
    """Compare an estimate with reference poses (R, 4, 4), both relative to the first pose that they share."""
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
        Rotation.from_quat(estimate.quaternion[estimated]).as_matrix(),
        first[:3, :3].T @ reference[real, :3, :3],
    )


def compare_aligned(estimate: "DriveEstimate", time_s: FloatArray, reference: FloatArray) -> Comparison:
    """Compare a path in a CRS with reference poses (R, 4, 4) of their own frame, moved onto it by heading and shift."""
    own = compare_from_start(estimate, time_s, reference)
    place, real = own.position - own.position.mean(axis=0), own.reference - own.reference.mean(axis=0)
    z, g = (level[:, 0] + 1j * level[:, 1] for level in (real, place))
    turn = Rotation.from_euler("z", float(np.angle((g * z.conj()).sum()))).as_matrix()
    attitude = own.reference_attitude
    return replace(
        own,
        reference=real @ turn.T + own.position.mean(axis=0),
        reference_attitude=None if attitude is None else turn @ attitude,
    )


def _rows(values: Any, chosen: Any) -> Any:
    return None if values is None else values[chosen]


@dataclass(frozen=True)
class Consistency:
    """Mean normalised squared error and the band of consistent covariances.

    For errors of D dimensions from N independent runs, N times the mean is χ²(N D) when
    the covariances are right; the band holds `probability` of that (Bar-Shalom et al.
    2001, section 5.4.2).
    """

    mean: float
    lowest: float
    highest: float

    @property
    def is_honest(self) -> bool:
        """Whether the mean lies inside the band."""
        return self.lowest <= self.mean <= self.highest


def consistency(errors: FloatArray, covariances: FloatArray, probability: float = 0.95) -> Consistency:
    """Test errors (N, D) against their claimed covariances (N, D, D).

    The errors must be of independent runs: poses of one drive share their drift, and the
    band would be far too narrow for them.

    `errors` (N, D): errors of N independent runs. `covariances` (N, D, D): their claimed covariances.

    >>> rng = np.random.default_rng(1)
    >>> errors = rng.normal(0.0, 2.0, (200, 3))
    >>> consistency(errors, np.tile(4.0 * np.eye(3), (200, 1, 1))).is_honest
    True
    >>> consistency(errors, np.tile(1.0 * np.eye(3), (200, 1, 1))).is_honest
    False
    """
    n, dimensions = errors.shape
    squared = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])
    tail = 0.5 * (1.0 - probability)
    # Quantiles of χ² with this many degrees of freedom.
    lowest, highest = 2.0 * gammaincinv(0.5 * n * dimensions, [tail, 1.0 - tail]) / n
    return Consistency(float(squared.mean()), float(lowest), float(highest))
