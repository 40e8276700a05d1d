r"""Fine relief of a window: a Gaussian field about the long relief, given the cells and the errors of the strips.

.. math::  (\kappa s^2 Q_0 + S) \, r = \sum_k h_k w_k (z_k - m_k - d_k), \qquad \sum_s g_s = 1 - g_0

The solution is linear in the heights, so an error that a strip makes at a place enters with the strip's share g_s there,
and an error of the long relief with the share g_0 of the prior. The standard deviation comes from draws, whose random
signs depend on the place alone: neighbouring tiles draw the same errors where they overlap.
"""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import uniform_filter

from survey.core import BoolArray, FloatArray, IntArray
from survey.reconstruction.lattice.field_posterior import Information, Stiffness
from survey.reconstruction.lattice.multigrid import Operator
from survey.reconstruction.lattice.solver import VCyclePreconditioner, solve
from survey.reconstruction.lattice.stencil import prior_diagonal, prior_noise
from survey.reconstruction.nodes import away_from
from survey.reconstruction.tiled.layout import CellWindow

_MEAN_TOLERANCE, _SHARE_TOLERANCE, _DRAW_TOLERANCE = 0.01, 0.02, 0.05
# Nodes as far from the points have alike variances, which are averaged over so many nodes a side.
_AVERAGED = 5
_FARTHEST_CLASS = 4
# Two places between 0 and 1/2, and their weights, at which a mean over that range is exact for cubic functions.
_GAUSS_PLACES = (0.25 - 0.25 / np.sqrt(3.0), 0.25 + 0.25 / np.sqrt(3.0))
_GAUSS_WEIGHTS = (0.5, 0.5)


class CellPoints(NamedTuple):
    """Cells as measurements.

    `uv` (N, 2): place in cells from the middle of the window's first cell. `residual` (N,): height above the
    long relief without the strip's error [m]. `weight` (N,): 1/σ² of the cell's mean [1/m²]. `strip` (N,)
    int: key of the strip. `row`, `column` (N,) int: the cell, counted from the origin of the CRS.
    """

    uv: FloatArray
    residual: FloatArray
    weight: FloatArray
    strip: IntArray
    row: IntArray
    column: IntArray

    def where(self, chosen: BoolArray) -> "CellPoints":
        """Return some of the measurements."""
        floats = (self.uv[chosen], self.residual[chosen], self.weight[chosen])
        return CellPoints(*floats, self.strip[chosen], self.row[chosen], self.column[chosen])

    def rows(self, values: FloatArray) -> FloatArray:
        """Return lattice coordinates, values and weights (N, 4)."""
        return np.column_stack([self.uv, values, self.weight])


class FineRelief(NamedTuple):
    """Fine relief of a window.

    `height` (H, W): above the long relief [m]. `variance` (H, W): of the field given the points, without
    errors that they share [m²]. `shares`: part that each strip has in the height, by its key; the long relief
    has the rest. `away` (H, W): distance from the nearest cell with points, in cells.
    """

    height: FloatArray
    variance: FloatArray
    shares: Mapping[int, FloatArray]
    away: FloatArray

    def long_share(self) -> FloatArray:
        """Return the part (H, W) that the long relief has in the height."""
        rest = np.ones(self.height.shape)
        for share in self.shares.values():
            rest -= share
        return rest


def fine_relief(
    points: CellPoints, window: CellWindow, cell_m: float, stiffness: Stiffness, n_draws: int
) -> FineRelief:
    """Return the fine relief at the middles of the cells of a window.

    `cell_m`: side of a cell [m].
    """
    information, operator = _equations(points, window, cell_m, stiffness)
    by = VCyclePreconditioner(operator)
    start = np.zeros(window.shape)
    height = solve(operator, information.rhs, start, tolerance=_MEAN_TOLERANCE, preconditioner=by).z
    shares = {}
    for key in np.unique(points.strip).tolist():
        own = points.where(points.strip == key)
        ones = Information.empty(window.shape, 0)
        ones.add(own.rows(np.ones(len(own.weight))))
        shares[int(key)] = solve(operator, ones.rhs, start, tolerance=_SHARE_TOLERANCE, preconditioner=by).z
    away = away_from(information.stencil[0] > 0.0)
    variance = stiffness.noise_factor**2 * _variance(operator, by, points, window, n_draws)
    return FineRelief(height, _averaged(variance, away), shares, away)


