"""Normal equations of the terrain's weights and of all unknowns that landmarks share, solved as one system.

With whitened waves φ (weights w ~ N(0, I)), shared unknowns u of prior information Λ, points
``z = φ w + U u + ε`` of independent noise N, and means over cells ``S = ψ w + V u + η`` with
covariance R,

    [ I + ΦᵀN⁻¹Φ + ΨᵀR⁻¹Ψ    B                       ] [w]   [ ΦᵀN⁻¹z + ΨᵀR⁻¹S ]
    [ Bᵀ                       Λ + UᵀN⁻¹U + VᵀR⁻¹V = G ] [u] = [ UᵀN⁻¹z + VᵀR⁻¹S ]

with B = ΦᵀN⁻¹U + ΨᵀR⁻¹V. The points' errors then are N + U Λ⁻¹ Uᵀ, correlated. G is sparse
and is eliminated first; the matrix of the weights is the Fourier engine's less B G⁻¹ Bᵀ, so that
their covariance, and the map of the variance, are computed as without shared unknowns.

`TerrainPosterior` is the posterior of waves and plane alone, which takes a small part of the memory of a complete solution.
`JointEquations` and `JointPosterior` are the system and its solution; `point_rows` and `cell_rows` are the design matrices
of the points and of the prior's cells.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numba
import numpy as np
from scipy import sparse
from scipy.linalg import blas

from survey.core import FloatArray, IntArray
from survey.data import Grid, SurfacePoints
from survey.data.path_error import SparseFactor
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.fourier_weights import PointSums, WeightPosterior, precision
from survey.reconstruction.gp.engines.regression import NoisyValues, PolynomialTrend
from survey.reconstruction.gp.satellite_cells import SatelliteCells
from survey.reconstruction.joint.shared_errors import LandmarkErrors, SharedError, side_by_side


@dataclass(frozen=True)
class TerrainPosterior:
    """Gaussian posterior of heights, as waves and a plane.

    `weights`: covariance of the whitened weights of m waves. `mean` (m,): their estimate. `trend`: plane
    below the waves. `plane` (3,): estimate of its coefficients [m]. `plane_covariance` (3, 3): their
    covariance [m²]. `cross` (m, 3): covariance of the weights with them [m]. `datum_m`: height that heights
    are counted from [m]. `finer_m2`: variance of the relief that the waves leave out [m²].
    """

    weights: WeightPosterior
    mean: FloatArray
    trend: PolynomialTrend
    plane: FloatArray
    plane_covariance: FloatArray
    cross: FloatArray
    datum_m: float
    finer_m2: float

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the most likely height (M,) at places (M, 2) [m]."""
        return self.waves(xy) + self.trend.columns(xy) @ self.plane + self.datum_m

    def waves(self, xy: FloatArray) -> FloatArray:
        """Return the part of the waves in the most likely height (M,) at places (M, 2) [m]."""
        return self.weights.basis.box.evaluate(xy, self._coefficients(self.mean))

    def gradient(self, xy: FloatArray, highest_rad_per_m: float = np.inf) -> FloatArray:
        """Return the slope (M, 2) of the most likely surface at places (M, 2) [m/m], of waves up to an angular frequency."""
        basis = self.weights.basis
        is_long = basis.doubled(np.linalg.norm(basis.omega, axis=-1) <= highest_rad_per_m)
        box, coefficients = basis.box, self._coefficients(self.mean * is_long)
        slopes = [box.evaluate(xy, box.derivative(coefficients, axis)) for axis in (0, 1)]
        gradient: FloatArray = np.stack(slopes, axis=-1) + self.trend.gradient @ self.plane
        return gradient

    def cell_means(self, cells: SatelliteCells) -> tuple[FloatArray, FloatArray]:
        """Return the mean heights (C,) of cells [m] and their covariance (C, C) [m²]."""
        waves = cells.features(self.weights.basis, self.weights.amplitudes)
        columns = self.trend.columns(cells.centre)
        means: FloatArray = waves @ self.mean + columns @ self.plane + self.datum_m
        return means, self._covariance(waves, columns)

    def covariance(self, xy: FloatArray) -> FloatArray:
        """Return the covariance (M, M) of the heights at places (M, 2) [m²], relief finer than the map included.

        It depends on where points lie and how they err, on no height that was measured.
        """
        covariance = self._covariance(self.waves_at(xy), self.trend.columns(xy))
        covariance[np.diag_indices(len(xy))] += self.finer_m2
        return covariance

    def fields(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) on a grid [m], relief finer than the map included."""
        box = self.weights.basis.box
        columns = self.trend.columns(np.stack(np.meshgrid(grid.x, grid.y), axis=-1))
        mean = box.evaluate_on_axes(grid.x, grid.y, self._coefficients(self.mean))
        mean += columns @ self.plane + self.datum_m
        variance = box.evaluate_on_axes(grid.x, grid.y, self.weights.variance_coefficients())
        fields = [box.evaluate_on_axes(grid.x, grid.y, self._coefficients(c)) for c in self.cross.T]
        variance += 2.0 * np.sum(columns * np.stack(fields, axis=-1), axis=-1)
        variance += np.einsum("hwi,ij,hwj->hw", columns, self.plane_covariance, columns)
        variance += self.finer_m2
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def rises(self, steps: FloatArray, waves: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the rises (M, 2) [m] between both ends of two lines about each place, and their covariance (M, 2, 2).

        Relief that the waves leave out is no part of it. `steps` (2, 2) leads from a place to one end of each line [m],
        and `waves` are those of `waves_between` for each of them.
        """
        columns = np.array([self.trend.columns(2.0 * step[None])[0] for step in steps])
        columns -= self.trend.columns(np.zeros((1, 2)))
        rises = np.stack([w @ self.mean for w in waves], axis=1) + columns @ self.plane
        cross = self.cross @ columns.T
        covariance = np.tile(columns @ self.plane_covariance @ columns.T, (len(rises), 1, 1))
        seen = [self.weights.times_each(w) for w in waves]
        for a in (0, 1):
            for b in (0, 1):
                covariance[:, a, b] += np.einsum("mi,im->m", waves[a], seen[b])
                covariance[:, a, b] += waves[a] @ cross[:, b] + waves[b] @ cross[:, a]
        return rises, covariance

    def waves_at(self, xy: FloatArray) -> FloatArray:
        """Return the whitened waves (N, m) at places (N, 2) [m], for few places."""
        return waves_at(xy, self.weights.basis, self.weights.amplitudes)

    def waves_between(self, xy: FloatArray, step: FloatArray) -> FloatArray:
        """Return the differences (N, m) of the whitened waves a step (2,) before and behind places (N, 2) [m]."""
        return self.waves_at(xy + step) - self.waves_at(xy - step)

    def _coefficients(self, whitened: FloatArray) -> Any:
        """Return the coefficients of a field, as `FourierBox.evaluate` takes them, from whitened weights (m,)."""
        basis = self.weights.basis
        return basis.coefficients_of(basis.doubled(self.weights.amplitudes) * whitened)

    def _covariance(self, waves: FloatArray, columns: FloatArray) -> FloatArray:
        """Return the covariance of functionals of waves (M, m) and plane (M, 3)."""
        cross = waves @ self.cross @ columns.T
        plane: FloatArray = columns @ self.plane_covariance @ columns.T
        return waves @ self.weights.times_each(waves) + cross + cross.T + plane


