r"""Gaussian Markov random field on a lattice: information of the points, likelihood of the stiffness, and posterior.

The prior of the heights z about a plane is that of a thin plate on an elastic bed,

.. math::  E(z) = \tfrac{\kappa}{2} \int \big( (k^2 - \Delta) z \big)^2 dA, \qquad k = \sqrt 8 / \rho

a Gaussian field of Matérn smoothness 1 (Lindgren, Rue and Lindström 2011): κ is the
stiffness, without a unit, and ρ the range [m] at which the correlation has fallen to about 0.1.

`Information` holds the points of all scans, summed into a stencil to which more can be added. `likeliest_stiffness` estimates
stiffness, range and the scale of the sensor's errors by maximum likelihood on patches of the lattice. `FieldPosterior`
gives heights, their standard deviation, and surfaces drawn from the posterior.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import cho_solve_banded, solve_banded
from scipy.optimize import minimize_scalar

from survey.core import FloatArray, InputError, stream
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.multigrid import Operator
from survey.reconstruction.lattice.solver import (
    FREE,
    Ceiling,
    Rim,
    VCyclePreconditioner,
    band_cholesky,
    band_of,
    exact_variance,
    log_determinant,
    solve,
    solve_below,
)
from survey.reconstruction.lattice.stencil import (
    EAST,
    NORTH,
    NORTH_EAST,
    NORTH_WEST,
    Draws,
    Weights,
    add_moments,
    add_moments_of_sums,
    add_points,
    apply,
    prior_noise,
)
from survey.reconstruction.nodes import NodeWindow


@dataclass(eq=False)
class Information:
    r"""The data's part of the posterior, in information form.

    A point at lattice coordinates (u, v) sees the surface through the four weights h of
    bilinear interpolation, so scans add up, whatever their order:

    .. math::  S = \sum_i h_i h_i^T / \sigma_i^2, \qquad b = \sum_i h_i z_i / \sigma_i^2

    `stencil` (5, H, W): S as each node's own weight and its couplings east, north, north-east, north-west.
    `rhs` (H, W): b, of heights above the local datum. `draws` (H, W, K): K sums of measurement errors drawn
    at random; their covariance is S. `moments` (3, 4): Σ w t tᵀ and Σ w t z with t = (1, u, v): what the best
    plane is made of. `n_points`: how many points are in it.
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
        add_points(points, self.stencil, self.rhs, self.draws, self.n_points)
        add_moments(points, self.moments)

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
        add_moments_of_sums(stencil, rhs, moments)
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


# Patches of nodes from which it is learned: the ones with most points, side by side.
PATCH_NODES = 32
"""Nodes along a side of a patch."""
_N_PATCHES = 6
_LEAST_POINTS = 60
_RANGES_IN_STEPS = (400.0, 80.0, 40.0, 20.0, 10.0)
_NOISE_FACTORS = (0.05, 10.0)
_LOG_WIDTH_FIRST, _LOG_WIDTH_LATER = 7.0, 1.5


class Stiffness(NamedTuple):
    """The prior of the surface and the scale of the errors."""

    stiffness: float
    """κ, without a unit."""
    range_m: float
    """ρ: where the correlation has fallen to about 0.1 [m]."""
    noise_factor: float = 1.0
    """Standard deviation of the points over what they state."""

    def weights(self, step_m: float) -> Weights:
        """Return the weights of plate, membrane and mass on a lattice [1/m²]."""
        k_squared = 8.0 / self.range_m**2
        plate = self.stiffness / step_m**2
        return plate, 2.0 * self.stiffness * k_squared, self.stiffness * k_squared**2 * step_m**2

    def prior_std_m(self) -> float:
        """Return the standard deviation of a height about the plane where nothing is known [m]."""
        return float(self.range_m / np.sqrt(32.0 * np.pi * self.stiffness))


class LatticeLikelihood:
    """The likelihood of points on a small lattice, as a function of stiffness and range.

    `points` (N, 4): lattice coordinates, height [m] and weight [1/m²]. `shape` (2,) int: rows and columns of
    the lattice. `step_m`: distance between its nodes [m].
    """

    def __init__(self, points: FloatArray, shape: tuple[int, int], step_m: float) -> None:
        self._step_m = step_m
        information = Information.empty(shape, 0)
        information.add(points)
        plane = information.plane()
        height = points[:, 2] - (plane[0] + points[:, :2] @ plane[1:])
        information = Information.empty(shape, 0)
        information.add(np.column_stack([points[:, :2], height, points[:, 3]]))
        self._rhs = information.rhs.ravel()
        self.n_points, self._energy = len(points), float(np.sum(points[:, 3] * height**2))
        self._data_band = band_of(Operator(information.stencil, (0.0, 0.0, 0.0)))

    def __call__(self, log_ratio: float, range_m: float) -> tuple[float, float]:
        r"""Return the two parts of the likelihood that know the heights.

        With the ratio λ = κ s² of stiffness and squared noise factor,

        .. math::  2 \log p = \underbrace{m \log\lambda + \log|Q_0| - \log|\lambda Q_0 + S|}_D
            - N \log s^2 - F / s^2 + \mathrm{const}

        where :math:`F = z^T R^{-1} z - b^T (\lambda Q_0 + S)^{-1} b`, m counts the nodes, and Q₀ is the
        prior's matrix at κ = 1. Returned are D and F.
        """
        band, log_prior = _prior_band(range_m, self._step_m)
        factor = band_cholesky(self._data_band + np.exp(log_ratio) * band)
        z = cho_solve_banded((factor, True), self._rhs, check_finite=False)
        misfit = max(self._energy - float(np.sum(self._rhs * z)), 1e-12)
        return band.shape[1] * log_ratio + log_prior - log_determinant(factor), misfit


