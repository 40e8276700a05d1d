"""Correction of a path by the joint estimate of map and path."""

from dataclasses import dataclass, replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.data_object import DataObject
from survey.data.trajectory import Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class PathCorrection(DataObject):
    """Errors (K, 3) [m] of a path at times (K,) [s], and the covariance (K, 3, 3) [m²] of the estimate.

    Parameters
    ----------
    time_s : (K,) ndarray
        Times of the keyframes [s].
    shift : (K, 3) ndarray
        Estimated error of the position: east, north, up [m].
    covariance : (K, 3, 3) ndarray
        Posterior covariance of that error [m²].

    Examples
    --------
    >>> PathCorrection(np.array([0.0, 9.0]), np.zeros((2, 3)), np.zeros((2, 3, 3))).shift.shape
    (2, 3)
    """

    time_s: FloatArray
    shift: FloatArray
    covariance: FloatArray

    def mixed(self, other: "PathCorrection", share: float) -> "PathCorrection":
        """Return mean and covariance of the mixture with another correction.

        Parameters
        ----------
        other : PathCorrection
            Correction at the same times.
        share : float
            Probability of the other correction.

        Returns
        -------
        PathCorrection
            Mean of both, with the covariance that their difference adds.
        """
        apart = other.shift - self.shift
        spread = share * (1.0 - share) * apart[:, :, None] * apart[:, None, :]
        covariance = (1.0 - share) * self.covariance + share * other.covariance + spread
        return PathCorrection(self.time_s, self.shift + share * apart, covariance)

    def applied(self, trajectory: Trajectory) -> Trajectory:
        """Return the trajectory with corrected positions and without its shared error, which the map has used.

        Parameters
        ----------
        trajectory : Trajectory
            The path that was mapped with.

        Returns
        -------
        Trajectory
            Positions less the errors, with their posterior covariance.
        """
        times = trajectory.time_s
        shift = np.column_stack([np.interp(times, self.time_s, column) for column in self.shift.T])
        entries = [np.interp(times, self.time_s, entry) for entry in self.covariance.reshape(-1, 9).T]
        covariance = np.column_stack(entries).reshape(-1, 3, 3)
        return replace(trajectory, position=trajectory.position - shift, covariance=covariance, error=None)
