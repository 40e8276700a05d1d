r"""Solution of the joint estimate: heights, slopes and covariances of the terrain, correction of the path, and its test.

`JointSolution` is the estimate with one kernel; on a grid it becomes a `JointMap`. `MapAverage` corrects the map for
what is uncertain about the kernel: it is the average of coarse maps with several kernels. `mixture` gives mean and standard
deviation of two normal distributions.

The estimate is cross-validated by leaving out one swath at a time; `swaths_of` divides a drive into swaths by keyframes and
headings. With the rows H of a block, its posterior covariance ``P = H C Hᵀ`` given all points, its noise T and its residuals
r, the estimate without the block errs at the block by

.. math::  e = T (T - P)^{-1} r, \qquad \operatorname{cov} e = T (T - P)^{-1} T

(Sherman, Morrison and Woodbury), so that one solve of all points suffices. Hyperparameters are those of all points.
`checked_map` widens the standard deviation of the map where swaths that were left out contradict it, and states the
posterior of its error.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.spatial import cKDTree

from survey.core import FloatArray, IntArray, stream
from survey.data import Dem, Grid, SurfacePoints, SurveyArea
from survey.data.path_error import POSE, PathError
from survey.reconstruction.beyond_points import widened_beyond
from survey.reconstruction.checks import HeldOut, HeldOutGroups, PredictiveCheck, RmseClaim, sampled_nodes
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.regression import PolynomialTrend
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters
from survey.reconstruction.gp.satellite_cells import SatelliteCells
from survey.reconstruction.joint.drives import PathCorrection
from survey.reconstruction.joint.normal_equations import JointPosterior, TerrainPosterior, unit_rows
from survey.reconstruction.joint.shared_errors import LandmarkErrors, SharedError, side_by_side
from survey.reconstruction.terrain_map import CHECK, CLAIM, ELEVATION, Reconstruction, support_codes


class MapFields(Protocol):
    """Map that gives heights and standard deviations on grids."""

    def fields(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m]."""


def mixture(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray], share: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of a mixture of two normal distributions.

    >>> one, other = (np.zeros(1), np.ones(1)), (np.full(1, 2.0), np.ones(1))
    >>> [values.round(3).tolist() for values in mixture(one, other, 0.5)]
    [[1.0], [1.414]]
    """
    (mean, std), (other, other_std) = first, second
    variance = (1.0 - share) * std**2 + share * other_std**2 + share * (1.0 - share) * (other - mean) ** 2
    return mean + share * (other - mean), np.sqrt(variance)


@dataclass(frozen=True)
class MapAverage:
    """Maps with several kernels, to correct the map with one of them for what is not known of the kernel.

    `reference`: coarse map with the kernel of the map that is corrected. `others`: coarse maps with all
    kernels. `weights` (K,): their probabilities. `held_out`: swaths that the average predicts without their
    points; None where the drive has fewer than two.
    """

    reference: MapFields
    others: tuple[MapFields, ...]
    weights: FloatArray
    held_out: HeldOut | None = None

    def applied(self, grid: Grid, mean: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m] of a map, averaged over the kernels.

        The variance is the mean of the variances and the variance of the means.

        `mean`, `std` (H, W): height and standard deviation with the kernel of the reference [m].
        """
        before, claimed = self.reference.fields(grid)
        every = [one.fields(grid) for one in self.others]
        heights, deviations = (np.array([fields[k] for fields in every]) for k in (0, 1))
        average = np.tensordot(self.weights, heights, axes=1)
        variance = np.tensordot(self.weights, deviations**2 + (heights - average) ** 2, axes=1)
        return mean + average - before, std * np.sqrt(variance) / claimed


_EXTREME = 4.0


class StatedSolution(NamedTuple):
    """Solution with the stated level of a prior that contradicts the points, and the probability that the level holds."""

    solution: "JointSolution"
    probability: float


class JointMap(NamedTuple):
    """A map, the correction of the path that goes with it, and the solution that both were read from."""

    reconstruction: Reconstruction
    correction: PathCorrection
    solution: "JointSolution"


