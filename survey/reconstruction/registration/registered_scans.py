"""Registered returns: places in the world, compensated for the motion during each scan."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.data.scans.returns import SensorScan
from survey.reconstruction.line_of_sight.ghost_returns import ghosts
from survey.reconstruction.registration.config import ScanPointsConfig
from survey.reconstruction.registration.poses import PathInterpolator

_LEAST_KNOWN_RAD = np.radians(0.5)


class RegisteredReturns(NamedTuple):
    """Returns of one or more scans in the world, with the poses that they were seen from.

    Parameters
    ----------
    time_s : (N,) ndarray
        Times [s].
    xyz : (N, 3) ndarray
        Places [m].
    origin : (N, 3) ndarray
        Places of the sensor [m].
    n_returns : (N,) ndarray of int
        Number of returns that each stands for.
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


def registered(
    scans: Iterable[SensorScan], poses: PathInterpolator, config: ScanPointsConfig
) -> Iterator[RegisteredReturns]:
    """Yield each scan that the path covers in the world, without returns that are too near, too far, or alone.

    Returns from sharp turns, in which the attitude between two poses is not known, are left out too.

    Parameters
    ----------
    scans : iterable of SensorScan
        In the frame of the vehicle, each return at its own time.
    poses : PathInterpolator
        Estimated path.
    config : ScanPointsConfig
        Nearest and farthest return.

    Yields
    ------
    RegisteredReturns
        One scan with returns.
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