def _equations(
    points: CellPoints, window: CellWindow, cell_m: float, stiffness: Stiffness
) -> tuple[Information, Operator]:
    """Return what the points say of the nodes, and the matrix A."""
    information = Information.empty(window.shape, 0)
    information.add(points.rows(points.residual))
    ratio = stiffness._replace(stiffness=stiffness.stiffness * stiffness.noise_factor**2)
    return information, Operator(information.stencil, ratio.weights(cell_m))


def variance_within_cells(
    points: CellPoints, window: CellWindow, cell_m: float, stiffness: Stiffness, n_draws: int
) -> float:
    """Return the variance of the bilinear field, averaged over measured cells, as a share of that at their middles.

    The middles are the nodes of the lattice, where the field is least certain: between them it is a mean of nodes.
    """
    information, operator = _equations(points, window, cell_m, stiffness)
    measured = information.stencil[0] > 0.0
    nodes, cells = 0.0, 0.0
    for drawn in _draws(operator, VCyclePreconditioner(operator), points, window, n_draws):
        nodes += float(np.sum(drawn[measured] ** 2))
        cells += float(np.sum(mean_square_over_cells(drawn)[measured]))
    return cells / nodes if nodes > 0.0 else 1.0


def mean_square_over_cells(values: FloatArray) -> FloatArray:
    """Return the mean square of bilinear node values (H, W) over the cells about the nodes.

    >>> mean_square_over_cells(np.full((2, 2), 3.0)).round(6).tolist()
    [[9.0, 9.0], [9.0, 9.0]]
    """
    padded = np.pad(values, 1, mode="edge")
    total = np.zeros(values.shape)
    quadrants = ((j, i) for j in (-1, 1) for i in (-1, 1))
    for j, i in quadrants:
        corners = [
            [
                padded[1 + b * j : padded.shape[0] - 1 + b * j, 1 + a * i : padded.shape[1] - 1 + a * i]
                for a in (0, 1)
            ]
            for b in (0, 1)
        ]
        for (s, p), (t, q) in product(enumerate(_GAUSS_WEIGHTS), repeat=2):
            v, u = _GAUSS_PLACES[s], _GAUSS_PLACES[t]
            south, north = ((1.0 - u) * row[0] + u * row[1] for row in corners)
            total += p * q * ((1.0 - v) * south + v * north) ** 2
    return 0.25 * total


def _variance(
    operator: Operator, by: VCyclePreconditioner, points: CellPoints, window: CellWindow, n_draws: int
) -> FloatArray:
    """Return the diagonal of A⁻¹: 1/A_ii, and the mean square over draws of what the neighbours add (Rao–Blackwell)."""
    own = operator.stencil[0] + prior_diagonal(operator.weights, operator.soft, operator.shape)
    total = np.zeros(operator.shape)
    for drawn in _draws(operator, by, points, window, n_draws):
        total += ((operator.apply(drawn) - own * drawn) / own) ** 2
    variance: FloatArray = total / n_draws + 1.0 / own
    return variance


def _draws(
    operator: Operator, by: VCyclePreconditioner, points: CellPoints, window: CellWindow, n_draws: int
) -> Iterator[FloatArray]:
    """Yield draws (H, W) with the covariance A⁻¹."""
    signs, start = np.empty((N_LAYERS, *operator.shape)), np.zeros(operator.shape)
    rows, cells = points.rows(points.residual), np.column_stack([points.column, points.row])
    for draw in range(n_draws):
        error = np.zeros(operator.shape)
        add_point_errors(rows, cells, points.strip, draw, error)
        place_signs(window.west, window.south, draw, signs)
        prior_noise(operator.weights, operator.soft, signs, error)
        yield solve(operator, error, start, tolerance=_DRAW_TOLERANCE, preconditioner=by).z


