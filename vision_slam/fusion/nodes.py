"""Nodes of the smoother along a dead-reckoned path, and sums and means of records at them."""

from dataclasses import dataclass

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.data.sensors.odometry import Odometry
from vision_slam.fusion.normal_equations import PITCH, ROLL, SCALE, YAW
from vision_slam.rotation import rotations

# Readings this long before the first pose or after the last count as taken at it: rovers stand there.
_BESIDE_S = 1.0
_HALF_S = 0.25
_LEAST_TRAVEL_M = 1e-3


@dataclass(frozen=True)
class Nodes:
    """The nodes among the poses of the odometry, its dead_reckoned path, and a guess (K, PER_NODE) of their unknowns.

    How steps answer to attitude and scale is taken about that guess, and how fixes answer to their
    delay about ``delay_s``.
    """

    odometry: Odometry
    dead_reckoned: FloatArray
    index: IntArray
    guess: FloatArray
    delay_s: float = 0.0

    @property
    def time_s(self) -> FloatArray:
        """Times of the nodes [s]."""
        return self.odometry.time_s[self.index]

    @property
    def travel(self) -> FloatArray:
        """Travel from node to node (K - 1,) [m], at least a millimetre: errors that cannot change swamp all others."""
        travel = self.summed(np.linalg.norm(np.diff(self.dead_reckoned, axis=0), axis=1))
        return np.maximum(travel, _LEAST_TRAVEL_M)

    @property
    def rolled(self) -> FloatArray:
        """Travel as wheels count it (K - 1,), back again where the rover reverses [m]."""
        return self.summed(signed_travel(self.odometry))

    @property
    def turned_rad(self) -> FloatArray:
        """Sum of the turns of heading, to either side, from node to node."""
        return self.summed(np.abs(np.diff(np.unwrap(self.odometry.attitude_rad[:, 2]))))

    @property
    def guessed(self) -> tuple[FloatArray, FloatArray]:
        """The steps (N - 1, 3) and headings (N - 1,) of the odometry, less the guess of its errors."""
        poses_s = self.odometry.time_s[:-1]
        wrong = {k: np.interp(poses_s, self.time_s, self.guess[:, k]) for k in (YAW, PITCH, ROLL, SCALE)}
        off = np.column_stack([wrong[ROLL], wrong[PITCH], wrong[YAW]])
        attitude = self.odometry.attitude_rad[:-1] - off
        steps = np.einsum("nij,nj->ni", rotations(attitude), self.odometry.step)
        return steps * (1.0 - wrong[SCALE])[:, None], attitude[:, 2]

    def velocity(self, time_s: FloatArray) -> FloatArray:
        """Return the velocity (N, 3) [m/s] at some times, about the guess, averaged over half a second."""
        steps, _ = self.guessed
        path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        poses_s = self.odometry.time_s
        ends = [np.clip(time_s + half_s, *poses_s[[0, -1]]) for half_s in (-_HALF_S, _HALF_S)]
        before, after = (
            np.column_stack([np.interp(end_s, poses_s, axis) for axis in path.T]) for end_s in ends
        )
        velocity: FloatArray = (after - before) / np.maximum(ends[1] - ends[0], _HALF_S)[:, None]
        return velocity

    def summed(self, values: FloatArray) -> FloatArray:
        """Sum what belongs to steps (N - 1, …) from node to node."""
        total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
        sums: FloatArray = np.diff(total[self.index], axis=0)
        return sums

    def beyond_usual(self, errors: FloatArray | None) -> FloatArray:
        """Return the errors of steps beyond the usual ones (N - 1,), summed from node to node (K - 1,)."""
        if errors is None:
            return np.zeros(len(self.index) - 1)
        return np.sqrt(self.summed(errors**2))

    def averaged(self, time_s: FloatArray, values: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Average readings (N, D) at their nearest nodes: node index, mean (K, D), count (K,).

        What was read before the first pose or after the last says nothing of the path.
        """
        first_s, last_s = self.odometry.time_s[[0, -1]]
        inside = (time_s >= first_s - _BESIDE_S) & (time_s <= last_s + _BESIDE_S)
        time_s, values = time_s[inside], values[inside]
        edges = 0.5 * (self.time_s[1:] + self.time_s[:-1])
        nearest = np.searchsorted(edges, time_s)
        node, inverse, count = np.unique(nearest, return_inverse=True, return_counts=True)
        total = np.zeros((len(node), values.shape[1]))
        np.add.at(total, inverse, values)
        return node.astype(np.int64), total / count[:, None], count.astype(np.float64)


def signed_travel(odometry: Odometry) -> FloatArray:
    """Return the lengths of the steps (N - 1,) [m], negative where the rover reverses."""
    travel: FloatArray = np.copysign(np.linalg.norm(odometry.step, axis=1), odometry.step[:, 0])
    return travel
