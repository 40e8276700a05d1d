r"""Strip adjustment: errors that all points of a strip share, by least squares on overlaps and control points.

Strip s measures

.. math::  z_s(x) = z(x) + a_s + t_s \cdot (x - x_s) / R_s - \nabla z(x) \cdot h_s + w + e

with offset a, tilts t (as the error that they make at the strip's end), shift h, the strip's middle x_s and its
half-length R_s. Errors w belong to none of them: each block of cells has one, and each stretch of some hundred metres.
`StripErrors` holds the estimate with its joint covariance, and `StripPairs` the record of overlapping strips.

A difference of two strips, or of a strip and a control point, is :math:`d = H x + 1 w + e` with the errors x of its one
or two strips and an error w of variance v that all cells of the same group share. Integrating w out changes the sums

.. math::  A = H^T H,\; c = H^T 1,\; s = 1^T 1,\; b = H^T d,\; t = 1^T d,\; f = d^T d

(each over the variance of e) to :math:`A - c c^T / (s + 1/v)`, and so on. Blocks of cells come first, then the stretches
that consist of them. `solve_strips` gives each error a normal prior, whose size is found by marginal likelihood like those
of the errors of blocks and stretches.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from survey.core import CapacityError, DataObject, FloatArray, IntArray
from survey.reconstruction.tiled.cells import strip_name

N_TERMS = 5
"""Errors of a strip: offset, tilt eastwards and northwards, shift eastwards and northwards."""
_MOST_STRIPS = 1000


class StripPlaces(NamedTuple):
    """Keys of the strips (S,), their middles (S, 2) [m], and their half-lengths (S,) [m]."""

    keys: npt.NDArray[np.uint32]
    middle: FloatArray
    half_m: FloatArray

    @classmethod
    def of(cls, tables: list[npt.NDArray[np.float64]]) -> "StripPlaces":
        """Return the places by tables of the tiles: key, number of cells, sums of x, y, x², y² [m]."""
        rows = np.concatenate(tables)
        keys, index = np.unique(rows[:, 0], return_inverse=True)
        if len(keys) > _MOST_STRIPS:
            raise CapacityError(
                f"the points come from {len(keys):,} strips; {_MOST_STRIPS:,} are solved together, map parts of the survey."
            )
        n, x, y, xx, yy = (np.bincount(index.ravel(), rows[:, k]) for k in range(1, 6))
        middle = np.column_stack([x, y]) / n[:, None]
        spread = np.maximum((xx + yy) / n - np.sum(middle**2, axis=1), 0.0)
        return cls(keys.astype(np.uint32), middle, np.maximum(np.sqrt(3.0 * spread), 50.0))

    def design(self, strip: IntArray, xy: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the rows (N, 5) that make the error of a strip at places (N, 2) [m] with slopes (N, 2) [m/m]."""
        tilts = (xy - self.middle[strip]) / self.half_m[strip, None]
        return np.column_stack([np.ones(len(xy)), tilts, -slope])

    def numbers(self, keys: npt.NDArray[np.uint32]) -> IntArray:
        """Return the numbers (N,) of strips by their keys."""
        numbers: IntArray = np.searchsorted(self.keys, keys)
        return numbers


_SHIFT_M, _BLOCK_M, _WANDER_M = 0.1, 0.01, 0.01


class Sizes(NamedTuple):
    """Standard deviations of the strips' errors [m]: offset, tilt, shift, and the rest in each block and stretch."""

    offset_m: float
    tilt_m: float
    shift_m: float = _SHIFT_M
    block_m: float = _BLOCK_M
    wander_m: float = _WANDER_M

    def rest_m(self) -> float:
        """Return the standard deviation of what belongs to none of a strip's common errors [m]."""
        return float(np.hypot(self.block_m, self.wander_m))


