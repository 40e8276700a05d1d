"""Paths and routes on moving ice, in fixed coordinates and in those of the ice at an epoch."""

from dataclasses import replace

import numpy as np

from survey.data.ice.motion import IceMotion
from survey.data.route import Route
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


def route_on_ice(route: Route, motion: IceMotion, speed_m_s: float) -> Route:
    """Return a route of fixed coordinates as the line that it draws on the ice of an epoch.

    Parameters
    ----------
    route : Route
        Route of one rover, driven at a constant speed from the time 0 on.
    motion : IceMotion
        Motion that is expected of the ice.
    speed_m_s : float
        Speed [m/s].

    Returns
    -------
    Route
        The same legs; each waypoint where its ice is at the epoch.

    Examples
    --------
    >>> from survey.data.legs import Leg
    >>> from survey.reconstruction.motion.priors import uniform_motion
    >>> flow = uniform_motion((0.0, 8.64), 0.0, velocity_sigma=1.0, lowering_sigma=0.0, epoch_s=0.0)
    >>> route = Route((Leg("swath", [[0.0, 0.0], [100.0, 0.0]]),), "EPSG:32608", "line")
    >>> np.round(route_on_ice(route, flow, 0.01).legs[0].xy, 6).tolist()
    [[0.0, 0.0], [100.0, -1.0]]
    """
    legs, begun_m = [], 0.0
    for leg in route.legs:
        steps = np.hypot(*np.diff(leg.xy, axis=0).T)
        time_s = (begun_m + np.r_[0.0, np.cumsum(steps)]) / speed_m_s
        xyz = np.column_stack([leg.xy, np.zeros(len(leg.xy))])
        xy = motion.at_epoch(xyz, time_s)[:, :2]
        legs.append(replace(leg, xy=xy, axis=xy[[0, -1]]))
        begun_m += leg.length_m
    return replace(route, legs=tuple(legs))