def waves_at(xy: FloatArray, basis: FourierBasis, amplitudes: FloatArray) -> FloatArray:
    """Return the whitened waves (N, m) at places (N, 2) [m], for few places."""
    waves = np.empty((len(xy), basis.n_modes))
    fill_waves(*basis.box.phases(xy), basis.lattice, amplitudes, waves)
    return waves


@numba.njit(cache=True, fastmath=True)
def fill_waves(x: FloatArray, y: FloatArray, lattice: IntArray, d: FloatArray, out: FloatArray) -> None:
    """Write the whitened waves at points (N, m): cosines, then sines, by turning unit vectors step by step."""
    n = lattice.shape[0]
    half_p, half_q = 0, 0
    for k in range(n):
        half_p, half_q = max(half_p, lattice[k, 0]), max(half_q, abs(lattice[k, 1]))
    turn_x = np.empty(half_p + 1, dtype=np.complex128)
    turn_y = np.empty(2 * half_q + 1, dtype=np.complex128)
    for i in range(x.size):
        for p in range(half_p + 1):
            turn_x[p] = complex(np.cos(p * x[i]), np.sin(p * x[i]))
        for q in range(half_q + 1):
            turn_y[half_q + q] = complex(np.cos(q * y[i]), np.sin(q * y[i]))
            turn_y[half_q - q] = turn_y[half_q + q].conjugate()
        for k in range(n):
            a, b = turn_x[lattice[k, 0]], turn_y[lattice[k, 1] + half_q]
            out[i, k] = d[k] * (a.real * b.real - a.imag * b.imag)
            if k > 0:
                out[i, n + k - 1] = d[k] * (a.real * b.imag + a.imag * b.real)


