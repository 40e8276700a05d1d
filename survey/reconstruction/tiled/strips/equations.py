r"""Normal equations of the strips' errors, in which what the cells of a block and of a stretch share is integrated out.

A difference of two strips, or of a strip and a control point, is :math:`d = H x + 1 w + e` with the errors x of its one
or two strips and an error w of variance v that all cells of the same group share. Integrating w out changes the sums

.. math::  A = H^T H,\; c = H^T 1,\; s = 1^T 1,\; b = H^T d,\; t = 1^T d,\; f = d^T d

(each over the variance of e) to :math:`A - c c^T / (s + 1/v)`, and so on. Blocks of cells come first, then the stretches
that consist of them.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.tiled.strips.places import N_TERMS, StripPlaces

STRETCH_M = 256.0
"""Side of the squares within which a strip's wander is one number [m]."""
_LEAST_VARIANCE = 1e-8


class GroupSums(NamedTuple):
    """Sums over groups of differences, each divided by the variance of its errors.

    Parameters
    ----------
    strip : (N, 2) ndarray of int
        Numbers of the two strips; for a control point the strip's, twice.
    is_pair : (N,) ndarray of bool
        Whether the difference is one of two strips.
    matrix : (N, 10, 10) ndarray
        HᵀH, for the errors of both strips.
    column, rhs : (N, 10) ndarray
        Hᵀ1 and Hᵀd.
    weight, total, energy : (N,) ndarray
        1ᵀ1, 1ᵀd and dᵀd.
    log_determinant : (N,) ndarray
        Of the covariance of the group's shared errors, beyond that of independent ones.
    """

    strip: IntArray
    is_pair: npt.NDArray[np.bool_]
    matrix: FloatArray
    column: FloatArray
    rhs: FloatArray
    weight: FloatArray
    total: FloatArray
    energy: FloatArray
    log_determinant: FloatArray

    def without_shared(self, sigma_m: float) -> "GroupSums":
        """Return the sums when every strip has one more error of this standard deviation in every group."""
        variance = sigma_m**2 * np.where(self.is_pair, 2.0, 1.0)
        left = 1.0 / (1.0 + variance * self.weight)
        shrink = variance * left
        return self._replace(
            matrix=self.matrix - shrink[:, None, None] * self.column[:, :, None] * self.column[:, None, :],
            column=self.column * left[:, None],
            rhs=self.rhs - (shrink * self.total)[:, None] * self.column,
            weight=self.weight * left,
            total=self.total * left,
            energy=self.energy - shrink * self.total**2,
            log_determinant=self.log_determinant - np.log(left),
        )

    def joined(self, starts: IntArray) -> "GroupSums":
        """Return the sums over runs of groups that begin at `starts`."""
        if len(starts) == 0:
            return self
        summed = (np.add.reduceat(values, starts, axis=0) for values in self[2:])
        return GroupSums(self.strip[starts], self.is_pair[starts], *summed)


class Differences(NamedTuple):
    """Sums over blocks of cells, by stretches, and where the blocks of each stretch begin."""

    blocks: GroupSums
    starts: IntArray


class Normal(NamedTuple):
    """Normal equations of the strips' errors: matrix, right-hand side, and the parts of the likelihood without them."""

    matrix: FloatArray
    rhs: FloatArray
    energy: float
    log_determinant: float


def differences(places: StripPlaces, rows: npt.NDArray[np.void]) -> Differences:
    """Return the sums over every block of cells, sorted by stretches of two strips.

    Parameters
    ----------
    places : StripPlaces
        Middles and half-lengths.
    rows : (N,) ndarray of OVERLAP
        Blocks of cells, and control points with `second` 0. The parts of a block that lie in several tiles are put together,
        so that the tiles make no difference.
    """
    stretch = [np.floor(rows[axis] / STRETCH_M) for axis in ("x", "y")]
    names = ("first", "second", "block_row", "block_column")
    keys = np.column_stack([rows[names[0]], rows[names[1]], *stretch, *(rows[name] for name in names[2:])])
    order = np.lexsort(keys.T[::-1])
    keys = keys[order]
    blocks = _starts(keys)
    return Differences(_part_sums(places, rows[order]).joined(blocks), _starts(keys[blocks, :4]))


