"""One estimate for the map and the path: landmarks share the errors of the poses that saw them."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from survey.core.arrays import Bounds, FloatArray, IntArray
from survey.core.geodesy import same_crs, same_vertical_datum
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.path_error import POSE, PathError
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.base import ELEVATION, Reconstruction, local_datum_m
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig, KernelFamily
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend
from survey.reconstruction.gp.engines.resolution import (
    affordable_basis,
    amplitudes,
    modes_within,
    sharpest_std_m,
    tail_variance,
)
from survey.reconstruction.gp.errors_in_variables import variance_through_slope
from survey.reconstruction.gp.selection.families import Hyperparameters, likeliest
from survey.reconstruction.joint.joint_solve import Functionals, JointPosterior, waves_at
from survey.reconstruction.joint.satellite_cells import SatelliteCells
from survey.reconstruction.joint.shared_error import SharedError, bow_levers, dominant_modes, side_by_side
from survey.reconstruction.joint.shared_relief import with_shared_relief
from survey.reconstruction.support import support_codes

CANDIDATES: tuple[KernelFamily, ...] = ("matern-3/2", "two-scale-matern", "two-scale-mixed", "three-scale")
"""What ``family = "auto"`` chooses from. Landforms are smooth, the relief underfoot is not. The third scale is for what lies between landforms and the relief underfoot,
of which landmarks tell so much that two scales go to these, and gaps between swaths would be mapped too boldly."""

_EXTREME = 4.0
# A slope needs fewer waves than a map.
_ROUGH_MB = 12.0
# What is shared by all points is decimetres: waves that matter less than this share of the smallest standard
# deviation are not worth their time.
_COARSEST_SHARE = 0.05


@dataclass(frozen=True)
class PathCorrection:
    """What the map found out about the path: errors (K, 3) [m] at times (K,) [s], and what is still unknown of them."""

    time_s: FloatArray
    shift: FloatArray
    covariance: FloatArray

    def applied(self, trajectory: Trajectory) -> Trajectory:
        """Return the trajectory with its places corrected; what it shared is in the map now and not kept."""
        times = trajectory.time_s
        shift = np.column_stack([np.interp(times, self.time_s, column) for column in self.shift.T])
        entries = [np.interp(times, self.time_s, entry) for entry in self.covariance.reshape(-1, 9).T]
        covariance = np.column_stack(entries).reshape(-1, 3, 3)
        return replace(trajectory, position=trajectory.position - shift, covariance=covariance, error=None)


@dataclass(frozen=True)
class JointMap:
    """A map and the path that goes with it."""

    reconstruction: Reconstruction
    correction: PathCorrection


@dataclass(frozen=True)
class JointTerrain:
    r"""Gaussian-process terrain whose points' errors are correlated by the path they were seen from.

    .. math::  z_l = f(x_l) + W_l \delta + \epsilon_l, \qquad
               \Sigma_z = D + W \Lambda^{-1} W^T

    with f a Gaussian process about a plane, δ the errors of the path's keyframes and W_l
    what the height of a point answers to them: the slope of the terrain for the place,
    the arm from the rover for yaw, pitch and roll. A satellite's cells are measurements of
    means of f, with an offset β of their own. Terrain, path and offset come out of one
    solve: crossings adjust the path, cells its level, and nothing is averaged away that
    landmarks share.

    Parameters
    ----------
    path : PathError
        Posterior of the path from all other sensors.
    satellite : Dem, optional
        Coarse elevations in any grid and CRS, used as measurements and in no other way.
    config : GaussianProcessConfig
        Hyperparameters, or how they are found; the mean is a plane.
    joint : JointConfig
        Errors of the satellite, rank, passes.

    Notes
    -----
    Linear in the path's error: horizontal errors must be small beside the length scale.
    But for the path, points are taken to err independently; relief between the waves that are
    kept is noise that neighbours share, by as much as `with_shared_relief` says.
    """

    path: PathError
    satellite: Dem | None = None
    config: GaussianProcessConfig = field(default_factory=GaussianProcessConfig)
    joint: JointConfig = field(default_factory=JointConfig)

    def map(self, points: SurfacePoints, grid: Grid) -> JointMap:
        """Estimate the terrain on a grid, and the path.

        Raises
        ------
        InputError
            Points that name no keyframe, or those of another path; a satellite model
            elsewhere or above another datum.
        """
        same_crs(points.crs, grid.crs, "the points and the grid")
        return self.solved(points, grid.bounds).on(grid)

    def solved(self, points: SurfacePoints, bounds: Bounds) -> "JointSolution":
        """Solve for the terrain within bounds (xmin, ymin, xmax, ymax) [m], and the path."""
        plane = _plane(points.xy, points.z)
        slope = np.tile(plane[1:], (len(points), 1))
        found = self._hyperparameters(points, slope, plane)
        cells = self._cells(points, bounds)
        if cells is not None and self.joint.satellite.sigma_m is None:
            alone = self._solution(points, bounds, found, slope, None)
            cells = cells.with_sigma(cells.likeliest_sigma_m(*alone.cell_means(cells)))
            slope = alone.gradient(points.xy)
        for _ in range(self.joint.slope_passes - 1):
            slope = self._solution(points, bounds, found, slope, cells).gradient(points.xy)
        return self._solution(points, bounds, found, slope, cells, memory_mb=self.joint.memory_mb)

    @cached_property
    def _modes(self) -> FloatArray:
        assert self.joint.rank is not None
        return dominant_modes(self.path, self.joint.rank)

    def _shared(self, points: SurfacePoints, slope: FloatArray) -> SharedError:
        if self.joint.rank is None:
            return SharedError.full(points, self.path, slope)
        return SharedError.dominant(points, self.path, slope, self._modes)

    def _hyperparameters(
        self, points: SurfacePoints, slope: FloatArray, plane: FloatArray
    ) -> Hyperparameters:
        config, bow = self.config, self._bow_columns(points)
        if not config.fit:
            family = "squared-exponential" if config.family == "auto" else config.family
            return Hyperparameters(family, config.kernel(), config.nugget_m or 0.0, 0.0)
        rows = SharedError.full(points, self.path, slope).rows
        residual = points.z - _columns(points.xy) @ plane
        own = _own_variance(points, slope)

        def shared(part: IntArray) -> FloatArray:
            return self.path.covariance(rows[part]) + (bow[part] * self._bow_rad**2) @ bow[part].T

        return likeliest(points.xy, residual, own, config, shared, candidates=CANDIDATES)

    @property
    def _bow_rad(self) -> float:
        return float(np.radians(self.joint.bow_sigma_deg))

    def _bow_columns(self, points: SurfacePoints) -> FloatArray:
        """Return what the points' heights answer to bowing (N, 2), or nothing (N, 0) where there is none."""
        return bow_levers(points) if self._bow_rad > 0.0 else np.zeros((len(points), 0))

    def _solution(
        self,
        points: SurfacePoints,
        bounds: Bounds,
        found: Hyperparameters,
        slope: FloatArray,
        cells: SatelliteCells | None,
        *,
        memory_mb: float = _ROUGH_MB,
    ) -> "JointSolution":
        shared = self._shared(points, slope)
        noise = _own_variance(points, slope) + shared.rest_m2 + found.nugget_m**2
        datum = local_datum_m(points.z)
        site = NoisyValues.of(points.xy, points.z, np.sqrt(noise)).extent(bounds)
        basis, tail = self._waves(found, site, points.xy, noise, memory_mb)
        total = with_shared_relief(points.xy, noise, found.kernel, basis, tail)
        data = NoisyValues.of(points.xy, points.z - datum, np.sqrt(total))
        trend = PolynomialTrend("plane", basis.box)
        columns, bow = trend.columns(points.xy), self._bow_columns(points)
        has_offset = cells is not None and cells.datum_sigma_m > 0.0
        more = np.column_stack([columns, bow, np.zeros((len(points), int(has_offset)))])
        bowing = np.full(bow.shape[1], self._bow_rad)
        before = shared.rows.shape[1], bow.shape[1]
        strengths = amplitudes(found.kernel, basis)
        posterior = JointPosterior.given(
            basis,
            strengths,
            data,
            (
                side_by_side(shared.rows, more),
                _with_more(shared.information, columns.shape[1], bowing, cells),
            ),
            None
            if cells is None
            else _functionals(cells, trend, cells.features(basis, strengths), datum, before),
        )
        return JointSolution(self, points, found, shared, basis, trend, tail, datum, posterior, cells, noise)

    def _waves(
        self, found: Hyperparameters, site: Bounds, xy: FloatArray, noise: FloatArray, memory_mb: float
    ) -> tuple[FourierBasis, float]:
        """Return the waves that the tolerance asks for, within the memory, and the variance of the others."""
        sharpest = sharpest_std_m(found.kernel, xy, noise)
        tolerance = max(self.config.tolerance_m, _COARSEST_SHARE * sharpest)
        basis = affordable_basis(found.kernel, site, sharpest, tolerance, modes_within(memory_mb))
        return basis, tail_variance(found.kernel, basis)

    def _cells(self, points: SurfacePoints, bounds: Bounds) -> SatelliteCells | None:
        if self.satellite is None:
            return None
        same_vertical_datum(
            self.satellite.vertical_datum, points.vertical_datum, "the satellite and the points"
        )
        return SatelliteCells.of(self.satellite, points.crs, bounds, self.joint.satellite)