@dataclass(frozen=True)
class JointSolution:
    """Terrain and path after one solve."""

    path: PathError
    has_modes: bool
    points: SurfacePoints
    hyperparameters: Hyperparameters
    shared: SharedError
    basis: FourierBasis
    trend: PolynomialTrend
    tail_m2: float
    datum_m: float
    posterior: JointPosterior
    cells: SatelliteCells | None
    noise_m2: FloatArray
    rows: Any
    total_m2: FloatArray
    landmarks: LandmarkErrors
    conflicts: tuple[str, ...] = ()
    average: MapAverage | None = None
    stated: "StatedSolution | None" = None

    @cached_property
    def terrain(self) -> TerrainPosterior:
        """Posterior of the terrain alone."""
        first = self.shared.rows.shape[1]
        return self.posterior.terrain(self.trend, first, self.datum_m, self.finer_m2)

    @property
    def finer_m2(self) -> float:
        """Variance of the relief that the map leaves out [m²]."""
        return self.tail_m2 + self.hyperparameters.nugget_m**2

    @property
    def residual_m(self) -> FloatArray:
        """What map and path leave of the points' heights (N,) [m]."""
        waves = self.terrain.waves(self.points.xy)
        left: FloatArray = self.points.z - self.datum_m - waves - self.rows @ self.posterior.shared
        return left

    def slopes(self, xy: FloatArray, base_m: float) -> tuple[FloatArray, FloatArray]:
        """Return slopes over a base to the east and to the north (M, 2) [m/m], and their covariance (M, 2, 2).

        A slope is the difference of two heights half a base before and behind the place, over the base; relief
        finer than the map is part of its covariance.
        """
        steps = 0.5 * base_m * np.eye(2)
        waves = [self.terrain.waves_between(xy, step) for step in steps]
        rises, covariance = self.terrain.rises(steps, waves)
        for axis in (0, 1):
            covariance[:, axis, axis] += self._finer_m2(steps[axis], waves[axis])
        return rises / base_m, covariance / base_m**2

    def _finer_m2(self, half: FloatArray, waves: FloatArray) -> FloatArray:
        """Return the variance (M,) of differences of height that the map's waves leave out, nugget included."""
        kernel = self.hyperparameters.kernel
        apart = kernel.covariance_of_lag(np.array([np.zeros(2), 2.0 * half]))
        left: FloatArray = 2.0 * (apart[0] - apart[1]) - np.sum(waves**2, axis=1)
        return np.maximum(left, 0.0) + 2.0 * self.hyperparameters.nugget_m**2

    def on(self, grid: Grid) -> JointMap:
        """Return the map on a grid, and the path's correction."""
        mean, std = self.fields(grid)
        nearest = np.asarray(cKDTree(self.points.xy).query(grid.xy)[0]).reshape(grid.shape)
        prior = self.hyperparameters.kernel.variance_m2 + self.hyperparameters.nugget_m**2
        codes = support_codes(
            nearest,
            std**2 / prior,
            shortest_length_m=self.hyperparameters.kernel.length_scales_m[0],
            step_m=grid.step_m,
        )
        datum = self.points.vertical_datum
        result = Reconstruction(
            Dem.on(grid, mean, datum),
            Dem.on(grid, std, datum),
            codes,
            "gp",
            self.record(),
            quantity=ELEVATION,
            diagnostics=self.diagnostics(),
        )
        return JointMap(result, self.correction(), self)

    def fields(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) on a grid [m], averaged over kernels and levels of the prior."""
        mean, std = self.terrain.fields(grid)
        if self.average is not None:
            mean, std = self.average.applied(grid, mean, std)
        if self.stated is None:
            return mean, std
        return mixture((mean, std), self.stated.solution.fields(grid), self.stated.probability)

    def correction(self) -> PathCorrection:
        """Return the path's error, as the map found it, averaged over levels of the prior."""
        alone = self._correction()
        if self.stated is None:
            return alone
        return alone.mixed(self.stated.solution.correction(), self.stated.probability)

    def _correction(self) -> PathCorrection:
        path, n_path = self.path, self.shared.poses.shape[1]
        places = np.flatnonzero(np.arange(len(path) * POSE) % POSE < 3)
        nothing = sparse.csr_array((len(places), self._n_shared - n_path))
        rows = side_by_side(self.shared.poses[places], nothing)
        shift = np.asarray(rows @ self.posterior.shared).reshape(-1, 3)
        covariance = self.posterior.shared_blocks(rows, 3)
        if self.has_modes:
            covariance = path.pose_covariances[0][:, :3, :3]
        return PathCorrection(path.time_s, shift, 0.5 * (covariance + covariance.transpose(0, 2, 1)))

    def record(self) -> dict[str, Any]:
        """Return family, parameters and what is assumed of the satellite, for the record."""
        return {
            "family": self.hyperparameters.family,
            **self.hyperparameters.kernel.parameters(),
            "nugget_m": self.hyperparameters.nugget_m,
            "landmark_errors": "joint",
            "satellite": "none" if self.cells is None else "cells as measurements",
        }

    def diagnostics(self) -> dict[str, Any]:
        """Return what was found out about points, path and satellite, for the record."""
        rows = self.shared.rows
        shift = rows @ self.posterior.shared[: rows.shape[1]]
        z_scores = self.residual_m / np.sqrt(self.noise_m2 + self.tail_m2)
        facts: dict[str, Any] = {
            "n_points": len(self.points),
            "n_points_beyond_4_sigma": int((np.abs(z_scores) > _EXTREME).sum()),
            "residual_rms_in_sigmas": float(np.sqrt(np.mean(z_scores**2))),
            "path_shift_rms_m": float(np.sqrt(np.mean(shift**2))),
            "engine": {
                "name": "JointPosterior",
                "n_modes": self.basis.n_modes,
                "n_shared": self._n_shared,
                "tail_m": float(np.sqrt(self.tail_m2)),
            },
            **self._landmark_facts(),
        }
        if self.cells is not None:
            facts |= self._prior_facts(self.cells)
        return facts

    def _landmark_facts(self) -> dict[str, float]:
        """Return the estimated errors that all landmarks share, with their standard deviations."""
        first, names = self.shared.rows.shape[1] + self.trend.n_columns, self.landmarks.names
        value, covariance = self._estimated(first, len(names))
        facts = {f"landmark_{name}": float(value[k]) for k, name in enumerate(names)}
        sigmas = {f"landmark_{name}_sigma": float(np.sqrt(covariance[k, k])) for k, name in enumerate(names)}
        return facts | sigmas

    def _estimated(self, first: int, n: int) -> tuple[FloatArray, FloatArray]:
        """Return the estimates (n,) of some shared unknowns, and their covariance (n, n)."""
        rows = unit_rows(first, n, self._n_shared)
        return self.posterior.shared[first : first + n], self.posterior.shared_covariance(rows)

    def _prior_facts(self, cells: SatelliteCells) -> dict[str, Any]:
        """Return the estimated errors of the prior with their standard deviations, and its conflicts with the points."""
        sizes = cells.sizes
        facts: dict[str, Any] = {
            "satellite_sigma_m": sizes.white_m,
            "satellite_sigma_log_sd": sizes.white_log_sd,
            "satellite_correlated_sigma_m": sizes.correlated_m,
            "satellite_correlated_sigma_log_sd": sizes.correlated_log_sd,
            "satellite_correlation_m": sizes.correlation_m,
            "prior_conflicts": list(self.conflicts),
            **({} if self.stated is None else {"prior_level_probability": self.stated.probability}),
        }
        value, covariance = self._estimated(self._n_shared - len(cells.common), len(cells.common))
        facts |= cells.common_facts(value, covariance)
        return facts

    @property
    def _n_shared(self) -> int:
        return len(self.posterior.shared)


