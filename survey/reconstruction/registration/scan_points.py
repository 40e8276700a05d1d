"""Surface points from LiDAR scans and an estimated path."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.scans.returns import SensorScan
from survey.data.scans.scanner import Scanner
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.line_of_sight.ghost_returns import ghosts
from survey.reconstruction.registration.config import ScanPointsConfig
from survey.reconstruction.registration.poses import (
    PathInterpolator,
    covariance_by_pose,
    own_covariance,
)
from survey.reconstruction.registration.registered_scans import RegisteredReturns, registered
from survey.reconstruction.registration.representatives import representatives_of_stretches, thinned


class BeamErrors(NamedTuple):
    """Stated errors of a LiDAR's beams.

    Parameters
    ----------
    range_sigma_m : float
        Standard deviation of a range [m].
    angle_sigma_deg : float
        Standard deviation of a beam's direction, with the divergence of the pulse [deg].
    """

    range_sigma_m: float
    angle_sigma_deg: float = 0.05

    @classmethod
    def of(cls, scanner: Scanner) -> "BeamErrors":
        """Return the errors that a scanner states.

        Parameters
        ----------
        scanner : Scanner
            Scanner of a recording.

        Returns
        -------
        BeamErrors
            Of range and direction.
        """
        return cls(scanner.range_sigma_m, scanner.angle_sigma_deg)


def scan_points(
    scans: Iterable[SensorScan],
    path: Trajectory,
    errors: BeamErrors,
    *,
    config: ScanPointsConfig | None = None,
    vertical_datum: str = "",
) -> SurfacePoints:
    """Register LiDAR scans by an estimated path, and represent the ground that they show by single returns.

    Every return is placed by the pose at its own time. Of each 5 m of the way, the return nearest to the middle of the
    others represents its cell of ground; of these, single ones far from all others are left out, and of each visit that
    of the most returns is taken. Points of a path whose error is known name the keyframes that they were seen from, so
    that a joint map shares the error of the path between them.

    Parameters
    ----------
    scans : iterable of SensorScan
        In the frame of the vehicle whose poses the path holds, such as `LidarScans`; each is used once.
    path : Trajectory
        Estimated path; scans that it does not cover are left out.
    errors : BeamErrors
        Stated errors of the scanner.
    config : ScanPointsConfig, optional
        Cells, nearest and farthest return, number of points.
    vertical_datum : str
        What the elevations of the path count from.

    Returns
    -------
    SurfacePoints
        With origins, ranges and covariances [m²], in the order of time.

    Raises
    ------
    InputError
        No return of the time of the path between the nearest and the farthest range.

    Notes
    -----
    An error of the scanner's mounting acts as a constant tilt of the path and is not modelled by itself. Of ground that
    is seen at grazing angles, crests are represented and the troughs behind them are not.
    """
    config = config or ScanPointsConfig()
    poses = PathInterpolator(path)
    parts = list(representatives_of_stretches(registered(scans, poses, config), config))
    if not sum(len(part.time_s) for part in parts):
        raise InputError(
            f"no scan has returns between {config.nearest_m:g} and {config.farthest_m:g} m in the time of the path, "
            f"{path.time_s[0]:.1f} to {path.time_s[-1]:.1f} s; give the scans and the trajectory of the same drive."
        )
    found = RegisteredReturns.joined(parts)
    returns = thinned(found.select(~ghosts(found.xyz)), config)
    return _as_points(returns, path, poses, errors, vertical_datum)


def _as_points(
    returns: RegisteredReturns,
    path: Trajectory,
    poses: PathInterpolator,
    errors: BeamErrors,
    vertical_datum: str,
) -> SurfacePoints:
    """Return the returns with their covariances, and the keyframes where the error of the path is known."""
    at, ray = poses.at(returns.time_s), returns.xyz - returns.origin
    angle_rad = np.hypot(np.radians(errors.angle_sigma_deg), at.turn_sigma_rad)
    own = own_covariance(ray, errors.range_sigma_m, angle_rad)
    keyframe = None if path.error is None else path.error.keyframe_at(returns.time_s)
    if path.error is None or keyframe is None:
        shared = _interpolated(path, returns.time_s)
    else:
        arm = returns.xyz - at.position
        shared = covariance_by_pose(arm, at.rotation, path.error.pose_covariance(keyframe))
    return SurfacePoints(
        returns.xyz,
        covariance=own + shared,
        origins=returns.origin,
        body=at.position,
        range_m=returns.range_m,
        crs=path.crs,
        vertical_datum=vertical_datum,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.arctan2(at.rotation[:, 1, 0], at.rotation[:, 0, 0]),
    )


def _interpolated(path: Trajectory, time_s: FloatArray) -> FloatArray:
    """Return the covariance of the path's position (N, 3, 3) at times [m²], of a path without shared error."""
    flat = path.covariance.reshape(-1, 9).T
    values: FloatArray = np.column_stack([np.interp(time_s, path.time_s, column) for column in flat])
    return values.reshape(-1, 3, 3)
