"""Paths and corrections on moving ice in fixed coordinates."""

from dataclasses import replace

from survey.data.ice.motion import IceMotion
from survey.data.trajectory import Trajectory


def in_fixed_frame(trajectory: Trajectory, motion: IceMotion) -> Trajectory:
    """Return a path that was estimated at an epoch in fixed coordinates: each pose where it was at its own time.

    Parameters
    ----------
    trajectory : Trajectory
        Path on the ice of the epoch.
    motion : IceMotion
        Motion of the ice.

    Returns
    -------
    Trajectory
        Without the error that poses share. The covariance is that on the ice, which that of fixed coordinates does not
        exceed where fixes hold the path.
    """
    moved = motion.displacement(trajectory.position[:, :2], trajectory.time_s)
    return replace(trajectory, position=trajectory.position + moved, error=None)