# A swath ends where the heading has turned by more than this from that of its beginning [rad].
_TURN_RAD = np.radians(50.0)
# A swath is left out in pieces of at most this share of all points, and of at most so many points.
_LARGEST_SHARE, _LARGEST_PIECE = 0.3, 1000
# Runs with fewer points are turns, and are never left out.
_N_LEAST = 15


class Swaths(NamedTuple):
    """Numbers of the swath from which points were seen (N,), -1 for points of short runs; and whether some are parts."""

    number: IntArray
    are_parts: bool


def swaths_of(points: SurfacePoints) -> Swaths:
    """Return the swath from which each point was seen.

    Points are ordered by their keyframes. A swath is a run without a turn; runs that hold more than three
    tenths of all points, or more than 1,000, are cut into equal parts.

    >>> heading = np.repeat([0.0, 1.57, 3.14], [40, 2, 40])
    >>> line = SurfacePoints(
    ...     np.zeros((82, 3)), covariance=np.tile(np.eye(3), (82, 1, 1)), own_covariance=np.tile(np.eye(3), (82, 1, 1)),
    ...     keyframe=np.arange(82.0), heading_rad=heading, body=np.zeros((82, 3)), crs="EPSG:32608")
    >>> np.unique(swaths_of(line).number, return_counts=True)[1].tolist()
    [2, 20, 20, 20, 20]
    """
    assert points.keyframe is not None
    assert points.heading_rad is not None
    order = np.argsort(points.keyframe, kind="stable")
    swath = np.full(len(points), -1, dtype=np.int64)
    n_swaths, are_parts = 0, False
    for run in _runs(points.heading_rad[order]):
        rows = order[run]
        if len(rows) < _N_LEAST:
            continue
        most = min(max(_LARGEST_SHARE * len(points), _N_LEAST), _LARGEST_PIECE)
        n_pieces = int(np.ceil(len(rows) / most))
        are_parts |= n_pieces > 1
        for piece in np.array_split(rows, n_pieces):
            swath[piece] = n_swaths
            n_swaths += 1
    return Swaths(swath, are_parts)


