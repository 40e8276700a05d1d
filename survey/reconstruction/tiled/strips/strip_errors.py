r"""Errors that all points of a strip share: offset, tilts and horizontal shift, by least squares on the overlaps.

Strip s measures

.. math::  z_s(x) = z(x) + a_s + t_s \cdot (x - x_s) / R_s - \nabla z(x) \cdot h_s + e

with offset a, tilts t (as the error that they make at the strip's end), shift h, the strip's middle x_s and its
half-length R_s. Differences of two strips and control points determine the errors; each has a normal prior whose size
is found by marginal likelihood. Errors of a block of cells that belong to none of them have the variance τ².
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from survey.core.arrays import FloatArray, IntArray
from survey.core.data_object import DataObject
from survey.core.errors import CapacityError
from survey.reconstruction.tiled.cells.sorting import strip_name

N_TERMS = 5
"""Errors of a strip: offset, tilt eastwards and northwards, shift eastwards and northwards."""
_MOST_STRIPS = 1000
_SHIFT_M, _BLOCK_M = 0.1, 0.01
_LOG_SD = 0.7
_LEAST_VARIANCE = 1e-8
_SUPERBLOCK_M = 256.0


class StripPlaces(NamedTuple):
    """Keys of the strips (S,), their middles (S, 2) [m], and their half-lengths (S,) [m]."""

    keys: npt.NDArray[np.uint32]
    middle: FloatArray
    half_m: FloatArray

    @classmethod
    def of(cls, tables: list[npt.NDArray[np.float64]]) -> "StripPlaces":
        """Return the places by tables of the tiles: key, number of cells, sums of x, y, x², y² [m].

        Raises
        ------
        CapacityError
            More strips than can be solved together.
        """
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


class Sizes(NamedTuple):
    """Standard deviations of the strips' errors: offset, tilt, shift, and the rest in each block [m]."""

    offset_m: float
    tilt_m: float
    shift_m: float = _SHIFT_M
    block_m: float = _BLOCK_M


@dataclass(frozen=True, eq=False, repr=False)
class StripErrors(DataObject):
    """Errors of the strips and their joint covariance.

    Parameters
    ----------
    places : StripPlaces
        Middles and half-lengths.
    errors : (S, 5) ndarray
        Offset, tilts and shifts [m].
    covariance : (5 S, 5 S) ndarray
        Of all errors [m²].
    sizes : Sizes
        Found sizes of the errors.
    cell_m : float
        Standard deviation that the points of a strip share in a cell [m].
    inflation : float
        Factor on the standard deviations by residuals over hundreds of metres, at least 1.
    """

    places: StripPlaces
    errors: FloatArray
    covariance: FloatArray
    sizes: Sizes
    cell_m: float
    inflation: float

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

    def offset_between(self, first: int, second: int, xy: FloatArray) -> tuple[float, float]:
        """Return how far a strip lies above another one at a place (2,) on level ground, and the standard deviation [m]."""
        strip = self.places.numbers(np.array([first, second], np.uint32))
        rows = self.places.design(strip, np.tile(xy, (2, 1)), np.zeros((2, 2)))
        whole = np.zeros(self.errors.size)
        for k, sign in ((0, 1.0), (1, -1.0)):
            whole[strip[k] * N_TERMS : (strip[k] + 1) * N_TERMS] += sign * rows[k]
        return float(whole @ self.errors.ravel()), float(np.sqrt(whole @ self.covariance @ whole))


class Normal(NamedTuple):
    """Normal equations of the strips' errors: matrix, right-hand side, and the parts of the likelihood without them."""

    matrix: FloatArray
    rhs: FloatArray
    energy: float
    log_determinant: float


