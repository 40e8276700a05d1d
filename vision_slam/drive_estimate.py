"""Results of a localization.

`Localization` is the result of `vision_slam.localize` in the CRS of the recording. `DriveEstimate` holds path and
landmarks of any drive: in a CRS, or in the frame of the first image where there are no fixes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from survey import Recording, SurfacePoints, Trajectory
from survey.core import BoolArray, DataObject, FloatArray
from survey.data.ice_motion import IceMotion
from survey.data.path_error import POSE, PathError
from survey.data.sensors.records import GpsFixes
from survey.reconstruction.motion.epoch import in_fixed_frame
from vision_slam.attitude import quaternions, rotations
from vision_slam.config import UNKNOWN_MEMORY_S, LocalizationConfig
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

    @classmethod
    def of_fixes(cls, recording: Recording, config: LocalizationConfig) -> "Localization":
        """Return the fixes of a kinematic survey as path and the ground below the antenna as surface.

        Parameters
        ----------
        recording : Recording
            Fixes, and the height of their antenna.
        config : LocalizationConfig
            Errors of the fixes.

        Returns
        -------
        Localization
            Without a causal path.
        """
        gps, ground = recording.gps, recording.gps.position - [0.0, 0.0, recording.antenna_height_m]
        sigma_m = fix_errors(gps, config)
        heading = np.arctan2(np.gradient(ground[:, 1]), np.gradient(ground[:, 0]))
        attitude = np.column_stack([np.zeros_like(heading), np.zeros_like(heading), heading])
        covariance = sigma_m[:, :, None] ** 2 * np.eye(3)
        shared: dict[str, Any] = {}
        error = None if recording.start_is_surveyed else _receiver_error(gps.time_s, sigma_m, config)
        if error is not None:
            own = covariance * (config.gps_white_sigma_m / config.fix_sigma_m) ** 2
            keyframe = error.keyframe_at(gps.time_s)
            shared = {"own_covariance": own, "keyframe": keyframe, "heading_rad": heading, "body": ground}
        points = SurfacePoints(
            ground,
            covariance=covariance,
            origins=gps.position,
            crs=recording.crs,
            vertical_datum=recording.vertical_datum,
            **shared,
        )
        poses = quaternions(attitude)
        path = Trajectory(gps.time_s, ground, poses, covariance, recording.crs, error=error)
        return cls(path, points, n_fixes=len(ground))


# Attitudes that fixes alone do not show: a rover on slopes [rad].
_UNKNOWN_ATTITUDE_RAD = 0.2
# Share of their memory over which errors of fixes change little.
_KEYFRAME_SHARE = 0.02


def fix_errors(gps: GpsFixes, config: LocalizationConfig) -> FloatArray:
    """Return standard deviations (N, 3) of fixes to the east, to the north and upwards [m]: stated ones, else assumed ones."""
    across = np.full(len(gps), config.fix_sigma_m) if gps.sigma_m is None else gps.sigma_m
    upward = config.gps_vertical_factor * across if gps.sigma_z_m is None else gps.sigma_z_m
    return np.column_stack([across, across, upward])


def _receiver_error(time_s: FloatArray, sigma_m: FloatArray, config: LocalizationConfig) -> PathError:
    """Return the error that fixes (N,) of a receiver of which little is known share, with their standard deviations (N, 3) [m]."""
    is_set = "gps_correlation_time_s" in config.model_fields_set
    memory_s = config.gps_correlation_time_s if is_set else UNKNOWN_MEMORY_S
    return wandering_error(time_s, sigma_m * config.gps_bias_sigma_m / config.fix_sigma_m, memory_s)


def wandering_error(time_s: FloatArray, sigma_m: FloatArray, memory_s: float) -> PathError:
    """Return a Gauss-Markov error of fixes as the error of a path.

    `time_s` (N,): times of the fixes [s]. `sigma_m` (N, 3): standard deviations to the east, to the north and upwards [m];
    a keyframe takes the largest one up to its neighbours. `memory_s`: correlation time [s].

    >>> error = wandering_error(np.array([0.0, 100.0]), np.full((2, 3), 2.0), 100.0)
    >>> error.covariance(error.rows(np.array([0.0, 1.0]), np.tile(np.eye(6)[2], (2, 1)))).round(2).tolist()
    [[4.0, 1.47], [1.47, 4.0]]
    """
    slot = np.floor((time_s - time_s[0]) / (_KEYFRAME_SHARE * memory_s))
    first = np.unique(np.append(np.searchsorted(slot, np.unique(slot)), len(time_s) - 1))
    between = np.maximum.reduceat(sigma_m, first, axis=0)
    between[:-1] = np.maximum(between[:-1], sigma_m[first[1:]])
    largest = np.maximum(between, np.vstack([between[:1], between[:-1]]))
    gap_s = np.diff(time_s[first])
    steps = sparse.diags_array([np.ones(len(first)), -np.exp(-gap_s / memory_s)], offsets=[0, -1])
    weights = sparse.diags_array(np.append(1.0, -1.0 / np.expm1(-2.0 * gap_s / memory_s)))
    unit = steps.T @ weights @ steps
    tilt = sparse.diags_array([0.0, 0.0, 0.0, *[_UNKNOWN_ATTITUDE_RAD**-2.0] * 3])
    information = sparse.kron(sparse.eye_array(len(first)), tilt)
    for axis, sigma in enumerate(largest.T):
        scale = sparse.diags_array(1.0 / sigma)
        chosen = sparse.coo_array(([1.0], ([axis], [axis])), shape=(POSE, POSE))
        information = information + sparse.kron(scale @ unit @ scale, chosen)
    return PathError(time_s[first], information)


@dataclass(frozen=True)
class DriveEstimate:
    """Path and landmarks of one drive.

    With fixes they are in the CRS of the recording; without, in the frame of the first image
    (x forward, y left, z up).

    `time_s` (N,): times of the poses [s]. `position`, `quaternion` (N, 3) and (N, 4): poses of the body; the
    quaternion as x, y, z, w. `landmarks` (M, 3): points of the surface; none where the fixes contradict the
    images too much. `sigma_z_m` (M,): standard deviation of their elevation [m]. `visual_odometry`: odometry
    of the images, where images were processed. `trajectory`, `points`: path and landmarks in the CRS, with
    covariances. `own_covariance` (N, 3, 3): covariances of the positions without a CRS, in units of the path.
    `online`: the causal path: each pose uses only records up to its own time. `notes`: corrections of the
    input and assumptions about it, one sentence each. `n_fixes`, `n_fixes_refused`: fixes within the time of
    the path, and those of them that failed the innovation gate. `ice_motion`: motion of the ice, where it was
    estimated; path and landmarks are then those of its epoch.
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
        """Return the estimate of a recording with fixes."""
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

        `covariance` (N, 3, 3): covariances of the positions relative to the first, in units of the path.
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