def groups_of(xy: FloatArray, most: int) -> list[IntArray]:
    """Return the rows of groups of neighbours, by halving the points along their longer extent.

    `xy` (N, 2): places [m].

    >>> [rows.tolist() for rows in groups_of(np.array([[0.0, 0.0], [9.0, 0.0], [1.0, 0.0], [8.0, 0.0]]), 2)]
    [[0, 2], [3, 1]]
    """
    found, waiting = [], [np.arange(len(xy))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= most:
            found.append(rows)
            continue
        axis = int(np.argmax(np.ptp(xy[rows], axis=0)))
        rows = rows[np.argsort(xy[rows, axis], kind="stable")]
        waiting += [rows[len(rows) // 2 :], rows[: len(rows) // 2]]
    return found


def _runs(heading_rad: FloatArray) -> list[slice]:
    """Return runs of headings that stay within a turn of that at their beginning."""
    starts, first = [0], heading_rad[0]
    for k, heading in enumerate(heading_rad):
        if abs((heading - first + np.pi) % (2.0 * np.pi) - np.pi) > _TURN_RAD:
            starts.append(k)
            first = heading
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(heading_rad)], strict=True)]


# Points that are left out in total.
_MOST_POINTS = 2000
# Points whose errors are averaged, and groups of a swath.
_GROUP, _MOST_GROUPS = 12, 100
# Share of the noise that is left to a direction in which only the block itself is informative.
_LEAST_SHARE = 1e-9


class _Block(NamedTuple):
    """Rows, errors and variances of one block (N_B,); means of groups of it, and what their covariance with other blocks needs."""

    rows: IntArray
    error_m: FloatArray
    variance_m2: FloatArray
    averages: FloatArray
    own_m2: FloatArray
    waves: FloatArray
    seen_waves: FloatArray
    shared: FloatArray
    seen_shared: FloatArray

    def with_other(self, other: "_Block") -> FloatArray:
        """Return the covariance of the group means' errors with those of another block."""
        return -(self.waves @ other.seen_waves + self.shared @ other.seen_shared)


def check_by_swaths(solution: JointSolution) -> PredictiveCheck | None:
    """Test the joint estimate by leaving out one swath at a time; None where the drive has fewer than two."""
    held_out = held_out_swaths(solution)
    return None if held_out is None else PredictiveCheck.of(held_out)


