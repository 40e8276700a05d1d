"""Results of a localization, and their comparison with a reference path.

`Localization` is the result of `vision_slam.localize` in the CRS of the recording. `DriveEstimate` holds path and
landmarks of any drive: in a CRS, or in the frame of the first image where there are no fixes. `Comparison` holds the
poses of an estimate and of a reference at the same times, and gives their errors by name.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from survey.core.arrays import BoolArray, DataObject, FloatArray
from survey.core.crs import same_crs
from survey.core.errors import InputError
from survey.data.ice_motion import IceMotion
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.motion.epoch import in_fixed_frame
from vision_slam.attitude import quaternions, rotations
from vision_slam.evaluation import absolute_errors_m, match_times, relative_errors
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry


@dataclass(frozen=True, eq=False, repr=False)
class Localization(DataObject):
    """Path and landmarks estimated from a recording.

    Parameters
    ----------
    trajectory : Trajectory
        Smoothed poses with covariances of position [m²], in the CRS of the recording. Its
        health is 0 where neither images nor wheels support the pose, and where fixes contradict
        it to the end of the drive.
    points : SurfacePoints
        Landmarks with 3 × 3 covariances [m²]. Neighbouring landmarks share the error of the
        path: taken as independent points they are overconfident.
    online_trajectory : Trajectory, optional
        The causal estimate: each pose uses only records up to its own time. None for a
        kinematic GPS survey.
    visual_odometry : VisualOdometry, optional
        Odometry of the images, aligned with the fixes; None where no image was processed.
    n_fixes : int
        Number of fixes within the time of the path.
    n_fixes_refused : int
        Number of these that failed the innovation gate and were not used.
    ice_motion : IceMotion, optional
        Motion of the ice after all sensors, where the recording was reduced to an epoch; path and landmarks are then those
        of the epoch.
    landmarks_hold : bool
        False where the fixes contradict the images so much that the path is that of the fixes: `points` are then not to be
        mapped.
    notes : tuple of str
        One sentence for each correction of the input or assumption about it.
    """

    trajectory: Trajectory
    points: SurfacePoints
    online_trajectory: Trajectory | None = None
    visual_odometry: VisualOdometry | None = None
    n_fixes: int = 0
    n_fixes_refused: int = 0
    notes: tuple[str, ...] = ()
    ice_motion: IceMotion | None = None
    landmarks_hold: bool = True


@dataclass(frozen=True)
class DriveEstimate:
    """Path and landmarks of one drive.

    With fixes they are in the CRS of the recording; without, in the frame of the first image
    (x forward, y left, z up).

    Parameters
    ----------
    time_s : (N,) ndarray
        Times of the poses [s].
    position, quaternion : (N, 3) and (N, 4) ndarray
        Poses of the body; the quaternion as x, y, z, w.
    landmarks : (M, 3) ndarray
        Points of the surface; none where the fixes contradict the images too much.
    sigma_z_m : (M,) ndarray
        Standard deviation of their elevation [m].
    visual_odometry : VisualOdometry, optional
        Odometry of the images, where images were processed.
    trajectory, points : optional
        Path and landmarks in the CRS, with covariances.
    own_covariance : (N, 3, 3) ndarray, optional
        Covariances of the positions without a CRS, in units of the path.
    online : Trajectory, optional
        The causal path: each pose uses only records up to its own time.
    notes : tuple of str
        Corrections of the input and assumptions about it, one sentence each.
    n_fixes, n_fixes_refused : int
        Fixes within the time of the path, and those of them that failed the innovation gate.
    ice_motion : IceMotion, optional
        Motion of the ice, where it was estimated; path and landmarks are then those of its epoch.
    """

    time_s: FloatArray
    position: FloatArray
    quaternion: FloatArray
    landmarks: FloatArray
    sigma_z_m: FloatArray
    visual_odometry: VisualOdometry | None = None
    trajectory: Trajectory | None = None
    own_covariance: FloatArray | None = None
    points: SurfacePoints | None = None
    online: Trajectory | None = None
    notes: tuple[str, ...] = ()
    n_fixes: int = 0
    n_fixes_refused: int = 0
    ice_motion: IceMotion | None = None

    @classmethod
    def in_crs(cls, result: Localization) -> "DriveEstimate":
        """Return the estimate of a recording with fixes.

        Parameters
        ----------
        result : Localization
            Result of `vision_slam.localize`.

        Returns
        -------
        DriveEstimate
            In the CRS of the recording; without landmarks where these do not hold.
        """
        path, points = result.trajectory, result.points if result.landmarks_hold else None
        return cls(
            path.time_s,
            path.position,
            path.quaternion,
            np.zeros((0, 3)) if points is None else points.xyz,
            np.zeros(0) if points is None else points.sigma_z,
            result.visual_odometry,
            path,
            None,
            points,
            result.online_trajectory,
            result.notes,
            result.n_fixes,
            result.n_fixes_refused,
            result.ice_motion,
        )

    @classmethod
    def in_first_frame(cls, visual: VisualOdometry, covariance: FloatArray | None = None) -> "DriveEstimate":
        """Return the estimate of images without fixes.

        Parameters
        ----------
        visual : VisualOdometry
            Odometry and sightings of the images.
        covariance : (N, 3, 3) ndarray, optional
            Covariances of the positions relative to the first, in units of the path.

        Returns
        -------
        DriveEstimate
            In the frame of the first image.
        """
        odometry, sightings = visual.odometry, visual.sightings
        path = dead_reckoning(odometry, np.zeros(3))
        turn = rotations(odometry.attitude_rad[sightings.pose])
        landmarks = path[sightings.pose] + np.einsum("nij,nj->ni", turn, sightings.offset)
        spread = turn @ sightings.covariance @ turn.transpose(0, 2, 1)
        return cls(
            odometry.time_s,
            path,
            quaternions(odometry.attitude_rad),
            landmarks,
            np.sqrt(spread[:, 2, 2]),
            visual,
            notes=visual.notes,
            own_covariance=covariance,
        )

    @property
    def fixed_trajectory(self) -> Trajectory | None:
        """Path in fixed coordinates, each pose at its own time; None without a CRS."""
        if self.trajectory is None or self.ice_motion is None:
            return self.trajectory
        return in_fixed_frame(self.trajectory, self.ice_motion)

    @property
    def T_body_tracked(self) -> FloatArray:
        """Pose (4, 4) on the body of the point that the path is of: the camera, where lengths have no scale [m]."""
        pose, visual = np.eye(4), self.visual_odometry
        if visual is not None and visual.lever_arm_m is not None:
            pose[:3, 3] = visual.lever_arm_m
        return pose

    @property
    def length_m(self) -> float:
        """Distance travelled [m], without the steps to poses that are lost."""
        steps_m = np.linalg.norm(np.diff(self.position, axis=0), axis=1)
        return float(steps_m.sum() if self.is_lost is None else steps_m[~self.is_lost[1:]].sum())

    @property
    def covariance(self) -> FloatArray | None:
        """Covariances of the positions (N, 3, 3) [m²]; without a CRS relative to the first, in units of the path."""
        return self.own_covariance if self.trajectory is None else self.trajectory.covariance

    @property
    def is_lost(self) -> BoolArray | None:
        """Whether each pose is unreliable (N,); None where no image was processed and no CRS is known."""
        if self.trajectory is not None:
            return np.asarray(self.trajectory.health) < 0.5
        return None if self.visual_odometry is None else self.visual_odometry.is_lost


_STRETCH_SHARE = 0.1  # of the path, over which relative errors are taken


@dataclass(frozen=True)
class Comparison:
    """Poses of an estimate and of its reference at the same times.

    Parameters
    ----------
    position, reference : (K, 3) ndarray
        Positions of both [m].
    covariance : (K, 3, 3) ndarray, optional
        Claimed covariances of `position` [m²].
    is_lost : (K,) ndarray of bool, optional
        Whether each pose is unreliable.
    attitude, reference_attitude : (K, 3, 3) ndarray, optional
        Rotations of both, body to world; None where the reference has positions only.
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
    attitudes: tuple[FloatArray | None, FloatArray | None] = (None, None)
    if np.ptp(reference.quaternion, axis=0).any():  # fixes as a reference have no attitude
        turns = Slerp(reference.time_s, Rotation.from_quat(reference.quaternion))(time_s)
        attitudes = Rotation.from_quat(estimate.quaternion[common]).as_matrix(), turns.as_matrix()
    return Comparison(estimate.position[common], real, estimate.covariance[common], is_lost, *attitudes)


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
        Rotation.from_quat(estimate.quaternion[estimated]).as_matrix(),
        first[:3, :3].T @ reference[real, :3, :3],
    )


def compare_aligned(estimate: DriveEstimate, time_s: FloatArray, reference: FloatArray) -> Comparison:
    """Compare a path in a CRS with reference poses (R, 4, 4) of their own frame, moved onto it by heading and shift.

    Raises
    ------
    InputError
        Fewer than two poses have a reference within 0.01 s.
    """
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