def solve_strips(
    places: StripPlaces, blocks: npt.NDArray[np.void], control: npt.NDArray[np.void], expected: Sizes
) -> StripErrors:
    """Return the strips' errors by their overlaps and control points.

    Parameters
    ----------
    places : StripPlaces
        Middles and half-lengths of the strips.
    blocks : (N,) ndarray of OVERLAP
        Differences of strips over blocks of cells.
    control : (M,) ndarray of OVERLAP
        Differences of strips and control points: `second` is 0, `n` is 1, `scatter` their variance [m²].
    expected : Sizes
        Medians of the priors of the sizes.

    Returns
    -------
    StripErrors
        Without overlaps and control points the errors are 0 and as uncertain as expected.
    """
    rows = np.concatenate([blocks, control])
    sizes = _sizes(places, rows, expected) if len(rows) else expected
    normal = _normal(places, rows, sizes)
    factor = cho_factor(normal.matrix, lower=True)
    errors = cho_solve(factor, normal.rhs).reshape(-1, N_TERMS)
    covariance = cho_solve(factor, np.eye(len(normal.rhs)))
    inflation = _inflation(places, blocks, errors, sizes)
    return StripErrors(places, errors, covariance * inflation**2, sizes, _shared_in_cells(blocks), inflation)


def _sizes(places: StripPlaces, rows: npt.NDArray[np.void], expected: Sizes) -> Sizes:
    """Return the sizes of greatest marginal likelihood, under log-normal priors about the expected ones."""
    start = np.log(expected)

    def negative(logs: FloatArray) -> float:
        normal = _normal(places, rows, Sizes(*np.exp(logs)))
        lower = np.linalg.cholesky(normal.matrix)
        whitened = solve_triangular(lower, normal.rhs, lower=True)
        own = normal.energy - whitened @ whitened + normal.log_determinant
        own += 2.0 * float(np.log(np.diag(lower)).sum())
        return 0.5 * float(own) + 0.5 * float(np.sum(((logs - start) / _LOG_SD) ** 2))

    found = minimize(
        negative, start, method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.02, "maxfev": 200}
    )
    return Sizes(*map(float, np.exp(found.x)))


def _normal(places: StripPlaces, rows: npt.NDArray[np.void], sizes: Sizes) -> Normal:
    """Return the normal equations of all blocks, whose shared rest is integrated out, and of the priors."""
    n_all = N_TERMS * len(places.keys)
    prior = np.array([sizes.offset_m, sizes.tilt_m, sizes.tilt_m, sizes.shift_m, sizes.shift_m])
    matrix = np.diag(np.tile(prior**-2.0, len(places.keys)))
    rhs = np.zeros(n_all)
    log_determinant = 2.0 * len(places.keys) * float(np.log(prior).sum())
    if len(rows) == 0:
        return Normal(matrix, rhs, 0.0, log_determinant)
    noise = np.maximum(rows["scatter"], _LEAST_VARIANCE)
    shared = sizes.block_m**2 * np.where(rows["second"] > 0, 2.0, 1.0)
    shrink = shared / (noise + shared * rows["n"])
    gram, right = _moments(rows)
    first, of_rhs = gram[:, 0], right[:, 0]
    gram = (gram - shrink[:, None, None] * first[:, :, None] * first[:, None, :]) / noise[:, None, None]
    right = (right - (shrink * of_rhs)[:, None] * first) / noise[:, None]
    energy = float(np.sum((rows["dd"] - shrink * rows["d"] ** 2) / noise))
    log_determinant += float(np.sum(np.log1p(shared * rows["n"] / noise)))
    _add_blocks(places, rows, (gram, right), matrix, rhs)
    return Normal(matrix, rhs, energy, log_determinant)


def _moments(rows: npt.NDArray[np.void]) -> tuple[FloatArray, FloatArray]:
    """Return Σ h hᵀ (N, 3, 3) and Σ h d (N, 3) of the blocks, with h = (1, slope east, slope north)."""
    n, e, v, ee, ev, vv = (rows[name] for name in ("n", "e", "v", "ee", "ev", "vv"))
    gram = np.stack([np.stack([n, e, v], -1), np.stack([e, ee, ev], -1), np.stack([v, ev, vv], -1)], -2)
    return gram, np.stack([rows[name] for name in ("d", "de", "dv")], -1)


def _maps(places: StripPlaces, rows: npt.NDArray[np.void], which: str) -> tuple[IntArray, FloatArray]:
    """Return the strip's number (N,) and the matrix (N, 3, 5) from its errors to coefficients of h."""
    strip = places.numbers(rows[which])
    design = places.design(strip, np.column_stack([rows["x"], rows["y"]]), np.zeros((len(rows), 2)))
    matrix = np.zeros((len(rows), 3, N_TERMS))
    matrix[:, 0, :3] = design[:, :3]
    matrix[:, 1, 3] = matrix[:, 2, 4] = -1.0
    return strip, matrix


