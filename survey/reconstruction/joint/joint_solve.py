r"""Normal equations of the terrain's weights and everything that landmarks share, solved as one.

With whitened waves φ (weights w ~ N(0, I)), shared unknowns u of prior information Λ, points
``z = φ w + U u + ε`` of independent noise N, and means over cells ``S = ψ w + V u + η`` with
covariance R,

    [ I + ΦᵀN⁻¹Φ + ΨᵀR⁻¹Ψ    B                       ] [w]   [ ΦᵀN⁻¹z + ΨᵀR⁻¹S ]
    [ Bᵀ                       Λ + UᵀN⁻¹U + VᵀR⁻¹V = G ] [u] = [ UᵀN⁻¹z + VᵀR⁻¹S ]

with B = ΦᵀN⁻¹U + ΨᵀR⁻¹V. The points' errors then are N + U Λ⁻¹ Uᵀ, correlated. G is sparse
and goes first; what is left for the weights is the plain engine's matrix less B G⁻¹ Bᵀ, so that
its covariance, and the map of the variance, come out as they do without shared unknowns.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy import sparse
from scipy.linalg import blas

from survey.core.arrays import FloatArray
from survey.core.sparse_factor import SparseFactor
from survey.reconstruction.gp.engines.fourier.mean_solver import PointSums
from survey.reconstruction.gp.engines.fourier.weight_posterior import WeightPosterior, precision
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend
from survey.reconstruction.joint.terrain_posterior import TerrainPosterior, fill_waves

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

        Parameters
        ----------
        trend : PolynomialTrend
            Plane below the waves.
        first : int
            Index of its first coefficient among the shared unknowns.
        datum_m : float
            Height that heights are counted from [m].
        finer_m2 : float
            Variance of the relief that the waves leave out [m²].
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