# Points whose waves are evaluated at once: bounds the memory.
_AT_ONCE = 512


@dataclass(frozen=True)
class Functionals:
    """Measurements of functionals: ``waves`` (C, m) whitened, ``shared`` (C, S), ``values`` (C,), ``covariance`` (C, C)."""

    waves: FloatArray
    shared: Any
    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class JointPosterior:
    """Weights and shared unknowns after the data.

    ``weights`` is the covariance of the whitened weights, ``mean`` (m,) their estimate,
    ``shared`` (S,) that of the shared unknowns; ``factor`` is the factorization of G,
    ``reach`` (S, m) is G⁻¹Bᵀ.
    """

    weights: WeightPosterior
    mean: FloatArray
    shared: FloatArray
    factor: Any
    reach: FloatArray

    @classmethod
    def given(
        cls,
        basis: FourierBasis,
        amplitudes: FloatArray,
        data: NoisyValues,
        shared: tuple[Any, Any],
        functionals: Functionals | None = None,
    ) -> Self:
        """Solve; `shared` are the sparse rows U (N, S) and the sparse prior information Λ (S, S)."""
        equations = JointEquations.of_points(basis, amplitudes, data, *shared)
        if functionals is not None:
            equations.add(functionals)
        return cls.solved(basis, amplitudes, equations, SparseFactor.of(equations.shared))

    @classmethod
    def solved(
        cls, basis: FourierBasis, amplitudes: FloatArray, equations: "JointEquations", factor: Any
    ) -> Self:
        """Solve normal equations, whose weights' block is overwritten; `factor` solves with G."""
        reach = factor.solve(equations.coupling)
        active = np.flatnonzero(equations.coupling.any(axis=1))
        _add_product(equations.weights, equations.coupling[active], reach[active], -0.5)
        alone = factor.solve(equations.right_shared)
        weights = WeightPosterior.inverted(basis, amplitudes, equations.weights)
        mean = weights.times(equations.right_weights - equations.coupling.T @ alone)
        # Products of sparse rows and an array in column order copy the array.
        return cls(weights, mean, alone - reach @ mean, factor, np.ascontiguousarray(reach))

    def terrain(
        self, trend: PolynomialTrend, first: int, datum_m: float, finer_m2: float
    ) -> TerrainPosterior:
        """Return the posterior of the terrain, without the unknowns of the path.

        `datum_m`: height that heights are counted from [m]. `finer_m2`: variance of the relief that the waves
        leave out [m²].
        """
        rows = unit_rows(first, trend.n_columns, len(self.shared))
        plane = self.shared[first : first + trend.n_columns]
        covariance, cross = self.shared_covariance(rows), self.cross_weights(rows)
        return TerrainPosterior(self.weights, self.mean, trend, plane, covariance, cross, datum_m, finer_m2)

    def shared_covariance(self, rows: Any) -> FloatArray:
        """Return the covariance (M, M) of linear functions of the shared unknowns, given by rows (M, S)."""
        sides = np.ascontiguousarray(rows.toarray().T)
        through = self._through(rows)
        own = rows @ self.factor.solve(sides)
        covariance: FloatArray = own + through @ self.seen(through)
        return covariance

    def shared_blocks(self, rows: Any, size: int) -> FloatArray:
        """Return the covariance (M / size, size, size) within each block of linear functions (M, S)."""
        through = self._through(rows)
        seen = self.seen(through)
        own = self.factor.solve(np.ascontiguousarray(rows.toarray().T))
        n = len(through) // size
        blocks = np.empty((n, size, size))
        for k in range(n):
            part = slice(size * k, size * (k + 1))
            blocks[k] = rows[part] @ own[:, part] + through[part] @ seen[:, part]
        return blocks

    def cross_weights(self, rows: Any) -> FloatArray:
        """Return the covariance (m, M) of the whitened weights with linear functions of the shared unknowns."""
        return -self.seen(self._through(rows))

    def _through(self, rows: Any) -> FloatArray:
        return np.asarray(rows @ self.reach)

    def seen(self, through: FloatArray) -> FloatArray:
        """Return the covariance (m, M) of the whitened weights with linear functions of them (M, m)."""
        seen: FloatArray = blas.dsymm(1.0, self.weights.covariance, np.asfortranarray(through.T), lower=1)
        return seen