def _add_blocks(
    places: StripPlaces,
    rows: npt.NDArray[np.void],
    moments: tuple[FloatArray, FloatArray],
    matrix: FloatArray,
    rhs: FloatArray,
) -> None:
    """Add every block to the normal equations of its two strips."""
    gram, right = moments
    is_pair = rows["second"] > 0
    sides: list[tuple[IntArray, IntArray, FloatArray, float]] = [
        (np.arange(len(rows)), *_maps(places, rows, "first"), 1.0),
        (np.flatnonzero(is_pair), *_maps(places, rows[is_pair], "second"), -1.0),
    ]
    terms = np.arange(N_TERMS)
    for own, strip, to_h, sign in sides:
        at = strip[:, None] * N_TERMS + terms
        np.add.at(rhs, at, sign * np.einsum("nia,ni->na", to_h, right[own]))
        np.add.at(
            matrix, (at[:, :, None], at[:, None, :]), np.einsum("nia,nij,njb->nab", to_h, gram[own], to_h)
        )
    (_, a, first, _), (pair, b, second, _) = sides
    cross = -np.einsum("nia,nij,njb->nab", first[pair], gram[pair], second)
    at_a, at_b = a[pair][:, None] * N_TERMS + terms, b[:, None] * N_TERMS + terms
    np.add.at(matrix, (at_a[:, :, None], at_b[:, None, :]), cross)
    np.add.at(matrix, (at_b[:, :, None], at_a[:, None, :]), np.swapaxes(cross, 1, 2))


def _inflation(places: StripPlaces, blocks: npt.NDArray[np.void], errors: FloatArray, sizes: Sizes) -> float:
    """Return the factor by which residuals averaged over 256 m exceed what independent blocks would leave."""
    if len(blocks) == 0:
        return 1.0
    residual = blocks["d"] / blocks["n"]
    for which, sign in (("first", 1.0), ("second", -1.0)):
        strip, to_h = _maps(places, blocks, which)
        mean_h = np.column_stack([np.ones(len(blocks)), blocks["e"] / blocks["n"], blocks["v"] / blocks["n"]])
        residual = residual - sign * np.einsum("ni,nia,na->n", mean_h, to_h, errors[strip])
    weight = 1.0 / (np.maximum(blocks["scatter"], _LEAST_VARIANCE) / blocks["n"] + 2.0 * sizes.block_m**2)
    keys = np.column_stack(
        [blocks["first"], blocks["second"], *(blocks[axis] // _SUPERBLOCK_M for axis in ("x", "y"))]
    )
    _, index = np.unique(keys, axis=0, return_inverse=True)
    total, moment = np.bincount(index.ravel(), weight), np.bincount(index.ravel(), weight * residual)
    # The mean of n squares of standard normal numbers scatters by √(2 / n); only what exceeds it twice counts.
    excess = float(np.mean(moment**2 / total)) - 2.0 * np.sqrt(2.0 / len(total))
    return float(np.sqrt(max(1.0, excess)))


def _shared_in_cells(blocks: npt.NDArray[np.void]) -> float:
    """Return the standard deviation of a strip's height in a cell beyond what its points' scatter explains [m]."""
    if len(blocks) == 0:
        return 0.0
    return float(np.sqrt(max(0.0, 0.5 * float(np.median(blocks["scatter"] - blocks["sampling"])))))


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
        "scalars": np.array([found.cell_m, found.inflation]),
    }


def from_arrays(arrays: Mapping[str, FloatArray]) -> StripErrors:
    """Return errors from the arrays of `as_arrays`."""
    places = StripPlaces(arrays["keys"].astype(np.uint32), arrays["middle"], arrays["half_m"])
    cell_m, inflation = map(float, arrays["scalars"])
    sizes = Sizes(*map(float, arrays["sizes"]))
    return StripErrors(places, arrays["errors"], arrays["covariance"], sizes, cell_m, inflation)