def _starts(keys: FloatArray) -> IntArray:
    """Return where runs of equal rows (N, K) begin."""
    if len(keys) == 0:
        return np.zeros(0, np.int64)
    changes = (np.diff(keys, axis=0) != 0).any(axis=1)
    return np.flatnonzero(np.concatenate([[True], changes]))


def _part_sums(places: StripPlaces, rows: npt.NDArray[np.void]) -> GroupSums:
    """Return the sums of parts of blocks, whose moments are those of h = (1, slope east, slope north)."""
    is_pair = rows["second"] > 0
    first = places.numbers(rows["first"])
    second = np.where(is_pair, places.numbers(rows["second"]), first)
    of_second = np.where(is_pair[:, None, None], -_to_moments(places, second, rows), 0.0)
    to_h = np.concatenate([_to_moments(places, first, rows), of_second], axis=2)
    noise = np.maximum(rows["scatter"], _LEAST_VARIANCE)
    gram, right = _moments(rows)
    gram, right = gram / noise[:, None, None], right / noise[:, None]
    return GroupSums(
        np.column_stack([first, second]),
        is_pair,
        np.einsum("nia,nij,njb->nab", to_h, gram, to_h, optimize=True),
        np.einsum("nia,ni->na", to_h, gram[:, 0]),
        np.einsum("nia,ni->na", to_h, right),
        gram[:, 0, 0],
        right[:, 0],
        rows["dd"] / noise,
        np.zeros(len(rows)),
    )


def _moments(rows: npt.NDArray[np.void]) -> tuple[FloatArray, FloatArray]:
    """Return Σ h hᵀ (N, 3, 3) and Σ h d (N, 3) of the blocks."""
    n, e, v, ee, ev, vv = (rows[name] for name in ("n", "e", "v", "ee", "ev", "vv"))
    gram = np.stack([np.stack([n, e, v], -1), np.stack([e, ee, ev], -1), np.stack([v, ev, vv], -1)], -2)
    return gram, np.stack([rows[name] for name in ("d", "de", "dv")], -1)


def _to_moments(places: StripPlaces, strip: IntArray, rows: npt.NDArray[np.void]) -> FloatArray:
    """Return the matrices (N, 3, 5) from a strip's errors to the coefficients of h."""
    design = places.design(strip, np.column_stack([rows["x"], rows["y"]]), np.zeros((len(rows), 2)))
    matrix = np.zeros((len(rows), 3, N_TERMS))
    matrix[:, 0, :3] = design[:, :3]
    matrix[:, 1, 3] = matrix[:, 2, 4] = -1.0
    return matrix


def normal_equations(
    found: Differences, prior_m: FloatArray, n_strips: int, block_m: float, wander_m: float
) -> Normal:
    """Return the normal equations of the errors of all strips.

    Parameters
    ----------
    found : Differences
        Sums over blocks.
    prior_m : (5,) ndarray
        Standard deviations of a strip's errors before the comparison [m].
    n_strips : int
        Number of strips.
    block_m, wander_m : float
        Standard deviations of the errors that a strip has in every block and in every stretch [m].
    """
    matrix = np.diag(np.tile(prior_m**-2.0, n_strips))
    rhs = np.zeros(N_TERMS * n_strips)
    groups = found.blocks.without_shared(block_m).joined(found.starts).without_shared(wander_m)
    terms = np.arange(N_TERMS)
    at = (groups.strip[:, :, None] * N_TERMS + terms).reshape(-1, 2 * N_TERMS)
    np.add.at(rhs, at, groups.rhs)
    np.add.at(matrix, (at[:, :, None], at[:, None, :]), groups.matrix)
    log_determinant = 2.0 * n_strips * float(np.log(prior_m).sum()) + float(groups.log_determinant.sum())
    return Normal(matrix, rhs, float(groups.energy.sum()), log_determinant)
