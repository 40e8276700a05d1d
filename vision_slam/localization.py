"""Result of localizing a recording."""

from dataclasses import dataclass

from survey.core.data_object import DataObject
from survey.data.ice.motion import IceMotion
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
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
