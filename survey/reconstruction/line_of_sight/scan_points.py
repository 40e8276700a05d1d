"""Surface points from LiDAR scans and an estimated path.

`PathInterpolator` gives the poses of the path between its own times. Between two poses the position is linear in time, and the
attitude turns at a constant rate. What this leaves out is estimated from the path itself: with A'' the change of turn from
one interval to the next, the error at a share s of an interval is about s (1 - s) / 2 · A'', for the larger change at its
two ends. `covariance_by_pose` is the error that places have by the poses they were seen from.

`place_scans` places the returns of every scan in the world, compensated for the motion during the scan, and rejects
outliers. `representatives_of_stretches` takes one return for each cell of ground and visit, and `select_returns` retains the best of
several visits. `scan_points` runs these steps and returns surface points with the covariance that they share through
the errors of the path.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from survey.core import BoolArray, FloatArray, InputError, IntArray
from survey.data import SurfacePoints, Trajectory
from survey.data.sensors.lidar import Scanner, SensorScan
from survey.reconstruction.line_of_sight.config import ScanPointsConfig
from survey.reconstruction.line_of_sight.returns import LEAST_M, QUARTILES_TO_SIGMA, ghosts


class Poses(NamedTuple):
    """Poses at times (N,): positions (N, 3) [m], rotations R_world_body (N, 3, 3), error of interpolation (N,) [rad]."""

    position: FloatArray
    rotation: FloatArray
    turn_sigma_rad: FloatArray


class PathInterpolator:
    """Interpolator of the poses of an estimated path.

    `path`: at least two poses.
    """

    def __init__(self, path: Trajectory) -> None:
        if len(path) < 2:
            raise InputError("the trajectory has a single pose; scans need two or more around them.")
        self._path = path
        self._turning = Slerp(path.time_s, Rotation.from_quat(path.quaternion))
        self._bend_rad = _bends(path.quaternion)

    def covers(self, time_s: FloatArray) -> bool:
        """Return whether the path covers all of the times (N,) [s]."""
        first, last = self._path.time_s[[0, -1]]
        return bool(time_s.min() >= first and time_s.max() <= last)

    def at(self, time_s: FloatArray) -> Poses:
        """Return the poses at times (N,) [s] that the path covers."""
        path = self._path
        position = np.column_stack([np.interp(time_s, path.time_s, axis) for axis in path.position.T])
        before = np.clip(np.searchsorted(path.time_s, time_s, side="right") - 1, 0, len(path) - 2)
        share = (time_s - path.time_s[before]) / np.diff(path.time_s)[before]
        sigma: FloatArray = 0.5 * share * (1.0 - share) * self._bend_rad[before]
        return Poses(position, self._turning(time_s).as_matrix(), sigma)


def _bends(quaternion: FloatArray) -> FloatArray:
    """Return, for each interval (N - 1,), the larger change of turn at its two ends [rad]."""
    turns = Rotation.from_quat(quaternion)
    steps = (turns[:-1].inv() * turns[1:]).as_rotvec()
    changes = np.r_[0.0, np.linalg.norm(np.diff(steps, axis=0), axis=1), 0.0]
    larger: FloatArray = np.maximum(changes[:-1], changes[1:])
    return larger


def covariance_by_pose(arm: FloatArray, rotation: FloatArray, pose_covariance: FloatArray) -> FloatArray:
    r"""Return the covariance that places have by the errors of the poses they were seen from.

    .. math::  J P J^T, \qquad J = [I, \hat z \times o, \hat l \times o, \hat x \times o]

    with the arm o from the body to the place, the level direction to the left l and the body's forward axis x.

    `arm` (N, 3): from the body's origin to the places, in the world [m]. `rotation` (N, 3, 3): R_world_body.
    `pose_covariance` (N, 6, 6): of easting, northing, elevation [m], yaw, pitch and roll [rad]. Returns (N,
    3, 3): [m²].
    """
    ahead = rotation[:, :, 0]
    level = np.hypot(ahead[:, 0], ahead[:, 1])
    left = np.column_stack([-ahead[:, 1] / level, ahead[:, 0] / level, np.zeros(len(arm))])
    up = np.broadcast_to([0.0, 0.0, 1.0], arm.shape)
    turned = [np.cross(axis, arm) for axis in (up, left, ahead)]
    identity = np.broadcast_to(np.eye(3), (len(arm), 3, 3))
    jacobian = np.concatenate([identity, np.stack(turned, axis=2)], axis=2)
    covariance: FloatArray = jacobian @ pose_covariance @ jacobian.transpose(0, 2, 1)
    return 0.5 * (covariance + covariance.transpose(0, 2, 1))


def own_covariance(ray: FloatArray, range_sigma_m: float, angle_sigma_rad: FloatArray) -> FloatArray:
    """Return the covariance of returns along and across their rays (N, 3) [m], as (N, 3, 3) [m²]."""
    distance = np.linalg.norm(ray, axis=1)
    unit = ray / distance[:, None]
    along = unit[:, :, None] * unit[:, None, :]
    across = (distance * angle_sigma_rad)[:, None, None] ** 2 * (np.eye(3) - along)
    covariance: FloatArray = range_sigma_m**2 * along + across
    return covariance


_LEAST_KNOWN_RAD = np.radians(0.5)


class RegisteredReturns(NamedTuple):
    """Returns of one or more scans in the world, with the poses that they were seen from.

    `time_s` (N,): times [s]. `xyz` (N, 3): places [m]. `origin` (N, 3): places of the sensor [m]. `n_returns`
    (N,) int: number of returns that each stands for.
    """

    time_s: FloatArray
    xyz: FloatArray
    origin: FloatArray
    n_returns: IntArray

    @property
    def range_m(self) -> FloatArray:
        """Distances from the sensor (N,) [m]."""
        distance: FloatArray = np.linalg.norm(self.xyz - self.origin, axis=1)
        return distance

    def select(self, which: BoolArray | IntArray) -> "RegisteredReturns":
        """Return some of the returns, by a mask or by their numbers."""
        return RegisteredReturns(
            self.time_s[which], self.xyz[which], self.origin[which], self.n_returns[which]
        )

    @classmethod
    def joined(cls, parts: list["RegisteredReturns"]) -> "RegisteredReturns":
        """Return the returns of several scans as one set."""
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def place_scans(
    scans: Iterable[SensorScan], poses: PathInterpolator, config: ScanPointsConfig
) -> Iterator[RegisteredReturns]:
    """Yield each scan that the path covers in the world, without returns that are too near, too far, or alone.

    Returns from sharp turns, in which the attitude between two poses is not known, are left out too.
    """
    for scan in scans:
        distance = np.linalg.norm(scan.xyz - scan.sensor, axis=1)
        usable = (distance >= config.nearest_m) & (distance <= config.farthest_m)
        if not usable.any() or not poses.covers(scan.time_s[usable]):
            continue
        placed = _in_world(SensorScan(scan.time_s[usable], scan.xyz[usable], scan.sensor), poses)
        accepted = placed.select(~ghosts(placed.xyz)) if len(placed.time_s) else placed
        if len(accepted.time_s):
            yield accepted


def _in_world(scan: SensorScan, poses: PathInterpolator) -> RegisteredReturns:
    """Place every return by the pose at its own time, unless the attitude there is not known; a direction shares its pose."""
    moments, which = np.unique(scan.time_s, return_inverse=True)
    at = poses.at(moments)
    rotation, foot = at.rotation[which], at.position[which]
    xyz = foot + np.einsum("nij,nj->ni", rotation, scan.xyz)
    one = np.ones(len(xyz), dtype=np.int64)
    placed = RegisteredReturns(scan.time_s, xyz, foot + rotation @ scan.sensor, one)
    return placed.select(at.turn_sigma_rad[which] <= _LEAST_KNOWN_RAD)


_STRETCH_M = 5.0
# Views of one place that are closer to each other on the way share the errors of the path.
_VISIT_M = 40.0
# A vehicle that stands still scans the same ground; the memory of a stretch is bounded by this number of scans.
_MOST_SCANS = 50
_SIGMAS = 4.0


def representatives_of_stretches(
    scans: Iterable[RegisteredReturns], config: ScanPointsConfig
) -> Iterator[RegisteredReturns]:
    """Yield, for each stretch of 5 m of the way or 50 scans, one return for each cell that has enough of them.

    It is the one nearest to the middle of the cell's returns, of those whose height is usual among them. Its height does
    not decide, so that the points have the relief of the ground: returns of median height would have less of it, and a
    map of them would claim too small an error.
    """
    stretch: list[RegisteredReturns] = []
    travelled_m, last = 0.0, None
    for scan in scans:
        place = scan.origin[0]
        travelled_m += 0.0 if last is None else float(np.linalg.norm(place - last))
        last = place
        if stretch and (travelled_m >= _STRETCH_M or len(stretch) == _MOST_SCANS):
            yield _representatives(RegisteredReturns.joined(stretch), config)
            stretch, travelled_m = [], 0.0
        stretch.append(scan)
    if stretch:
        yield _representatives(RegisteredReturns.joined(stretch), config)


def _representatives(returns: RegisteredReturns, config: ScanPointsConfig) -> RegisteredReturns:
    """Return the return of usual height nearest to the middle of the others in each cell."""
    order, first, count = _by_cell(returns.xyz[:, :2], returns.xyz[:, 2], config.cell_m)
    xyz, cell = returns.xyz[order], np.repeat(np.arange(len(first)), count)
    middle = np.column_stack([np.bincount(cell, axis) / count for axis in xyz[:, :2].T])
    away_m = np.hypot(*(xyz[:, :2] - middle[cell]).T)
    nearest = np.lexsort((away_m, ~_usual(xyz[:, 2], first, count), cell))[first]
    enough = count >= config.least_returns
    return returns.select(order[nearest[enough]])._replace(n_returns=count[enough])


def _usual(height: FloatArray, first: IntArray, count: IntArray) -> BoolArray:
    """Return which heights, in order within each cell, lie within 0.3 m or four standard deviations of its median."""
    lower, middle, upper = (height[first + (share * count) // 4] for share in (1, 2, 3))
    allowed = np.maximum(LEAST_M, _SIGMAS * (upper - lower) / QUARTILES_TO_SIGMA)
    usual: BoolArray = np.abs(height - np.repeat(middle, count)) <= np.repeat(allowed, count)
    return usual


def best_of_visits(returns: RegisteredReturns, cell_m: float) -> IntArray:
    """Return the numbers of the return, of those in order of time, that stands for the most others in each cell and visit.

    These are near ones as a rule. Blown snow above ground that the scanner does not see gives few. A visit ends where a
    cell is not seen over 40 m of the way.
    """
    steps = np.r_[0.0, np.linalg.norm(np.diff(returns.origin, axis=0), axis=1)]
    travel = np.cumsum(steps)
    order, first, _ = _by_cell(returns.xyz[:, :2], travel, cell_m)
    begins = np.zeros(len(order), dtype=np.bool_)
    begins[first] = True
    begins[1:] |= np.diff(travel[order]) > _VISIT_M
    visit = np.cumsum(begins)
    best = np.lexsort((returns.range_m[order], -returns.n_returns[order], visit))
    chosen = best[np.r_[True, np.diff(visit[best]) > 0]]
    return np.sort(order[chosen])


def select_returns(returns: RegisteredReturns, config: ScanPointsConfig) -> RegisteredReturns:
    """Return the best returns of all visits, in cells that grow until there are no more than wanted."""
    returns = returns.select(np.argsort(returns.time_s, kind="stable"))
    cell_m = config.cell_m
    while len(chosen := best_of_visits(returns, cell_m)) > config.most_points:
        cell_m *= max(1.05, float(np.sqrt(len(chosen) / config.most_points)))
    return returns.select(chosen)


def _by_cell(xy: FloatArray, then: FloatArray, cell_m: float) -> tuple[IntArray, IntArray, IntArray]:
    """Return the order of points by their cell and by another value, and first place and number of each cell's."""
    cell = np.floor((xy - xy.min(axis=0)) / cell_m).astype(np.int64)
    key = cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    order = np.lexsort((then, key))
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    return order, first, count


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
    parts = list(representatives_of_stretches(place_scans(scans, poses, config), config))
    if not sum(len(part.time_s) for part in parts):
        raise InputError(
            f"no scan has returns between {config.nearest_m:g} and {config.farthest_m:g} m in the time of the path, "
            f"{path.time_s[0]:.1f} to {path.time_s[-1]:.1f} s; give the scans and the trajectory of the same drive."
        )
    found = RegisteredReturns.joined(parts)
    returns = select_returns(found.select(~ghosts(found.xyz)), config)
    return _as_points(returns, path, poses, errors, vertical_datum)


