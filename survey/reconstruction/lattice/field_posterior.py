"""The posterior of a field lattice: heights, their standard deviation, and surfaces drawn from it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import solve_banded

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.information import Information, plane_heights
from survey.reconstruction.lattice.multigrid import stencil as kernel
from survey.reconstruction.lattice.multigrid.banded import band_cholesky, band_of, exact_variance
from survey.reconstruction.lattice.multigrid.obstacle import Ceiling, solve_below
from survey.reconstruction.lattice.multigrid.solver import FREE, Operator, Rim, VCyclePreconditioner, solve
from survey.reconstruction.lattice.stiffness import Stiffness
from survey.reconstruction.nodes import NodeWindow

# Up to so many multiplications the inverse's diagonal is computed exactly.
_EXACT_WORK = 6e8
_DRAW_TOLERANCE = 0.05
# Rows of the rim that a window holds fixed: the thin plate reaches so far.
_REACH = 2
_N_SOFTENINGS = 3
# Degrees of freedom of Student's distribution of the bends.
_FREEDOM = 4.0
# How exactly a ceiling is known, and how far beyond that a surface may be held above it by its points.
_CEILING_SIGMA_M, _YIELD_SIGMAS = 0.02, 3.0


class Part(NamedTuple):
    """Rows and columns of a map."""

    rows: slice
    columns: slice

    @classmethod
    def about(cls, row: int, column: int, n: int, shape: tuple[int, int]) -> Self:
        """Return n rows and columns about a node, moved so that they lie on a map of this shape."""
        south = int(np.clip(row - n // 2, 0, max(shape[0] - n, 0)))
        west = int(np.clip(column - n // 2, 0, max(shape[1] - n, 0)))
        return cls(slice(south, min(south + n, shape[0])), slice(west, min(west + n, shape[1])))

    def rim(self, shape: tuple[int, int]) -> Rim:
        """Return what is held fixed: two nodes wherever the map goes on."""
        edges = (
            self.rows.start > 0,
            self.rows.stop < shape[0],
            self.columns.start > 0,
            self.columns.stop < shape[1],
        )
        return Rim(*(_REACH * int(edge) for edge in edges))


@dataclass(eq=False)
class FieldPosterior:
    """Heights of the nodes given the points.

    Parameters
    ----------
    information : Information
        The sums over the points.
    z : (H, W) ndarray
        Heights above the datum [m]; NaN where no solution has reached yet.
    soft : (3, H, W) ndarray or None
        Factors on the curvatures, where sharp bends were found.
    """

    information: Information
    z: FloatArray
    soft: FloatArray | None = None

    @classmethod
    def empty(cls, shape: tuple[int, int], n_draws: int) -> Self:
        """Return the prior."""
        return cls(Information.empty(shape, n_draws), np.full(shape, np.nan))

    def carried(self, new: NodeWindow, old: NodeWindow) -> "FieldPosterior":
        """Return the same on another window."""
        soft = None if self.soft is None else new.carried(self.soft, old, 1.0)
        information = self.information.carried(new, old, self.heights())
        return FieldPosterior(information, new.carried(self.z, old, np.nan), soft)

    def heights(self) -> FloatArray:
        """Return the heights (H, W) above the datum [m]; the best plane where no solution has reached yet."""
        unknown = np.isnan(self.z)
        return np.where(unknown, self._plane(self._whole()), self.z) if unknown.any() else self.z

    def solve(
        self,
        part: Part,
        step_m: float,
        stiffness: Stiffness,
        config: FieldLatticeConfig,
        ceiling: FloatArray | None = None,
    ) -> int:
        """Solve a part of the map, its rim held fixed, and below a ceiling (H, W) of that part [m] if there is one.

        Return the number of iterations.
        """
        stencil, rhs = self.information.part(*part)
        plane = self._plane(part)
        data = Operator(stencil, (0.0, 0.0, 0.0))
        rhs = rhs - data.apply(plane)
        z = self.z[part]
        above = np.where(np.isnan(z), 0.0, z - plane)
        rim = part.rim(self.z.shape)
        n_iterations = 0
        for _ in range(_N_SOFTENINGS if config.edge_preserving else 1):
            operator = self._operator(part, stencil, step_m, stiffness)
            if ceiling is None:
                by = VCyclePreconditioner(operator, rim)
                above, n = solve(operator, rhs, above, tolerance=config.tolerance, preconditioner=by)
            else:
                spring = stiffness.noise_factor**2 / _CEILING_SIGMA_M**2
                low = Ceiling(ceiling - plane, spring, _YIELD_SIGMAS * _CEILING_SIGMA_M)
                above, n = solve_below(operator, rhs, above, low, tolerance=config.tolerance, rim=rim)
            n_iterations += n
            if config.edge_preserving:
                self._soften(part, above, stiffness.weights(step_m)[0])
        self.z[part] = above + plane
        return n_iterations

    def std(self, window: NodeWindow, stiffness: Stiffness) -> FloatArray:
        """Return the standard deviation (H, W) [m]: exact on small maps, from draws on large ones.

        Raises
        ------
        InputError
            When the map is large and was to keep no draws.
        """
        operator = self._operator(self._whole(), self.information.stencil, window.step_m, stiffness)
        if is_small(operator.shape):
            variance = exact_variance(operator)
        else:
            rng = stream(0, "field lattice", "standard deviation")
            deviations = self._deviations(operator, self._kept_draws(), rng)
            variance = np.zeros(operator.shape)
            for deviation in deviations:
                variance += deviation**2 / self.information.draws.shape[2]
        return stiffness.noise_factor * np.sqrt(variance)

    def samples(
        self, window: NodeWindow, stiffness: Stiffness, n: int, rng: np.random.Generator
    ) -> FloatArray:
        """Return n surfaces (n, H, W) above the datum [m], drawn from the posterior."""
        operator = self._operator(self._whole(), self.information.stencil, window.step_m, stiffness)
        if is_small(operator.shape):
            deviations: Iterator[FloatArray] = _exact_deviations(operator, n, rng)
        else:
            deviations = self._deviations(operator, self._mixed_draws(n, rng), rng)
        heights = self.heights()
        return np.stack([heights + stiffness.noise_factor * deviation for deviation in deviations])

    def _operator(self, part: Part, stencil: FloatArray, step_m: float, stiffness: Stiffness) -> Operator:
        """Return the posterior's matrix in units of the stated errors: κ s² Q₀ + S."""
        ratio = stiffness._replace(stiffness=stiffness.stiffness * stiffness.noise_factor**2)
        weights = ratio.weights(step_m)
        if self.soft is None:
            return Operator(stencil, weights)
        return Operator(stencil, weights, np.ascontiguousarray(self.soft[:, part.rows, part.columns]))

    def _soften(self, part: Part, z: FloatArray, plate: float) -> None:
        """Give every bend the weight that Student's distribution gives it."""
        if self.soft is None:
            self.soft = np.ones((3, *self.z.shape))
        bends = np.zeros((3, *z.shape))
        bends[0, :, 1:-1] = z[:, :-2] - 2.0 * z[:, 1:-1] + z[:, 2:]
        bends[1, 1:-1] = z[:-2] - 2.0 * z[1:-1] + z[2:]
        bends[2, :-1, :-1] = z[:-1, :-1] - z[:-1, 1:] - z[1:, :-1] + z[1:, 1:]
        self.soft[:, part.rows, part.columns] = (_FREEDOM + 1.0) / (_FREEDOM + plate * bends**2)

    def _deviations(
        self, operator: Operator, errors: Iterator[FloatArray], rng: np.random.Generator
    ) -> Iterator[FloatArray]:
        """Yield draws of the posterior's deviation: A⁻¹ times noise whose covariance is A."""
        by = VCyclePreconditioner(operator, FREE)
        start = np.zeros(operator.shape)
        for error in errors:
            kernel.prior_noise(
                operator.weights, operator.soft, rng.standard_normal((6, *operator.shape)), error
            )
            yield solve(operator, error, start, tolerance=_DRAW_TOLERANCE, preconditioner=by).z

    def _kept_draws(self) -> Iterator[FloatArray]:
        draws = self.information.draws
        if draws.shape[2] == 0:
            raise InputError(
                f"a map of {draws.shape[0]} × {draws.shape[1]} nodes that keeps no draws has no standard deviation; set n_draws."
            )
        return (draws[:, :, k].astype(np.float64) for k in range(draws.shape[2]))

    def _mixed_draws(self, n: int, rng: np.random.Generator) -> Iterator[FloatArray]:
        self._kept_draws()
        draws = self.information.draws
        mixing = rng.standard_normal((n, draws.shape[2])) / np.sqrt(draws.shape[2])
        return ((draws @ mix.astype(np.float32)).astype(np.float64) for mix in mixing)

    def _plane(self, part: Part) -> FloatArray:
        return plane_heights(self.information.plane(), part.rows, part.columns)

    def _whole(self) -> Part:
        rows, columns = self.z.shape
        return Part(slice(0, rows), slice(0, columns))


def is_small(shape: tuple[int, int]) -> bool:
    """Return whether the exact inverse's diagonal is cheap."""
    rows, columns = shape
    return rows * columns * (_REACH * columns) ** 2 <= _EXACT_WORK


def _exact_deviations(operator: Operator, n: int, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Yield draws with the covariance A⁻¹: normal numbers behind the transposed Cholesky factor."""
    factor = band_cholesky(band_of(operator))
    width, n_nodes = factor.shape[0] - 1, factor.shape[1]
    upper = np.zeros_like(factor)
    for d in range(width + 1):
        upper[width - d, d:] = factor[d, : n_nodes - d]
    for normals in rng.standard_normal((n, n_nodes)):
        deviation: FloatArray = solve_banded((0, int(width)), upper, normals)
        yield deviation.reshape(operator.shape)