def held_out_swaths(solution: JointSolution) -> HeldOut | None:
    """Predict swaths that are left out one at a time; None where the drive has fewer than two."""
    if solution.average is not None:
        return solution.average.held_out
    swaths = swaths_of(solution.points)
    blocks = _choose(swaths.number)
    if len(blocks) < 2:
        return None
    solved = [_solve_block(solution, rows) for rows in blocks]
    rows = np.concatenate([block.rows for block in solved])
    relief_m2 = solution.tail_m2 + solution.hyperparameters.nugget_m**2
    variance = np.concatenate([block.variance_m2 for block in solved]) + relief_m2
    distance = np.concatenate([_distance_to_others(solution.points.xy, block.rows) for block in solved])
    error = np.concatenate([block.error_m for block in solved])
    noise = solution.noise_m2[rows] - solution.hyperparameters.nugget_m**2
    averages = block_diag(*(block.averages for block in solved))
    covariance = np.block([[a.own_m2 if a is b else a.with_other(b) for b in solved] for a in solved])
    own = averages**2 @ noise
    predicted = np.maximum(np.diag(covariance) - own, 0.0)
    groups = HeldOutGroups(averages @ error, predicted, own, averages @ distance, covariance)
    kind = "parts of swaths" if swaths.are_parts else "swaths"
    return HeldOut(kind, len(solved), error, variance, noise, distance, groups)


def averaged(
    solutions: Iterable[tuple[Hyperparameters, JointSolution]],
    found: Hyperparameters,
    rivals: list[Hyperparameters],
    weights: FloatArray,
) -> MapAverage:
    """Return maps with all probable kernels, and the swaths that they predict together.

    `solutions`: coarse solutions with the kernel that was found and all rivals. `weights` (K,): probabilities of the
    rivals.
    """
    maps: dict[Hyperparameters, TerrainPosterior] = {}
    left_out: dict[Hyperparameters, HeldOut | None] = {}
    for one, solution in solutions:
        maps[one] = solution.terrain
        if one in rivals:
            left_out[one] = held_out_swaths(solution)
    predicted = [held_out for one in rivals if (held_out := left_out[one]) is not None]
    held_out = HeldOut.mixture(predicted, weights) if predicted else None
    return MapAverage(maps[found], tuple(maps[one] for one in rivals), weights, held_out)


def _choose(swath: IntArray) -> list[IntArray]:
    """Return the rows of swaths to leave out, the same ones always, up to the number of points that can be left out."""
    names, counts = np.unique(swath[swath >= 0], return_counts=True)
    order = stream(0, "swaths left out").permutation(len(names))
    total = np.cumsum(counts[order])
    taken = order[(total <= _MOST_POINTS) | (np.arange(len(order)) < 2)]
    return [np.flatnonzero(swath == names[k]) for k in np.sort(taken)]


def _solve_block(solution: JointSolution, rows: IntArray) -> _Block:
    """Return errors and covariance of one block, predicted without it."""
    posterior, points = solution.posterior, solution.points
    noise = solution.total_m2[rows]
    shared = solution.rows[rows]
    waves = solution.terrain.waves_at(points.xy[rows]) - shared @ posterior.reach
    seen = posterior.seen(waves)
    known = waves @ seen + _known_shared(posterior.factor, shared)
    residual = solution.residual_m[rows]
    half = np.sqrt(noise)
    left = np.eye(len(rows)) - 0.5 * (known + known.T) / np.outer(half, half)
    left[np.diag_indices(len(rows))] += _LEAST_SHARE
    factor = cho_factor(left, lower=True, check_finite=False)
    # Whitened by the noise, the error is (1 - P)⁻¹ r and its covariance (1 - P)⁻¹.
    covariance = cho_solve(factor, np.eye(len(rows)))
    error = half * cho_solve(factor, residual / half)
    averages = _averages(points.xy[rows])
    reach = (averages * half) @ covariance / half
    variance = noise * np.diag(covariance) - noise
    rest = solution.noise_m2[rows] + solution.tail_m2 - noise
    shared_reach = np.asarray((shared.T @ reach.T).T)
    own = (reach * noise) @ averages.T + (averages * rest) @ averages.T
    return _Block(
        rows,
        error,
        np.maximum(variance, 0.0),
        averages,
        own,
        reach @ waves,
        seen @ reach.T,
        shared_reach,
        posterior.factor.solve(np.ascontiguousarray(shared_reach.T)),
    )