def unit_rows(first: int, n: int, n_shared: int) -> Any:
    """Return the sparse rows (n, S) that select shared unknowns from the first on."""
    every = np.arange(n)
    return sparse.csr_array((np.ones(n), (every, first + every)), shape=(n, n_shared))


@dataclass
class JointEquations:
    """The blocks of the normal equations: of the weights (lower triangle), Bᵀ (S, m), and G; with both right sides."""

    weights: FloatArray
    coupling: FloatArray
    shared: Any
    right_weights: FloatArray
    right_shared: FloatArray

    @classmethod
    def of_points(
        cls, basis: FourierBasis, amplitudes: FloatArray, data: NoisyValues, rows: Any, information: Any
    ) -> "JointEquations":
        """Return the equations of points alone; `rows` (N, S) and `information` (S, S) are sparse."""
        sums = PointSums.of(basis, data, 0.0)
        weighted = sparse.csr_array(rows.multiply((1.0 / data.noise_m2)[:, None]))
        return cls(
            precision(basis, amplitudes, sums.gram),
            _coupling(basis, amplitudes, data.xy, weighted),
            sparse.csr_array(information + rows.T @ weighted),
            basis.doubled(amplitudes) * basis.weights_of(sums.moments[0]),
            weighted.T @ data.values,
        )

    def add(self, more: Functionals) -> None:
        """Add measurements of functionals."""
        m, n_shared = more.waves.shape[1], more.shared.shape[1]
        sides = np.column_stack([more.waves, more.shared.toarray(), more.values])
        solved = np.linalg.solve(more.covariance, sides)
        waves, shared, values = solved[:, :m], solved[:, m : m + n_shared], solved[:, -1]
        _add_product(self.weights, more.waves, waves, 0.5)
        self.right_weights = self.right_weights + more.waves.T @ values
        self.shared = sparse.csr_array(self.shared + more.shared.T @ sparse.csr_array(shared))
        self.right_shared = self.right_shared + more.shared.T @ values
        touched = np.flatnonzero(np.abs(shared).sum(axis=0))
        self.coupling[touched] += shared[:, touched].T @ more.waves


def _add_product(matrix: FloatArray, a: FloatArray, b: FloatArray, factor: float) -> None:
    """Add ``factor (aᵀ b + bᵀ a)`` to the lower triangle of a matrix in column order, in place."""
    blas.dsyr2k(
        factor,
        np.ascontiguousarray(a).T,
        np.ascontiguousarray(b).T,
        1.0,
        matrix,
        trans=0,
        lower=1,
        overwrite_c=1,
    )


