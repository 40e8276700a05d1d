"""Set-up of the linear system of map and path, and its solution with one kernel.

`SystemBuilder.build` chooses the waves, and sets up the rows and errors of the points; `SystemBuilder.solve` adds the
cells of a prior and solves for terrain, path and shared errors at once.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from survey.core import Bounds, FloatArray
from survey.data import PathError, SurfacePoints
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
from survey.reconstruction.joint.kernel_choice import own_variance
from survey.reconstruction.joint.normal_equations import JointPosterior, JointSystem, cell_rows, point_rows
from survey.reconstruction.joint.satellite_cells import SatelliteCells
from survey.reconstruction.joint.shared_errors import (
    LandmarkErrors,
    PlaceError,
    SharedError,
    dominant_modes,
    with_shared_relief,
)
from survey.reconstruction.joint.solution import JointSolution
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
