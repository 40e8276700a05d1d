"""Joint estimate of map and path: kernel, prior and slope in turn, each with one solve of the linear system.

`JointTerrain` is the estimate. `SystemBuilder.build` chooses the waves, and sets up the rows and errors of the points;
`SystemBuilder.solve` adds the cells of a prior and solves for terrain, path and shared errors at once.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np

from survey.core import Bounds, FloatArray, same_crs
from survey.data import Dem, Grid, PathError, SurfacePoints, SurveyArea
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.gp.engines.fourier_basis import (
    FourierBasis,
    affordable_basis,
    amplitudes,
    modes_within,
    periodic_variance,
    sharpest_std_m,
)
from survey.reconstruction.gp.engines.regression import NoisyValues, PolynomialTrend
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters
from survey.reconstruction.gp.satellite_cells import SatelliteCells, prior_cells
from survey.reconstruction.joint.kernel_choice import (
    ChosenKernel,
    PlaneResiduals,
    PointsOnly,
    choose_kernel,
    own_variance,
    probable,
)
from survey.reconstruction.joint.normal_equations import JointPosterior, JointSystem, cell_rows, point_rows
from survey.reconstruction.joint.shared_errors import (
    LandmarkErrors,
    PlaceError,
    SharedError,
    dominant_modes,
    with_shared_relief,
)
from survey.reconstruction.joint.solution import (
    JointMap,
    JointSolution,
    MapAverage,
    StatedSolution,
    averaged,
    checked_map,
)
from survey.reconstruction.terrain_model import local_datum_m

# A slope needs fewer waves than a map.
_ROUGH_MB = 12.0
# Waves that contribute less than this share of the smallest standard deviation are left out.
_COARSEST_SHARE = 0.05


@dataclass(frozen=True)
class SystemBuilder:
    """Builder of the linear system of map and path.

    `path`: posterior of the path from all other sensors. `config`: tolerance of the map. `joint`: rank of the path's
    error, and errors that all landmarks share.
    """

    path: PathError
    config: GaussianProcessConfig = field(default_factory=GaussianProcessConfig)
    joint: JointConfig = field(default_factory=JointConfig)

    def landmarks(self, points: SurfacePoints) -> LandmarkErrors:
        """Return the errors that landmarks share beyond the path."""
        drive = None if points.keyframe is None else self.path.drive_of(points.keyframe)
        return LandmarkErrors.of(points, self.joint, drive)

    def highest_rad_per_m(self, points: SurfacePoints) -> float:
        """Return the highest angular frequency that the path's horizontal error leaves in the map [rad/m]."""
        return PlaceError.of(points, self.path).highest_rad_per_m

    def build(
        self,
        points: SurfacePoints,
        bounds: Bounds,
        found: Hyperparameters,
        slope: FloatArray,
        cells: SatelliteCells | None = None,
        *,
        memory_mb: float = _ROUGH_MB,
        basis: FourierBasis | None = None,
    ) -> JointSystem:
        """Choose the waves, and set up the rows and errors of the points.

        `slope` (N, 2) [m/m] is that of the terrain at the points.
        """
        shared, landmarks = self._shared(points, slope), self.landmarks(points)
        noise = own_variance(points, slope) + shared.rest_m2 + found.nugget_m**2
        datum = local_datum_m(points.z)
        site = NoisyValues.of(points.xy, points.z, np.sqrt(noise)).extent(bounds)
        basis = basis or self._waves(found, site, points.xy, noise, memory_mb)
        place = PlaceError.of(points, self.path)
        strengths = amplitudes(found.kernel, basis) * np.sqrt(place.retained(basis.omega))
        tail = max(periodic_variance(found.kernel, basis.box) - float(np.sum(strengths**2)), 0.0)
        total = with_shared_relief(points.xy, noise, found.kernel, basis, tail, retained=place.retained)
        data = NoisyValues.of(points.xy, points.z - datum, np.sqrt(total))
        trend = PolynomialTrend("plane", basis.box)
        rows = point_rows(points, shared, trend, landmarks, cells)
        return JointSystem(shared, landmarks, basis, strengths, trend, tail, datum, noise, total, data, *rows)

    def solve(
        self,
        points: SurfacePoints,
        bounds: Bounds,
        found: Hyperparameters,
        slope: FloatArray,
        cells: SatelliteCells | None,
        *,
        memory_mb: float = _ROUGH_MB,
        basis: FourierBasis | None = None,
    ) -> JointSolution:
        """Set up the system with the cells of a prior, and solve it."""
        system = self.build(points, bounds, found, slope, cells, memory_mb=memory_mb, basis=basis)
        basis, strengths, trend, shared = system.basis, system.strengths, system.trend, system.shared
        before = shared.rows.shape[1], system.landmarks.rows.shape[1]
        measured = (
            None
            if cells is None
            else cell_rows(cells, trend, cells.features(basis, strengths), system.datum_m, before)
        )
        equations = system.rows, system.information
        return JointSolution(
            self.path,
            self.joint.rank is not None,
            points,
            found,
            shared,
            basis,
            trend,
            system.tail_m2,
            system.datum_m,
            JointPosterior.given(basis, strengths, system.data, equations, measured),
            cells,
            system.noise_m2,
            system.rows,
            system.total_m2,
            system.landmarks,
        )

    def _waves(
        self, found: Hyperparameters, site: Bounds, xy: FloatArray, noise: FloatArray, memory_mb: float
    ) -> FourierBasis:
        """Return the waves that the tolerance asks for, within the memory."""
        sharpest = sharpest_std_m(found.kernel, xy, noise)
        tolerance = max(self.config.tolerance_m, _COARSEST_SHARE * sharpest)
        return affordable_basis(found.kernel, site, sharpest, tolerance, modes_within(memory_mb))

    def _shared(self, points: SurfacePoints, slope: FloatArray) -> SharedError:
        if self.joint.rank is None:
            return SharedError.full(points, self.path, slope)
        return SharedError.dominant(points, self.path, slope, self._modes)

    @cached_property
    def _modes(self) -> FloatArray:
        assert self.joint.rank is not None
        return dominant_modes(self.path, self.joint.rank)