def _averages(xy: FloatArray) -> FloatArray:
    """Return the weights (K, N) of means over groups of neighbours."""
    groups = groups_of(xy, max(_GROUP, int(np.ceil(2.0 * len(xy) / _MOST_GROUPS))))
    weights = np.zeros((len(groups), len(xy)))
    for k, rows in enumerate(groups):
        weights[k, rows] = 1.0 / len(rows)
    return weights


def _known_shared(factor: Any, rows: Any) -> FloatArray:
    """Return ``U G⁻¹ Uᵀ`` (N, N) for sparse rows U (N, S), by the few columns that they touch."""
    touched = np.unique(rows.indices)
    columns = np.zeros((rows.shape[1], len(touched)))
    columns[touched, np.arange(len(touched))] = 1.0
    part = rows[:, touched]
    covariance: FloatArray = part @ (part @ factor.solve(columns)[touched]).T
    return covariance


def _distance_to_others(xy: FloatArray, rows: IntArray) -> FloatArray:
    others = np.ones(len(xy), dtype=bool)
    others[rows] = False
    return np.asarray(cKDTree(xy[others]).query(xy[rows])[0], dtype=np.float64)


def checked_map(solution: JointSolution, grid: Grid, area: SurveyArea | None, *, is_tested: bool) -> JointMap:
    """Return the map on a grid, its standard deviation widened where swaths that were left out contradict it."""
    mapped = solution.on(grid)
    check = check_by_swaths(solution) if is_tested else None
    result = mapped.reconstruction if check is None else _widen(mapped.reconstruction, check, solution)
    if is_tested and solution.cells is None:
        result = widened_beyond(result, solution.points.xy, solution.points.z, area)
    claim = _claim(solution, result, area)
    if check is not None:
        claim = replace(claim, untested_share=_untested_share(solution, result, check, area))
    facts: dict[str, Any] = {} if check is None else {CHECK: check.facts()}
    diagnostics = {**result.diagnostics, **facts, CLAIM: claim.facts()}
    return mapped._replace(reconstruction=replace(result, diagnostics=diagnostics))


def _widen(result: Reconstruction, check: PredictiveCheck, solution: JointSolution) -> Reconstruction:
    """Return the map with the standard deviations that the check leaves standing."""
    if not check.contradicts:
        return result
    grid = result.mean.grid()
    distance = np.asarray(cKDTree(solution.points.xy).query(grid.xy)[0], dtype=np.float64)
    std: FloatArray = result.std.elevation * check.factor_at(distance).reshape(grid.shape)
    return replace(result, std=Dem.on(grid, std, result.std.vertical_datum))


def _untested_share(
    solution: JointSolution, result: Reconstruction, check: PredictiveCheck, area: SurveyArea | None
) -> float:
    """Return the share of the ground that lies farther from all points than the farthest third of those left out."""
    xy = result.mean.grid().xy
    inside = np.ones(len(xy), dtype=bool) if area is None else area.contains(xy)
    distance = np.asarray(cKDTree(solution.points.xy).query(xy[inside])[0], dtype=np.float64)
    return float(np.mean(distance > max(check.distance_m))) if inside.any() else 0.0


def _claim(solution: JointSolution, result: Reconstruction, area: SurveyArea | None) -> RmseClaim:
    grid = result.mean.grid()
    inside = np.ones(grid.shape, dtype=bool)
    if area is not None:
        inside = area.contains(grid.xy).reshape(grid.shape)
    rows = sampled_nodes(inside if inside.any() else np.ones_like(inside))
    return RmseClaim.of(solution.terrain.covariance(grid.xy[rows]), result.std.elevation.ravel()[rows])