@dataclass(frozen=True, eq=False, repr=False)
class StripErrors(DataObject):
    """Errors of the strips and their joint covariance.

    `places`: middles and half-lengths. `errors` (S, 5): offset, tilts and shifts [m]. `covariance` (5 S, 5
    S): of all errors [m²]. `sizes`: found sizes of the errors. `cell_m`: standard deviation that the points
    of a strip share in a cell [m].
    """

    places: StripPlaces
    errors: FloatArray
    covariance: FloatArray
    sizes: Sizes
    cell_m: float

    def at(self, keys: npt.NDArray[np.uint32], xy: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the error (N,) [m] of strips at places (N, 2) [m] with slopes (N, 2) [m/m]."""
        strip = self.places.numbers(keys)
        values: FloatArray = np.sum(self.places.design(strip, xy, slope) * self.errors[strip], axis=1)
        return values

    def facts(self) -> dict[str, Any]:
        """Return the errors with their standard deviations by the names of the strips, for the record."""
        sigma = np.sqrt(np.diag(self.covariance)).reshape(-1, N_TERMS)
        names = ("offset_m", "tilt_east_m", "tilt_north_m", "shift_east_m", "shift_north_m")
        return {
            strip_name(int(key)): {
                **dict(zip(names, map(float, own), strict=True)),
                **{f"{n}_sigma": float(s) for n, s in zip(names, own_sigma, strict=True)},
            }
            for key, own, own_sigma in zip(self.places.keys, self.errors, sigma, strict=True)
        }

    def offset_between(
        self, first: int, second: int, xy: FloatArray, slope: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[float, float]:
        """Return how far a strip lies above another one at a place (2,), and the standard deviation [m].

        `xy` (2,): easting and northing [m]. `slope` (2,): slope eastwards and northwards, by which horizontal
        shifts count [m/m]; level ground by default.
        """
        strip = self.places.numbers(np.array([first, second], np.uint32))
        rows = self.places.design(strip, np.tile(xy, (2, 1)), np.tile(slope, (2, 1)))
        whole = np.zeros(self.errors.size)
        for k, sign in ((0, 1.0), (1, -1.0)):
            whole[strip[k] * N_TERMS : (strip[k] + 1) * N_TERMS] += sign * rows[k]
        return float(whole @ self.errors.ravel()), float(np.sqrt(whole @ self.covariance @ whole))


def as_arrays(found: StripErrors) -> dict[str, FloatArray]:
    """Return arrays from which `from_arrays` makes the same errors."""
    places = found.places
    return {
        "keys": places.keys.astype(np.float64),
        "middle": places.middle,
        "half_m": places.half_m,
        "errors": found.errors,
        "covariance": found.covariance,
        "sizes": np.array(found.sizes),
        "cell_m": np.array(found.cell_m),
    }


def from_arrays(arrays: Mapping[str, FloatArray]) -> StripErrors:
    """Return errors from the arrays of `as_arrays`."""
    places = StripPlaces(arrays["keys"].astype(np.uint32), arrays["middle"], arrays["half_m"])
    sizes = Sizes(*map(float, arrays["sizes"]))
    return StripErrors(places, arrays["errors"], arrays["covariance"], sizes, float(arrays["cell_m"]))


_COLUMNS = ("x", "y", "e", "v", "raw", "placed")


class StripPairs(NamedTuple):
    """Overlapping strips.

    `table` (N, 9): keys of the two strips; number of blocks of cells that both have seen; means over the
    cells: easting and northing [m], slopes [m/m], difference of the cells' mean heights [m], and the part of
    it that other places of the points in the cell make [m].
    """

    table: FloatArray

    @classmethod
    def of(cls, blocks: npt.NDArray[np.void]) -> Self:
        """Return the pairs that blocks of cells belong to."""
        keys = np.column_stack([blocks["first"], blocks["second"]]).astype(np.float64).reshape(-1, 2)
        pairs, index = np.unique(keys, axis=0, return_inverse=True)
        cells = np.bincount(index.ravel(), blocks["n"])
        # Places are means of a block, the others sums over its cells.
        sums = [
            np.bincount(index.ravel(), blocks[name] * (blocks["n"] if name in "xy" else 1.0))
            for name in _COLUMNS
        ]
        n_blocks = np.bincount(index.ravel(), minlength=len(pairs))
        return cls(np.column_stack([pairs, n_blocks, *(total / cells for total in sums)]))

    @property
    def n_blocks(self) -> int:
        """Number of blocks of cells that two strips have seen."""
        return int(self.table[:, 2].sum())

    def facts(self, strips: StripErrors) -> list[dict[str, Any]]:
        """Return how far each strip lies above another one at the middle of their overlap, for the record.

        ``cell_difference_m`` is the mean difference of the cells' mean heights as measured, and
        ``expected_cell_difference_m`` what offset, tilts, shifts and the places of the points in the cells make of it.
        """
        found = []
        for first, second, n, x, y, east, north, raw, placed in self.table.tolist():
            keys, place = (int(first), int(second)), np.array([x, y])
            offset_m, sigma_m = strips.offset_between(*keys, place)
            expected_m, expected_sigma_m = strips.offset_between(*keys, place, (east, north))
            found.append(
                {
                    "strips": [strip_name(key) for key in keys],
                    "n_blocks": int(n),
                    "offset_m": offset_m,
                    "offset_m_sigma": sigma_m,
                    "cell_difference_m": raw,
                    "expected_cell_difference_m": expected_m + placed,
                    "expected_cell_difference_m_sigma": expected_sigma_m,
                }
            )
        return found


STRETCH_M = 256.0
"""Side of the squares within which a strip's wander is one number [m]."""
# A tenth of a millimetre squared.
_LEAST_VARIANCE = 1e-8


class GroupSums(NamedTuple):
    """Sums over groups of differences, each divided by the variance of its errors.

    `strip` (N, 2) int: numbers of the two strips; for a control point the strip's, twice. `is_pair` (N,)
    bool: whether the difference is one of two strips. `matrix` (N, 10, 10): HᵀH, for the errors of both
    strips. `column`, `rhs` (N, 10): Hᵀ1 and Hᵀd. `weight`, `total`, `energy` (N,): 1ᵀ1, 1ᵀd and dᵀd.
    `log_determinant` (N,): of the covariance of the group's shared errors, beyond that of independent ones.
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

    `rows` (N,): blocks of cells, and control points with `second` 0. The parts of a block that lie in several
    tiles are put together, so that the tiles make no difference.
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

    `prior_m` (5,): standard deviations of a strip's errors before the comparison [m]. `block_m`, `wander_m`:
    standard deviations of the errors that a strip has in every block and in every stretch [m].
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


_LOG_SD = 0.7
# Sizes are searched within a factor of a thousand.
_MOST_LOG = 7.0


def solve_strips(
    places: StripPlaces, blocks: npt.NDArray[np.void], control: npt.NDArray[np.void], expected: Sizes
) -> StripErrors:
    """Return the strips' errors by their overlaps and control points.

    `blocks` (N,): differences of strips over blocks of cells. `control` (M,): differences of strips and
    control points: `second` is 0, `n` is 1, `scatter` their variance [m²]. Returns: without overlaps and
    control points the errors are 0 and as uncertain as expected.
    """
    found = differences(places, np.concatenate([blocks, control]))
    n_strips = len(places.keys)
    sizes = _sizes(found, n_strips, expected) if len(found.starts) else expected
    normal = _normal(found, n_strips, sizes)
    factor = cho_factor(normal.matrix, lower=True)
    errors = cho_solve(factor, normal.rhs).reshape(-1, N_TERMS)
    covariance = cho_solve(factor, np.eye(len(normal.rhs)))
    return StripErrors(places, errors, covariance, sizes, _shared_in_cells(blocks))


def _sizes(found: Differences, n_strips: int, expected: Sizes) -> Sizes:
    """Return the sizes of greatest marginal likelihood, under log-normal priors about the expected ones."""
    start = np.log(expected)

    def negative(logs: FloatArray) -> float:
        normal = _normal(found, n_strips, Sizes(*np.exp(logs)))
        lower = np.linalg.cholesky(normal.matrix)
        whitened = solve_triangular(lower, normal.rhs, lower=True)
        own = normal.energy - whitened @ whitened + normal.log_determinant
        own += 2.0 * float(np.log(np.diag(lower)).sum())
        return 0.5 * float(own) + 0.5 * float(np.sum(((logs - start) / _LOG_SD) ** 2))

    bounds = [(log - _MOST_LOG, log + _MOST_LOG) for log in start]
    best = minimize(negative, start, method="L-BFGS-B", bounds=bounds)
    return Sizes(*map(float, np.exp(best.x)))


def _normal(found: Differences, n_strips: int, sizes: Sizes) -> Normal:
    """Return the normal equations with errors of some sizes."""
    prior_m = np.array([sizes.offset_m, sizes.tilt_m, sizes.tilt_m, sizes.shift_m, sizes.shift_m])
    return normal_equations(found, prior_m, n_strips, sizes.block_m, sizes.wander_m)


def _shared_in_cells(blocks: npt.NDArray[np.void]) -> float:
    """Return the standard deviation of a strip's height in a cell beyond what its points' scatter explains [m]."""
    if len(blocks) == 0:
        return 0.0
    excess = blocks["scatter"] - blocks["sampling"]
    order = np.argsort(excess)
    share = np.cumsum(blocks["n"][order]) / blocks["n"].sum()
    return float(np.sqrt(max(0.0, 0.5 * excess[order][np.searchsorted(share, 0.5)])))