def every_return(
    scans: Iterable[SensorScan],
    path: Trajectory,
    errors: BeamErrors,
    *,
    nearest_m: float = 3.0,
    farthest_m: float = 80.0,
) -> Iterator[SurfacePoints]:
    """Yield the returns of each scan as points, placed by an estimated path; none stands for others, as walls have many in one cell of ground.

    Parameters
    ----------
    scans : iterable of SensorScan
        In the frame of the vehicle whose poses the path holds.
    path : Trajectory
        Estimated path; scans that it does not cover are left out.
    errors : BeamErrors
        Stated errors of the scanner.
    nearest_m, farthest_m : float
        Nearest and farthest return [m].

    Yields
    ------
    SurfacePoints
        Returns of one scan with origins and covariances [m²]; `own_covariance` is without the errors of the path.
    """
    poses = PathInterpolator(path)
    for scan in scans:
        distance = np.linalg.norm(scan.xyz - scan.sensor, axis=1)
        usable = (distance >= nearest_m) & (distance <= farthest_m)
        if not usable.any() or not poses.covers(scan.time_s[usable]):
            continue
        placed = _in_world(SensorScan(scan.time_s[usable], scan.xyz[usable], scan.sensor), poses)
        if len(placed.time_s):
            yield _as_points(placed, path, poses, errors, "")


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