@dataclass(frozen=True)
class JointSolution:
    """Terrain and path after one solve."""

    asked: JointTerrain
    points: SurfacePoints
    found: Hyperparameters
    shared: SharedError
    basis: FourierBasis
    trend: PolynomialTrend
    tail_m2: float
    datum_m: float
    posterior: JointPosterior
    cells: SatelliteCells | None
    noise_m2: FloatArray

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the most likely height (M,) [m]."""
        waves = self.basis.box.evaluate(xy, self._coefficients(self.posterior.mean))
        return waves + self.trend.columns(xy) @ self._plane + self.datum_m

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (M, 2) of the most likely surface [m/m]."""
        box, coefficients = self.basis.box, self._coefficients(self.posterior.mean)
        slopes = [box.evaluate(xy, box.derivative(coefficients, axis)) for axis in (0, 1)]
        gradient: FloatArray = np.stack(slopes, axis=-1) + self.trend.gradient @ self._plane
        return gradient

    def cell_means(self, cells: SatelliteCells) -> tuple[FloatArray, FloatArray]:
        """Return the mean heights (C,) of cells [m] and their covariance (C, C) [m²]."""
        waves = cells.features(self.basis, self.posterior.weights.amplitudes)
        columns = self.trend.columns(cells.centre)
        means: FloatArray = waves @ self.posterior.mean + columns @ self._plane + self.datum_m
        return means, self._covariance(waves, columns)

    def covariance(self, xy: FloatArray) -> FloatArray:
        """Return the covariance (M, M) of the heights at places (M, 2) [m²], relief finer than the map included.

        It depends on where points lie and how they err, on no height that was measured.
        """
        waves = waves_at(xy, self.basis, self.posterior.weights.amplitudes)
        covariance = self._covariance(waves, self.trend.columns(xy))
        covariance[np.diag_indices(len(xy))] += self.tail_m2 + self.found.nugget_m**2
        return covariance

    def _covariance(self, waves: FloatArray, columns: FloatArray) -> FloatArray:
        """Return the covariance of functionals of waves (M, m) and plane (M, 3)."""
        posterior = self.posterior
        cross = waves @ posterior.cross_weights(self._plane_rows) @ columns.T
        plane: FloatArray = columns @ posterior.shared_covariance(self._plane_rows) @ columns.T
        return waves @ posterior.seen(waves) + cross + cross.T + plane

    def on(self, grid: Grid) -> JointMap:
        """Return the map on a grid, and the path's correction."""
        mean, std = self._fields(grid)
        nearest = np.asarray(cKDTree(self.points.xy).query(grid.xy)[0]).reshape(grid.shape)
        prior = self.found.kernel.variance_m2 + self.found.nugget_m**2
        codes = support_codes(
            nearest,
            std**2 / prior,
            shortest_length_m=self.found.kernel.length_scales_m[0],
            step_m=grid.step_m,
        )
        datum = self.points.vertical_datum
        result = Reconstruction(
            Dem.on(grid, mean, datum),
            Dem.on(grid, std, datum),
            codes,
            "gp",
            self.hyperparameters(),
            quantity=ELEVATION,
            diagnostics=self.diagnostics(),
        )
        return JointMap(result, self.correction())

    def _fields(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m], relief finer than the map included."""
        box, posterior = self.basis.box, self.posterior
        columns = self.trend.columns(np.stack(np.meshgrid(grid.x, grid.y), axis=-1))
        mean = box.evaluate_on_axes(grid.x, grid.y, self._coefficients(posterior.mean))
        mean += columns @ self._plane + self.datum_m
        variance = box.evaluate_on_axes(grid.x, grid.y, posterior.weights.variance_coefficients())
        plane = self._plane_rows
        cross = posterior.cross_weights(plane)
        fields = [box.evaluate_on_axes(grid.x, grid.y, self._coefficients(c)) for c in cross.T]
        variance += 2.0 * np.sum(columns * np.stack(fields, axis=-1), axis=-1)
        variance += np.einsum("hwi,ij,hwj->hw", columns, posterior.shared_covariance(plane), columns)
        variance += self.tail_m2 + self.found.nugget_m**2
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def correction(self) -> PathCorrection:
        """Return the path's error, as the map found it."""
        path, n_path = self.asked.path, self.shared.poses.shape[1]
        places = np.flatnonzero(np.arange(len(path) * POSE) % POSE < 3)
        nothing = sparse.csr_array((len(places), self._n_shared - n_path))
        rows = side_by_side(self.shared.poses[places], nothing)
        shift = np.asarray(rows @ self.posterior.shared).reshape(-1, 3)
        covariance = self.posterior.shared_blocks(rows, 3)
        if self.asked.joint.rank is not None:
            covariance = path.pose_covariances[0][:, :3, :3]
        return PathCorrection(path.time_s, shift, 0.5 * (covariance + covariance.transpose(0, 2, 1)))

    def hyperparameters(self) -> dict[str, Any]:
        """Return family, parameters and what is assumed of the satellite, for the record."""
        kernel = self.found.kernel
        values = {
            name.removeprefix("log ").replace(" ", "_"): float(np.exp(v))
            if name.startswith("log ")
            else float(v)
            for name, v in zip(kernel.parameter_names, kernel.log_parameters, strict=True)
        }
        return {
            "family": self.found.family,
            **values,
            "nugget_m": self.found.nugget_m,
            "landmark_errors": "joint",
            "satellite": "none" if self.cells is None else "cells as measurements",
        }

    def diagnostics(self) -> dict[str, Any]:
        """Return what was found out about points, path and satellite, for the record."""
        rows = self.shared.rows
        shift = rows @ self.posterior.shared[: rows.shape[1]]
        z_scores = (self.points.z - shift - self.height(self.points.xy)) / np.sqrt(
            self.noise_m2 + self.tail_m2
        )
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
        }
        if self.cells is not None:
            facts["satellite_sigma_m"] = float(np.sqrt(self.cells.covariance[0, 0]))
        if self.cells is not None and self.cells.datum_sigma_m > 0.0:
            last = sparse.csr_array(([1.0], ([0], [self._n_shared - 1])), shape=(1, self._n_shared))
            facts["satellite_offset_m"] = float(self.posterior.shared[-1])
            facts["satellite_offset_sigma_m"] = float(np.sqrt(self.posterior.shared_covariance(last)[0, 0]))
        return facts

    @property
    def _n_shared(self) -> int:
        return len(self.posterior.shared)

    @property
    def _plane_rows(self) -> Any:
        first = self.shared.rows.shape[1]
        columns = first + np.arange(self.trend.n_columns)
        ones = np.ones(len(columns))
        return sparse.csr_array(
            (ones, (np.arange(len(columns)), columns)), shape=(len(columns), self._n_shared)
        )

    @property
    def _plane(self) -> FloatArray:
        first = self.shared.rows.shape[1]
        return self.posterior.shared[first : first + self.trend.n_columns]

    def _coefficients(self, whitened: FloatArray) -> Any:
        return self.basis.coefficients_of(self.basis.doubled(self.posterior.weights.amplitudes) * whitened)