def _coupling(basis: FourierBasis, amplitudes: FloatArray, xy: FloatArray, weighted: Any) -> FloatArray:
    """Return ``UᵀN⁻¹Φ`` (S, m): points in the order of what they touch, so that few unknowns meet at a time."""
    n_points, n_shared = weighted.shape
    total = np.zeros((n_shared, basis.n_modes))
    if n_shared == 0:
        return total
    first = np.full(n_points, n_shared, dtype=np.int64)
    filled = np.diff(weighted.indptr) > 0
    weighted.sort_indices()
    first[filled] = weighted.indices[weighted.indptr[:-1][filled]]
    order = np.argsort(first, kind="stable")
    x, y = basis.box.phases(xy)
    waves = np.empty((_AT_ONCE, basis.n_modes))
    for start in range(0, n_points, _AT_ONCE):
        here = order[start : start + _AT_ONCE]
        part = weighted[here]
        touched = np.unique(part.indices)
        dense = part[:, touched].toarray()
        fill_waves(x[here], y[here], basis.lattice, amplitudes, waves)
        total[touched] += dense.T @ waves[: len(here)]
    return total


class JointSystem(NamedTuple):
    """Points, waves and shared unknowns of the joint estimate, before it is solved.

    ``strengths`` (K,) are the waves' prior standard deviations [m]; ``noise_m2`` (N,) the points' own variances, and
    ``total_m2`` (N,) those with relief that the waves leave out. ``data`` are the heights above ``datum_m`` with the
    latter; ``rows`` (N, S) and ``information`` (S, S), sparse, are those of `point_rows`.
    """

    shared: SharedError
    landmarks: LandmarkErrors
    basis: FourierBasis
    strengths: FloatArray
    trend: PolynomialTrend
    tail_m2: float
    datum_m: float
    noise_m2: FloatArray
    total_m2: FloatArray
    data: NoisyValues
    rows: Any
    information: Any


def point_rows(
    points: SurfacePoints,
    shared: SharedError,
    trend: PolynomialTrend,
    landmarks: LandmarkErrors,
    cells: SatelliteCells | None,
) -> tuple[Any, Any]:
    """Return the derivatives (N, S) of the points' heights by all shared unknowns, and their prior information (S, S).

    The unknowns are the path's errors, the plane, the landmarks' errors and the cells' common errors, in this order.
    """
    columns = trend.columns(points.xy)
    n_common = 0 if cells is None else len(cells.common)
    rows = side_by_side(shared.rows, columns, landmarks.rows, sparse.csr_array((len(points), n_common)))
    return rows, _with_more(shared.information, columns.shape[1], landmarks.sigma, cells)


def cell_rows(
    cells: SatelliteCells,
    trend: PolynomialTrend,
    waves: FloatArray,
    datum_m: float,
    n_others: tuple[int, int],
) -> Functionals:
    """Return the cells as rows: their waves, the plane at their centres, their common errors; nothing of path and landmarks."""
    n_path, n_landmarks = n_others
    nothing = [sparse.csr_array((len(cells), n)) for n in (n_path, n_landmarks)]
    rows = side_by_side(nothing[0], trend.columns(cells.centre), nothing[1], cells.common_rows)
    return Functionals(waves, rows, cells.height - datum_m, cells.covariance)


def _with_more(information: Any, n_plane: int, landmarks: FloatArray, cells: SatelliteCells | None) -> Any:
    """Return the prior information with that of the plane, which is none, of the landmarks' and of the cells' common errors."""
    own = np.r_[np.zeros(n_plane), landmarks**-2.0]
    if cells is not None:
        own = np.r_[own, cells.common_sigma**-2.0]
    blocks: Any = [information, sparse.diags_array(own)]
    return sparse.csr_array(sparse.block_diag(blocks))
