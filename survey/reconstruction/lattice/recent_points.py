"""Sample of the latest points, for the stiffness of a lattice and the calibration of its standard deviation."""

from dataclasses import dataclass, field

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.reconstruction.lattice.calibration import LatticeCalibration, calibrated
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import FieldPosterior, Part, is_small
from survey.reconstruction.lattice.hidden_ground import BoundFactors, Predicted, Scenes, bound_factors
from survey.reconstruction.lattice.stiffness import Stiffness
from survey.reconstruction.nodes import NodeWindow, away_from, bilinear

_N_PER_SCAN, _N_KEPT = 10_000, 20_000
_N_DRAWS, _N_DRAWS_FOR_BOUNDS = 32, 16
# What a map is held to its points on is no wider than this many nodes, about where most points are.
_MOST_NODES = 192


@dataclass(eq=False)
class RecentPoints:
    """Points of the latest scans: easting, northing, height above the datum [m], weight [1/m²].

    Where lines of sight count, the sensor's place follows [m]: (N, 7) in place of (N, 4).
    """

    scans: list[FloatArray] = field(default_factory=list)

    def add(self, scan: FloatArray) -> None:
        """Add a sample of a scan, and drop the oldest points."""
        self.scans.append(scan[:: -(-len(scan) // _N_PER_SCAN) or 1].copy())
        while sum(map(len, self.scans[1:])) >= _N_KEPT:
            self.scans.pop(0)

    @property
    def xyzw(self) -> FloatArray:
        """All points (N, 4); the latest ones when there are too many."""
        return self._all[:, :4]

    @property
    def _all(self) -> FloatArray:
        return np.concatenate(self.scans)[-_N_KEPT:]

    def calibration(self, config: FieldLatticeConfig, stiffness: Stiffness) -> LatticeCalibration:
        """Return the factors on the standard deviations that blocks of left-out points ask for."""
        points = self._amid(config.node_step_m)[:, :4]
        window = _window(points, config.node_step_m)

        def predict(kept: BoolArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
            posterior = _without(window, points[kept], config, stiffness, _N_DRAWS)
            places = window.coordinates(xy)
            std = bilinear(posterior.std(window, stiffness), places)
            return bilinear(posterior.heights(), places), std**2

        noise_m2 = stiffness.noise_factor**2 / points[:, 3]
        return calibrated(points, noise_m2, config.node_step_m, predict)

    def bound_factors(self, config: FieldLatticeConfig, stiffness: Stiffness) -> BoundFactors:
        """Return how many spreads the ground may lie below and above the map, as left-out points ask for."""
        points = self._amid(config.node_step_m)
        window = _window(points, config.node_step_m)
        known = _without(window, points[:, :4], config, stiffness, 0)
        measured = known.information.stencil[0] > 0.0
        noise_m2 = self.noise_m2(stiffness)

        def predict(kept: BoolArray, xy: FloatArray) -> Predicted:
            posterior = _without(window, points[kept, :4], config, stiffness, _N_DRAWS_FOR_BOUNDS)
            places = window.coordinates(xy)
            std = bilinear(posterior.std(window, stiffness), places)
            away = bilinear(away_from(posterior.information.stencil[0] > 0.0), places)
            return Predicted(bilinear(posterior.heights(), places), np.sqrt(std**2 + noise_m2), away)

        return bound_factors(Scenes(points, window, known.heights(), measured), predict)

    def noise_m2(self, stiffness: Stiffness) -> float:
        """Return the variance of a single measurement about the surface, as it usually is [m²]."""
        return float(stiffness.noise_factor**2 * np.median(1.0 / self.xyzw[:, 3]))

    def _amid(self, step_m: float) -> FloatArray:
        """Return the points around the centre of all points, to bound the time of a calibration."""
        points = self._all
        away = np.abs(points[:, :2] - np.median(points[:, :2], axis=0)).max(axis=1)
        amid: FloatArray = points[away < 0.5 * _MOST_NODES * step_m]
        return amid


def _window(points: FloatArray, step_m: float) -> NodeWindow:
    (xmin, ymin), (xmax, ymax) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return NodeWindow.over((xmin, ymin, xmax, ymax), step_m)


def _without(
    window: NodeWindow,
    points: FloatArray,
    config: FieldLatticeConfig,
    stiffness: Stiffness,
    n_draws: int,
) -> FieldPosterior:
    """Return the map of some points (N, 4) alone."""
    posterior = FieldPosterior.empty(window.shape, 0 if is_small(window.shape) else n_draws)
    posterior.information.add(np.column_stack([window.coordinates(points[:, :2]), points[:, 2:]]))
    whole = Part(slice(0, window.rows), slice(0, window.columns))
    posterior.solve(whole, config.node_step_m, stiffness, config)
    return posterior