@dataclass(frozen=True)
class JointTerrain:
    r"""Gaussian-process terrain whose points' errors are correlated by the path they were seen from.

    .. math::  z_l = f(x_l) + W_l \delta + \epsilon_l, \qquad
               \Sigma_z = D + W \Lambda^{-1} W^T

    with f a Gaussian process about a plane, δ the errors of the path's keyframes and W_l the derivative of a point's
    height by them: the slope of the terrain for the place, the arm from the rover for yaw, pitch and roll. A satellite's
    cells are measurements of means of f, with errors of their own. Terrain, path and errors of the cells are estimated
    in one solve.

    `path`: posterior of the path from all other sensors, or of the paths of several rovers
    (`PathError.joined`). `satellite`: coarse elevations in any grid and CRS, used as measurements and in no
    other way. `config`: hyperparameters, or how they are found; the mean is a plane. `joint`: errors of the
    satellite, rank, passes.

    Linear in the path's error. Relief that the path's horizontal error displaces counts as relief finer than the map
    (`PlaceError`), and such relief is noise that neighbours share (`with_shared_relief`). Beyond the path, landmarks share
    the errors of `LandmarkErrors`.
    """

    path: PathError
    satellite: Dem | None = None
    config: GaussianProcessConfig = field(default_factory=GaussianProcessConfig)
    joint: JointConfig = field(default_factory=JointConfig)

    def map(self, points: SurfacePoints, grid: Grid, area: SurveyArea | None = None) -> JointMap:
        """Estimate the terrain on a grid, and the path; test the standard deviation unless hyperparameters are stated."""
        same_crs(points.crs, grid.crs, "the points and the grid")
        wanted = self.config.fit if self.config.calibrate is None else self.config.calibrate
        return checked_map(self.solve(points, grid.bounds), grid, area, is_tested=wanted)

    def solve(self, points: SurfacePoints, bounds: Bounds) -> JointSolution:
        """Solve for the terrain within bounds (xmin, ymin, xmax, ymax) [m], and the path."""
        return self.complete(self.from_points(points, bounds))

    def from_points(
        self, points: SurfacePoints, bounds: Bounds, candidates: list[Hyperparameters] | None = None
    ) -> PointsOnly:
        """Fit kernels to the points, without the prior, or take those that are given."""
        residuals = PlaneResiduals(points, self.path, self.builder.landmarks(points), self.config)
        fitted = residuals.candidates() if candidates is None else candidates

        terrain = cache(
            lambda found: self.builder.solve(points, bounds, found, residuals.slope, None).terrain
        )
        return PointsOnly(points, bounds, residuals.slope, fitted, terrain, cache(residuals.lengths))

    def complete(self, alone: PointsOnly) -> JointSolution:
        """Choose a kernel with the prior's cells, and solve with them."""
        points, bounds, slope = alone.points, alone.bounds, alone.slope
        highest = self.builder.highest_rad_per_m(points)
        found, (cells, errors) = (
            alone.candidates[0],
            prior_cells(self.satellite, points, bounds, self.joint.satellite.model()),
        )
        choice: ChosenKernel | None = None
        if cells is not None:
            choice = choose_kernel(alone, cells, errors)
            found, cells = choice.hyperparameters, choice.cells
            if not errors.white.is_known:
                slope = alone.terrain(found).gradient(points.xy, highest)
        for _ in range(self.joint.slope_passes - 1):
            rough = self.builder.solve(points, bounds, found, slope, cells).terrain
            slope = rough.gradient(points.xy, highest)
            cells = None if cells is None else cells.with_slope(rough.gradient(cells.centre))
        solution = self.builder.solve(points, bounds, found, slope, cells, memory_mb=self.joint.memory_mb)
        solution = replace(solution, average=self._average(alone, found, slope, cells))
        return solution if choice is None else self._with_prior(solution, choice, alone, slope)

    def _with_prior(
        self, solution: JointSolution, choice: ChosenKernel, alone: PointsOnly, slope: FloatArray
    ) -> JointSolution:
        """Return the solution with the prior's conflicts, and with its stated level where that may hold all the same."""
        if choice.stated is None:
            return replace(solution, conflicts=choice.conflicts)
        cells = choice.stated.cells.with_slope(solution.terrain.gradient(choice.stated.cells.centre))
        given = alone.points, alone.bounds, solution.hyperparameters, slope, cells
        other = self.builder.solve(*given, memory_mb=self.joint.memory_mb)
        other = replace(other, average=solution.average)
        stated = StatedSolution(other, choice.stated.probability)
        return replace(solution, conflicts=choice.conflicts, stated=stated)

    def _average(
        self, alone: PointsOnly, found: Hyperparameters, slope: FloatArray, cells: SatelliteCells | None
    ) -> MapAverage | None:
        """Return maps with all kernels that points and cells leave probable; None where only one is."""
        if not self.config.fit:
            return None
        rivals, weights = probable(alone, found, cells)
        if rivals == [found]:
            return None
        longest = max((found, *rivals), key=lambda one: one.kernel.length_scales_m[1])
        given = alone.points, alone.bounds, slope, cells
        solutions = self._coarse_solutions(dict.fromkeys((longest, found, *rivals)), *given)
        return averaged(solutions, found, rivals, weights)

    def _coarse_solutions(
        self,
        kernels: Iterable[Hyperparameters],
        points: SurfacePoints,
        bounds: Bounds,
        slope: FloatArray,
        cells: SatelliteCells | None,
    ) -> Iterator[tuple[Hyperparameters, JointSolution]]:
        """Yield a coarse solution with each kernel, all with the waves of the first."""
        basis, memory_mb = None, 0.5 * self.joint.memory_mb
        for one in kernels:
            solution = self.builder.solve(points, bounds, one, slope, cells, memory_mb=memory_mb, basis=basis)
            basis = solution.basis
            yield one, solution

    @cached_property
    def builder(self) -> SystemBuilder:
        """Builder of the linear system."""
        return SystemBuilder(self.path, self.config, self.joint)
