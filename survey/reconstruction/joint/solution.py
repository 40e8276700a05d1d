"""Solution of the joint estimate: heights, slopes and covariances of the terrain, correction of the path, and the record.

`JointSolution` is the estimate with one kernel; on a grid it becomes a `JointMap`. `MapAverage` corrects the map for
what is uncertain about the kernel: it is the average of coarse maps with several kernels. `mixture` gives mean and standard
deviation of two normal distributions.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from survey.core import FloatArray
from survey.data import Dem, Grid, SurfacePoints
from survey.data.path_error import POSE, PathError
from survey.reconstruction.checks import HeldOut
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.regression import PolynomialTrend
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters
from survey.reconstruction.joint.drives import PathCorrection
from survey.reconstruction.joint.normal_equations import JointPosterior, TerrainPosterior, unit_rows
from survey.reconstruction.joint.satellite_cells import SatelliteCells
from survey.reconstruction.joint.shared_errors import LandmarkErrors, SharedError, side_by_side
from survey.reconstruction.terrain_map import ELEVATION, Reconstruction, support_codes


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
        for k, one in enumerate(cells.common):
            facts[f"satellite_{one.name}"] = float(value[k])
            facts[f"satellite_{one.name}_sigma"] = float(np.sqrt(covariance[k, k]))
        offsets = [k for k, one in enumerate(cells.common) if one.is_offset]
        if offsets:
            facts["satellite_offset_m"] = float(value[offsets].sum())
            facts["satellite_offset_m_sigma"] = float(np.sqrt(covariance[np.ix_(offsets, offsets)].sum()))
        return facts

    @property
    def _n_shared(self) -> int:
        return len(self.posterior.shared)
