"""Simulated drive with a scanner whose rover changes its route around the hazards that it sees.

The rover follows its path by an estimated pose. The error of the place is a slow one, and a random walk of the odometry; attitude and
steering err too. Scans are made at the real pose and placed by the estimated one. The scores are of the real path: how often the
rover reached lethal ground.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from planners.look_ahead import LookAhead, LookAheadSettings, Returns
from sim.config.sensors import LidarConfig
from sim.instruments.lidar import TurningScanner
from sim.vehicle.motion import poses_at_rest
from survey import Dem, Route, SurveyArea, Trajectory
from survey.core import BoolArray, FloatArray
from survey.core.streams import stream
from survey.reconstruction.seen_ground import RiseLimit, steep_terrain

_ASSUMED_TILT_RAD = np.radians(0.15)
"""Error of the attitude that the rover assumes, whatever it is."""


@dataclass(frozen=True)
class PoseErrors:
    """Errors of the pose that a rover steers and places its scans by; standard deviations.

    `slow_m`: slow and smooth error of each coordinate [m], correlated over `correlation_m` of travel [m]. `walk_m`: random walk of each
    coordinate [m per √m]. `tilt_deg`, `yaw_deg`: errors of each scan's attitude [deg]. `steering_m`: distance from the path [m].
    """

    slow_m: float = 0.5
    correlation_m: float = 100.0
    walk_m: float = 0.005
    tilt_deg: float = 0.15
    yaw_deg: float = 0.2
    steering_m: float = 0.1


class HazardDrive(NamedTuple):
    """Scores of a drive.

    `xy` (N, 2): real path [m]. `n_entries`: how often it reached lethal ground. `n_stops`, `n_detours`, `skipped_m`: as in `LookAhead`.
    `planned_m`: length of the planned route [m]. `driven_m`: length of the driven one [m].
    """

    xy: FloatArray
    n_entries: int
    n_stops: int
    n_detours: int
    skipped_m: float
    planned_m: float
    driven_m: float


class LethalGround:
    """Ground of the real terrain that is steeper than the rover's limit."""

    def __init__(self, terrain: Dem, limit: RiseLimit) -> None:
        self._mask = steep_terrain(terrain.elevation, terrain.step_m, limit)
        self._terrain = terrain

    @property
    def share(self) -> float:
        """Share of the terrain that is lethal."""
        return float(self._mask.mean())

    def is_at(self, xy: FloatArray) -> BoolArray:
        """Return whether places (N, 2) [m] are on lethal ground; none beyond the terrain is."""
        column, row = np.floor(np.array(~self._terrain.transform @ xy.T)).astype(int)
        rows, columns = self._mask.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        found = np.zeros(len(xy), dtype=bool)
        found[inside] = self._mask[row[inside], column[inside]]
        return found

    def entries(self, xy: FloatArray) -> int:
        """Return how often a path (N, 2) [m] goes onto lethal ground."""
        lethal = self.is_at(xy)
        return int((lethal[1:] & ~lethal[:-1]).sum() + lethal[0])


def drive_with_look_ahead(
    terrain: Dem,
    route: Route,
    area: SurveyArea,
    lidar: LidarConfig,
    *,
    stated: LidarConfig,
    settings: LookAheadSettings,
    errors: PoseErrors,
    seed: int,
    scan_step_m: float = 0.5,
) -> HazardDrive:
    """Drive a route over real terrain, scanning every so many metres, and change it around what the scans show.

    `terrain`: real terrain, at 0.25 m or finer. `route`: planned route of one rover. `stated`: errors of the scanner that the rover assumes.
    """
    rover = LookAhead(route, area, settings)
    path = rover.path
    rng = stream(seed, "look ahead", "errors")
    scans = _EstimatedScans(TurningScanner(terrain, lidar, seed), stated, errors, rng)
    planned_m = route.length_m
    # A receiver's error that is smoothed by odometry: it follows a first-order process, over the same length.
    receiver, walk, aside = np.sqrt(2.0) * errors.slow_m * rng.standard_normal(3), np.zeros(3), 0.0
    slow = receiver.copy()
    offset = slow.copy()  # the start is where the estimate says: the slow error counts from there
    driven = [path[:1]]
    heading = float(np.arctan2(*(path[1] - path[0])[::-1]))
    at, travelled_m = path[0], 0.0
    while not rover.is_done and travelled_m < 4.0 * planned_m:
        error = slow - offset + walk
        real_xy = at - error[:2] + aside * np.array([-np.sin(heading), np.cos(heading)])
        pose, _ = poses_at_rest(terrain, np.tile(real_xy, (2, 1)), np.full(2, heading), np.arange(2.0))
        if rover.update(scans.at(pose, error), at):
            continue  # it stands, and scans again
        if rover.is_done:
            break
        samples = rover.advance(scan_step_m)
        moved = samples - error[:2] + aside * np.array([-np.sin(heading), np.cos(heading)])
        driven.append(moved[1:])
        step_m = float(np.hypot(*np.diff(samples, axis=0).T).sum())
        travelled_m += step_m
        heading = float(np.arctan2(*(samples[-1] - samples[-2])[::-1]))
        at = samples[-1]
        kept = float(np.exp(-step_m / errors.correlation_m))
        spread = np.sqrt(2.0 * (1.0 - kept**2)) * errors.slow_m
        receiver = kept * receiver + spread * rng.standard_normal(3)
        slow = kept * slow + (1.0 - kept) * receiver
        walk = walk + errors.walk_m * np.sqrt(step_m) * rng.standard_normal(3)
        aside = 0.8 * aside + 0.6 * errors.steering_m * float(rng.standard_normal())
    xy = np.vstack(driven)
    entries = LethalGround(terrain, settings.limit).entries(xy)
    return HazardDrive(xy, entries, rover.n_stops, rover.n_detours, rover.skipped_m, planned_m, travelled_m)


@dataclass(frozen=True)
class _EstimatedScans:
    """Scans at the real pose, placed by the estimated one; σ is that of the stated errors."""

    scanner: TurningScanner
    stated: LidarConfig
    errors: PoseErrors
    rng: np.random.Generator

    def at(self, pose: Trajectory, error: FloatArray) -> Returns:
        """Return the scan at the first pose of a path, whose place errs by (3,) [m]."""
        body = self.scanner.turn(pose)
        scale = np.radians([self.errors.tilt_deg, self.errors.tilt_deg, self.errors.yaw_deg])
        wrong = Rotation.from_rotvec(scale * self.rng.standard_normal(3))
        turn = wrong * Rotation.from_quat(pose.quaternion[0])
        place = pose.position[0] + error
        xyz = place + turn.apply(body)
        origin = place + turn.apply([0.0, 0.0, self.stated.height_m])
        distance = np.linalg.norm(body, axis=1)
        of_range = self.stated.range_sigma_m * self.stated.height_m / np.maximum(distance, 1.0)
        return Returns(
            xyz, np.broadcast_to(origin, xyz.shape), np.hypot(of_range, _ASSUMED_TILT_RAD * distance)
        )
