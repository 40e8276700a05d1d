"""A share of the latest points: what a lattice learns its stiffness and the honesty of its claims from."""

from dataclasses import dataclass, field

import numpy as np

from survey.arrays import BoolArray, FloatArray
from survey.reconstruction.lattice.calibration import LatticeCalibration, calibrated
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import FieldPosterior, Part, is_small
from survey.reconstruction.lattice.nodes import NodeWindow, bilinear
from survey.reconstruction.lattice.stiffness import Stiffness

_N_PER_SCAN, _N_KEPT = 10_000, 20_000
_N_DRAWS = 32


@dataclass(eq=False)
class RecentPoints:
    """Points (N, 4) of the latest scans: easting, northing, height above the datum [m], weight [1/m²]."""

    scans: list[FloatArray] = field(default_factory=list)

    def add(self, scan: FloatArray) -> None:
        """Keep a share of a scan, and let go of the oldest."""
        self.scans.append(scan[:: -(-len(scan) // _N_PER_SCAN) or 1].copy())
        while sum(map(len, self.scans[1:])) >= _N_KEPT:
            self.scans.pop(0)

    @property
    def xyzw(self) -> FloatArray:
        """All of them, the latest ones first when there are too many."""
        return np.concatenate(self.scans)[-_N_KEPT:]

    def calibration(self, config: FieldLatticeConfig, stiffness: Stiffness) -> LatticeCalibration:
        """Return the factors on the standard deviations that blocks of left-out points ask for."""
        points = self.xyzw
        (xmin, ymin), (xmax, ymax) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        window = NodeWindow.over((xmin, ymin, xmax, ymax), config.step_m)
        uv = window.coordinates(points[:, :2])
        whole = Part(slice(0, window.rows), slice(0, window.columns))
        n_draws = 0 if is_small(window.shape) else _N_DRAWS

        def predict(kept: BoolArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
            posterior = FieldPosterior.empty(window.shape, n_draws)
            posterior.information.add(np.column_stack([uv[kept], points[kept, 2:]]))
            posterior.solve(whole, config.step_m, stiffness, config)
            places = window.coordinates(xy)
            return bilinear(posterior.heights(), places), bilinear(
                posterior.std(window, stiffness), places
            ) ** 2

        noise_m2 = stiffness.noise_factor**2 / points[:, 3]
        return calibrated(points, noise_m2, config.step_m, predict)
