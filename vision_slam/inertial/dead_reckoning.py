"""Dead reckoning: integration of odometry steps to a path."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.sensors.odometry import Odometry
from vision_slam.rotation import rotations


def dead_reckoning(odometry: Odometry, start: FloatArray) -> FloatArray:
    """Integrate the steps of an odometry from a start.

    Parameters
    ----------
    odometry : Odometry
        Steps in the body frame [m] and attitudes in the world [rad].
    start : (3,) ndarray
        Position of the first pose [m].

    Returns
    -------
    (N, 3) ndarray
        Positions in the world [m].

    Examples
    --------
    >>> odometry = Odometry(np.arange(3.0), np.tile([1.0, 0.0, 0.0], (2, 1)), np.tile([0.0, 0.0, 0.5 * np.pi], (3, 1)))
    >>> dead_reckoning(odometry, np.array([5.0, 0.0, 0.0])).round(6).tolist()
    [[5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [5.0, 2.0, 0.0]]
    """
    steps = np.einsum("nij,nj->ni", rotations(odometry.attitude_rad[:-1]), odometry.step)
    return np.vstack([start, start + np.cumsum(steps, axis=0)])
