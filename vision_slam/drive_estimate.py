"""Estimated path and landmarks of a drive, in a CRS or in the frame of the first image."""

from dataclasses import dataclass

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.ice.motion import IceMotion
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.motion.epoch import in_fixed_frame
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.localization import Localization
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.rotation import quaternions, rotations


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