def _functionals(
    cells: SatelliteCells, trend: PolynomialTrend, waves: FloatArray, datum: float, n_others: tuple[int, int]
) -> Functionals:
    """Return the cells as rows: their waves, the plane at their centres, the satellite's offset; nothing of path and bow."""
    n_path, n_bow = n_others
    more = np.column_stack([trend.columns(cells.centre), np.zeros((len(cells), n_bow))])
    if cells.datum_sigma_m > 0.0:
        more = np.column_stack([more, np.ones(len(cells))])
    before = sparse.csr_array((len(cells), n_path))
    return Functionals(waves, side_by_side(before, more), cells.height - datum, cells.covariance)


def _with_more(information: Any, n_plane: int, bowing_rad: FloatArray, cells: SatelliteCells | None) -> Any:
    """Return the prior information with that of the plane, which is none, of the bow and of the satellite's offset."""
    own = np.r_[np.zeros(n_plane), bowing_rad**-2.0]
    if cells is not None and cells.datum_sigma_m > 0.0:
        own = np.r_[own, cells.datum_sigma_m**-2]
    blocks: Any = [information, sparse.diags_array(own)]
    return sparse.csr_array(sparse.block_diag(blocks))


def _own_variance(points: SurfacePoints, slope: FloatArray) -> FloatArray:
    assert points.own_covariance is not None
    return variance_through_slope(points.own_covariance, slope)


def _columns(xy: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(xy)), xy])


def _plane(xy: FloatArray, z: FloatArray) -> FloatArray:
    """Return the plane (3,) of least squares: height at the origin, slope to the east and to the north."""
    middle = xy.mean(axis=0)
    level, *slope = np.linalg.lstsq(_columns(xy - middle), z, rcond=None)[0]
    return np.array([level - np.dot(slope, middle), *slope])