def _averaged(variance: FloatArray, away: FloatArray) -> FloatArray:
    """Average the variance over neighbours that are as far from the points."""
    result = variance.copy()
    kind = np.minimum(np.round(np.where(np.isfinite(away), away, _FARTHEST_CLASS)), _FARTHEST_CLASS)
    for k in range(_FARTHEST_CLASS + 1):
        alike = kind == k
        share = uniform_filter(alike.astype(np.float64), _AVERAGED, mode="constant")
        total = uniform_filter(np.where(alike, variance, 0.0), _AVERAGED, mode="constant")
        result[alike] = total[alike] / share[alike]
    return result


def strip_variance(
    shares: Mapping[int, FloatArray], design: Mapping[int, FloatArray], covariance: npt.NDArray[np.float64]
) -> FloatArray:
    """Return the variance (H, W) [m²] that errors of strips make in a map.

    `covariance` (5 S, 5 S): of the errors of these strips, in the same order [m²].
    """
    if not shares:
        return np.zeros(())
    first = next(iter(shares.values()))
    variance = np.empty(first.shape)
    for j in range(len(first)):
        rows = np.concatenate([shares[key][j][:, None] * design[key][j] for key in shares], axis=1)
        variance[j] = np.einsum("na,ab,nb->n", rows, covariance, rows, optimize=True)
    return variance


N_LAYERS = 6


@njit(cache=True, inline="always")
def _mixed(key: np.uint64) -> np.uint64:
    """Return 64 well-mixed bits (the finaliser of SplitMix64)."""
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


@njit(cache=True, inline="always")
def _place(column: int, row: int, salt: int) -> np.uint64:
    key = _mixed(np.uint64(column) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(salt))
    return _mixed(key ^ (np.uint64(row) * np.uint64(0xD1B54A32D192ED03)))


@njit(cache=True)
def place_signs(west: int, south: int, draw: int, out: FloatArray) -> None:
    """Set `out` (6, rows, columns) to signs of the nodes of a window: one hash for the six signs of a node."""
    for j in range(out.shape[1]):
        for i in range(out.shape[2]):
            bits = _place(west + i, south + j, draw)
            for layer in range(N_LAYERS):
                out[layer, j, i] = 1.0 if (bits >> np.uint64(layer)) & np.uint64(1) else -1.0


@njit(cache=True)
def add_point_errors(
    points: FloatArray, cells: IntArray, strip: IntArray, draw: int, out: FloatArray
) -> None:
    """Add errors of the points to `out` (rows, columns) whose covariance is the data's stencil.

    The columns of `points` (N, 4) are lattice coordinates, height and weight [1/m²]; `cells` (N, 2) are column and row counted
    from the origin of the CRS, so that a point has the same sign in every window.
    """
    rows, columns = out.shape
    for k in range(len(points)):
        u, v, _, w = points[k]
        i, j = int(np.floor(u)), int(np.floor(v))
        i -= i == columns - 1 and u == i
        j -= j == rows - 1 and v == j
        if i < 0 or j < 0 or i >= columns - 1 or j >= rows - 1:
            continue
        bits = _mixed(_place(cells[k, 0], cells[k, 1], 1000 + draw) ^ np.uint64(strip[k]))
        e = np.sqrt(w) if bits & np.uint64(1) else -np.sqrt(w)
        s, t = u - i, v - j
        out[j, i] += e * (1 - s) * (1 - t)
        out[j, i + 1] += e * s * (1 - t)
        out[j + 1, i] += e * (1 - s) * t
        out[j + 1, i + 1] += e * s * t


@njit(cache=True)
def choose_squares(column: IntArray, row: IntArray, side: int, share: float) -> IntArray:
    """Return 1 (N,) for the cells of randomly chosen squares of `side` cells that make up a share of all, else 0."""
    out = np.zeros(len(column), np.int64)
    limit = np.uint64(share * 2.0**53)
    for k in range(len(column)):
        bits = _place(column[k] // side, row[k] // side, 77)
        out[k] = 1 if (bits >> np.uint64(11)) < limit else 0
    return out
