"""Motion of a rover that follows its route exactly and rests on the ground."""

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.route import Route
from survey.data.trajectory import Trajectory

_HALF_LENGTH_M = 0.5


def exact_drive(
    terrain: Dem, route: Route, speed_m_s: float, interval_s: float = 1.0
) -> tuple[Trajectory, FloatArray]:
    """Return the real poses of a rover that follows a route exactly, and their attitudes.

    Parameters
    ----------
    terrain : Dem
        The real terrain.
    route : Route
        The route of one rover.
    speed_m_s : float
        Speed along the route [m/s].
    interval_s : float
        Time between poses [s].

    Returns
    -------
    trajectory : Trajectory
        Real poses.
    attitude_rad : (N, 3) ndarray
        Roll, pitch and yaw [rad].

    Raises
    ------
    InputError
        The route leaves the known terrain.
    """
    samples = route.sample(speed_m_s * interval_s)
    time_s = samples.distance_m / speed_m_s
    return poses_at_rest(terrain, samples.xy, samples.heading_rad, time_s)


def poses_at_rest(
    terrain: Dem, xy: FloatArray, heading_rad: FloatArray, time_s: FloatArray
) -> tuple[Trajectory, FloatArray]:
    """Return the poses of a rover at rest on the terrain, and their attitudes.

    Parameters
    ----------
    terrain : Dem
        The real terrain.
    xy : (N, 2) ndarray
        Places [m].
    heading_rad : (N,) ndarray
        Headings [rad].
    time_s : (N,) ndarray
        Times, increasing [s].

    Returns
    -------
    trajectory : Trajectory
        Poses.
    attitude_rad : (N, 3) ndarray
        Roll, pitch and yaw [rad].

    Raises
    ------
    InputError
        A place off the known terrain.
    """
    height = terrain.at(xy)
    if np.isnan(height).any():
        east, north = xy[np.flatnonzero(np.isnan(height))[0]]
        raise InputError(
            f"the route leaves the known terrain at ({east:.1f}, {north:.1f}); cut the area to the terrain "
            "(area.clip_to_terrain) or take a larger raster."
        )
    attitude = _resting_attitude(terrain, xy, heading_rad)
    position = np.column_stack([xy, height])
    zero = np.zeros((len(position), 3, 3))
    turns = Rotation.from_euler("xyz", attitude).as_quat(canonical=True)
    return Trajectory(time_s, position, turns, zero, terrain.crs), attitude


def _resting_attitude(terrain: Dem, xy: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (N, 3) of a rover of about a metre at rest on the ground [rad]."""
    ahead = _HALF_LENGTH_M * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    left = _HALF_LENGTH_M * np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
    pitch = -np.arctan(_rise(terrain, xy, ahead))
    roll = np.arctan(_rise(terrain, xy, left))
    return np.column_stack([roll, pitch, heading_rad])


def _rise(terrain: Dem, xy: FloatArray, half: FloatArray) -> FloatArray:
    """Return the slope of the ground from xy − half to xy + half; level where the terrain is not known."""
    rise = (terrain.at(xy + half) - terrain.at(xy - half)) / (2.0 * np.hypot(half[:, 0], half[:, 1]))
    return np.where(np.isfinite(rise), rise, 0.0)