@lru_cache(maxsize=32)
def _prior_band(range_m: float, step_m: float) -> tuple[FloatArray, float]:
    """Return the prior's matrix on a patch at κ = 1, as a band, and its log determinant."""
    nothing = np.zeros((1, PATCH_NODES, PATCH_NODES))
    band = band_of(Operator(nothing, Stiffness(1.0, range_m).weights(step_m)))
    return band, log_determinant(band_cholesky(band))


class _Joint:
    """The likelihood of several patches, at the noise factor that makes it largest."""

    def __init__(self, patches: Sequence[LatticeLikelihood]) -> None:
        self._patches = patches
        self._n = sum(patch.n_points for patch in patches)

    def noise_factor(self, misfit: float) -> float:
        """Return s² = F/N, within bounds."""
        return float(np.clip(np.sqrt(misfit / self._n), *_NOISE_FACTORS))

    def __call__(self, log_ratio: float, range_m: float) -> tuple[float, float]:
        """Return the log likelihood and the noise factor."""
        determinants, misfit = np.sum([patch(log_ratio, range_m) for patch in self._patches], axis=0)
        noise_factor = self.noise_factor(misfit)
        twice = determinants - 2.0 * self._n * np.log(noise_factor) - misfit / noise_factor**2
        return 0.5 * float(twice), noise_factor


def likeliest_stiffness(
    points: FloatArray, step_m: float, start: Stiffness | None = None
) -> Stiffness | None:
    """Return the likeliest stiffness, range and noise factor; None when the points are too few.

    `points` (N, 4): easting and northing [m], height above a local datum [m], weight 1/σ² [1/m²]. `step_m`:
    distance between the lattice's nodes [m].
    """
    patches = [LatticeLikelihood(*patch, step_m) for patch in _fullest(points, step_m)]
    return likeliest_of(patches, [step_m * n for n in _RANGES_IN_STEPS], start) if patches else None


def likeliest_of(
    patches: Sequence[LatticeLikelihood], ranges: Sequence[float], start: Stiffness | None = None
) -> Stiffness:
    """Return the stiffness, range and noise factor that are likeliest on all patches.

    `ranges`: ranges to try [m].
    """
    joint = _Joint(patches)
    if start is None:
        centre, width = np.log(1000.0), _LOG_WIDTH_FIRST
    else:
        centre, width = np.log(start.stiffness * start.noise_factor**2), _LOG_WIDTH_LATER
        k = int(np.argmin(np.abs(np.log(np.array(ranges) / start.range_m))))
        ranges = ranges[max(k - 1, 0) : k + 2]
    _, log_ratio, range_m = max(_likeliest_at(joint, centre, width, range_m) for range_m in ranges)
    noise_factor = joint(log_ratio, range_m)[1]
    return Stiffness(float(np.exp(log_ratio)) / noise_factor**2, range_m, noise_factor)


def _likeliest_at(joint: _Joint, centre: float, width: float, range_m: float) -> tuple[float, float, float]:
    """Return the largest log likelihood at one range, the logarithm of κ s² there, and the range."""
    found = minimize_scalar(
        lambda log_ratio: -joint(log_ratio, range_m)[0],
        bounds=(centre - width, centre + width),
        method="bounded",
        options={"xatol": 0.15},
    )
    return -float(found.fun), float(found.x), range_m


def _fullest(points: FloatArray, step_m: float) -> list[tuple[FloatArray, tuple[int, int]]]:
    """Return the points, in lattice coordinates, and the shape of the patches in which most nodes have points."""
    cells = np.floor(points[:, :2] / step_m).astype(np.int64)
    side = PATCH_NODES - 1
    first = cells.min(axis=0)
    patch = (cells - first) // side
    occupied = np.unique(np.column_stack([patch, cells]), axis=0)
    patches, n_cells = np.unique(occupied[:, :2], axis=0, return_counts=True)
    found = []
    for k in np.argsort(-n_cells, kind="stable")[:_N_PATCHES]:
        inside = (patch == patches[k]).all(axis=1)
        if inside.sum() >= _LEAST_POINTS:
            west, south = (first + patches[k] * side).tolist()
            window = NodeWindow(step_m, west, south, PATCH_NODES, PATCH_NODES)
            uv = window.coordinates(points[inside, :2])
            found.append((np.column_stack([uv, points[inside, 2:]]), window.shape))
    return found


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

    `information`: the sums over the points. `z` (H, W): heights above the datum [m]; NaN where no solution
    has reached yet. `soft` (3, H, W): factors on the curvatures, where sharp bends were found.
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
        return np.where(unknown, self._plane(self._all_nodes()), self.z) if unknown.any() else self.z

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
        """Return the standard deviation (H, W) [m]: exact on small maps, from draws on large ones."""
        operator = self._operator(self._all_nodes(), self.information.stencil, window.step_m, stiffness)
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
        operator = self._operator(self._all_nodes(), self.information.stencil, window.step_m, stiffness)
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
            prior_noise(operator.weights, operator.soft, rng.standard_normal((6, *operator.shape)), error)
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

    def _all_nodes(self) -> Part:
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
