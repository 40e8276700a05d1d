"""Information of a lattice: the points of all scans, summed into a stencil to which more can be added."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice import point_sums
from survey.reconstruction.lattice.multigrid.stencil import EAST, NORTH, NORTH_EAST, NORTH_WEST, apply
from survey.reconstruction.lattice.point_sums import Draws
from survey.reconstruction.nodes import NodeWindow


@dataclass(eq=False)
class Information:
    r"""The data's part of the posterior, in information form.

    A point at lattice coordinates (u, v) sees the surface through the four weights h of
    bilinear interpolation, so scans add up, whatever their order:

    .. math::  S = \sum_i h_i h_i^T / \sigma_i^2, \qquad b = \sum_i h_i z_i / \sigma_i^2

    Parameters
    ----------
    stencil : (5, H, W) ndarray
        S as each node's own weight and its couplings east, north, north-east, north-west.
    rhs : (H, W) ndarray
        b, of heights above the local datum.
    draws : (H, W, K) ndarray of float32
        K sums of measurement errors drawn at random; their covariance is S.
    moments : (3, 4) ndarray
        Σ w t tᵀ and Σ w t z with t = (1, u, v): what the best plane is made of.
    n_points : int
        How many points are in it.
    """

    stencil: FloatArray
    rhs: FloatArray
    draws: Draws
    moments: FloatArray
    n_points: int = 0

    @classmethod
    def empty(cls, shape: tuple[int, int], n_draws: int) -> Self:
        """Return the sums over no points."""
        draws = np.zeros((*shape, n_draws), dtype=np.float32)
        return cls(np.zeros((5, *shape)), np.zeros(shape), draws, np.zeros((3, 4)))

    def add(self, points: FloatArray) -> None:
        """Add points (N, 4): lattice coordinates u and v, height above the datum [m] and weight 1/σ² [1/m²]."""
        self.n_points += len(points)
        point_sums.add_points(points, self.stencil, self.rhs, self.draws, self.n_points)
        point_sums.add_moments(points, self.moments)

    def carried(self, new: NodeWindow, old: NodeWindow, z: FloatArray) -> "Information":
        """Return the sums on another window.

        Points between nodes that stay and nodes that are left behind keep their pull on the
        former, with the latter where they stand now (`z`, (H, W) [m]).
        """
        kept = new.within(old)
        leaving = z.copy()
        leaving[kept] = 0.0
        rhs = self.rhs
        if leaving.size > leaving[kept].size:
            pulled = np.empty_like(z)
            apply(self.stencil, (0.0, 0.0, 0.0), np.zeros((0, 0, 0)), leaving, pulled)
            rhs = rhs - pulled
        draws = np.zeros((*new.shape, self.draws.shape[2]), dtype=np.float32)
        draws[old.within(new)] = self.draws[kept]
        stencil, rhs = _without_loose_ends(new.carried(self.stencil, old)), new.carried(rhs, old)
        moments = np.zeros((3, 4))
        point_sums.add_moments_of_sums(stencil, rhs, moments)
        return Information(stencil, rhs, draws, moments, self.n_points)

    def part(self, rows: slice, columns: slice) -> tuple[FloatArray, FloatArray]:
        """Return stencil and right-hand side of a part of the window."""
        return np.ascontiguousarray(self.stencil[:, rows, columns]), self.rhs[rows, columns].copy()

    def plane(self) -> FloatArray:
        """Return the best plane (3,): height [m] at node (0, 0) and rise [m] per step eastwards and northwards.

        Where the points determine no slope, it is level.
        """
        total = self.moments[0, 0]
        if total <= 0:
            return np.zeros(3)
        mean = self.moments[0] / total
        spread = self.moments[1:, 1:3] / total - np.outer(mean[1:3], mean[1:3])
        lean = self.moments[1:, 3] / total - mean[1:3] * mean[3]
        slope = _inverse_of_spread(spread) @ lean
        return np.array([mean[3] - slope @ mean[1:3], *slope])


def _inverse_of_spread(spread: FloatArray) -> FloatArray:
    """Return the pseudo-inverse of a covariance of places; across a line of points it is 0."""
    trace = spread[0, 0] + spread[1, 1]
    determinant = spread[0, 0] * spread[1, 1] - spread[0, 1] ** 2
    # A hundredth of a step across or less determines no slope.
    if trace < 1e-4:
        return np.zeros((2, 2))
    if determinant < 1e-6 * trace**2:
        along: FloatArray = spread / trace**2
        return along
    turned = np.array([[spread[1, 1], -spread[0, 1]], [-spread[0, 1], spread[0, 0]]])
    inverse: FloatArray = turned / determinant
    return inverse


def plane_heights(plane: FloatArray, rows: slice, columns: slice) -> FloatArray:
    """Return the heights [m] of a plane on a part of the nodes."""
    u, v = np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop)
    heights: FloatArray = plane[0] + plane[1] * u + plane[2] * v[:, None]
    return heights


def _without_loose_ends(stencil: FloatArray) -> FloatArray:
    """Cut couplings to nodes beyond the window, in place."""
    stencil[EAST, :, -1] = 0.0
    stencil[NORTH, -1] = 0.0
    stencil[NORTH_EAST, -1], stencil[NORTH_EAST, :, -1] = 0.0, 0.0
    stencil[NORTH_WEST, -1], stencil[NORTH_WEST, :, 0] = 0.0, 0.0
    return stencil
