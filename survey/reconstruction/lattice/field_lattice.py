"""Gaussian field on a lattice, updated scan by scan, and its file.

`FieldLattice` adds the points of a scan to the information of the lattice, estimates the stiffness of the ground while
running, bounds the surface by lines of sight where the settings say so, and solves for the heights. Its file holds the arrays
of `FieldState` and the settings, from which a map goes on to the same bytes.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pyproj import CRS

from survey.core import BoolArray, Bounds, FloatArray, InputError, same_crs, validated
from survey.data import Grid, SurfacePoints
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.lattice.calibration import BoundFactors, LatticeCalibration, RecentPoints
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import (
    FieldPosterior,
    Information,
    Part,
    Stiffness,
    is_small,
    likeliest_stiffness,
)
from survey.reconstruction.line_of_sight.ceiling import LowestRays, steepness
from survey.reconstruction.line_of_sight.returns import checked_origins, ends_far_below, ghosts
from survey.reconstruction.nodes import (
    LatticeFrame,
    LatticeModel,
    NodeWindow,
    bilinear,
    require_room,
    sensor_place,
)
from survey.reconstruction.terrain_map import MEASURED, RAY_BOUNDED
from survey.reconstruction.terrain_model import Capabilities, local_datum_m, not_fitted

_METHOD = "field"
# A growing map takes on so many nodes more than the points need, so that it seldom grows.
_SPARE_NODES = 16
_INITIAL_STIFFNESS = Stiffness(100.0, 100.0)


@dataclass(eq=False)
class FieldLattice(LatticeModel):
    r"""A thin plate on an elastic bed, pulled to the points by their weights, solved by multigrid.

    .. math::  (\kappa Q_0(\rho) + S / s^2) \, z = b / s^2 + \kappa Q_0(\rho) \, p

    with the stencil S and right-hand side b of all points so far (`Information`), the prior's
    matrix Q₀ (`Stiffness`), the best plane p and the factor s on the points' errors. Stiffness κ,
    range ρ and s are found by their likelihood at the 1st, 2nd, 4th, 8th … scan.

    `config`: the lattice, what to learn, and how the map moves. `bounds` (xmin, ymin, xmax, ymax): the map's
    extent [m], where it is to be fixed; points beyond it are left out.

    A point's own x-y error is not carried into the height; state it in the point's standard
    deviation where the ground is steep. The prior is equally stiff everywhere, unless
    ``edge_preserving`` softens it at sharp bends; then the order of the scans matters a
    little. The standard deviation does not know errors that all points of a scan share.

    With ``rays`` the surface stays below the third-lowest line of sight over every node, as far as
    the points allow (`solve_below`), and its bounds are no multiples of the standard deviation: they
    are as wide as hidden ground needed (`survey.reconstruction.lattice.calibration.bound_factors`), the upper one
    cut at the ceiling. Where nothing was seen for many metres (`UNSEEN`) they say little.

    >>> rng = np.random.default_rng(1)
    >>> xy = rng.uniform(0.0, 8.0, (900, 2))
    >>> xyz = np.column_stack([xy, 0.2 * xy[:, 0] + 0.02 * rng.standard_normal(900)])
    >>> model = FieldLattice().fit(SurfacePoints(xyz, sigma_m=0.02, crs="EPSG:32608"))
    >>> bool(abs(model.predict([[4.0, 4.0]])[0] - 0.8) < 0.02)
    True
    """

    capabilities: ClassVar = Capabilities(rays=True)
    method: ClassVar = _METHOD

    config: FieldLatticeConfig = field(default_factory=FieldLatticeConfig)
    bounds: Bounds | None = None
    here: LatticeFrame | None = field(default=None, init=False, repr=False)
    stiffness_: Stiffness = field(default=_INITIAL_STIFFNESS, init=False)
    n_scans_: int = field(default=0, init=False)
    n_ghosts_: int = field(default=0, init=False)
    n_iterations_: int = field(default=0, init=False)
    """Iterations of the latest solution."""
    _posterior: FieldPosterior | None = field(default=None, init=False, repr=False)
    recent: RecentPoints = field(default_factory=RecentPoints, init=False, repr=False)
    rays: LowestRays | None = field(default=None, init=False, repr=False)
    """The lowest lines of sight over every node, where they count."""
    _calibration: LatticeCalibration | None = field(default=None, init=False, repr=False)
    _factors: BoundFactors | None = field(default=None, init=False, repr=False)
    _bounds: tuple[FloatArray, FloatArray] | None = field(default=None, init=False, repr=False)

    def fit(self, points: SurfacePoints) -> Self:
        """Discard the present map and fit the points."""
        window = self._window(points, None)
        self.here = LatticeFrame(window, local_datum_m(points.z), points.crs, points.vertical_datum)
        self.stiffness_ = self._given() or _INITIAL_STIFFNESS
        self.n_scans_ = self.n_ghosts_ = 0
        self.recent = RecentPoints()
        self._posterior = FieldPosterior.empty(window.shape, self._n_draws(window))
        self.rays = LowestRays.empty(window.shape) if self.config.rays else None
        return self._add_scan(points)

    def update(self, points: SurfacePoints) -> Self:
        """Add a scan in place, and solve again, starting from the last solution."""
        if self.here is None:
            return self.fit(points)
        same_crs(self.here.crs, points.crs, "the map and the scan")
        self._move(self._window(points, self.here.window))
        return self._add_scan(points)

    def settle(self) -> Self:
        """Solve the whole map, where updates solved a window about the sensor only."""
        self._solve(self._whole())
        return self

    def sample(self, grid: Grid, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n surfaces (n, H, W) [m] that agree with the points; NaN beyond the lattice.

        Their spread is the posterior's before calibration. On large maps the measurement
        errors are mixtures of the map's ``n_draws`` draws.
        """
        here, places = self.where, self.where.window.coordinates(grid.xy)
        drawn = self.posterior.samples(self.where.window, self.stiffness_, n, rng)
        return np.stack([bilinear(z, places).reshape(grid.shape) for z in drawn]) + here.datum_m

    def save(self, path: str | Path) -> None:
        """Write the model to one ``.npz`` file."""
        state = FieldState(
            self.config,
            self.bounds,
            self.where,
            self.posterior,
            self.stiffness_,
            self.recent,
            self.n_scans_,
            self.n_ghosts_,
            self.rays,
        )
        write_field(path, state)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; further scans give the same map as without the break."""
        state = read_field(path)
        model = cls(state.config, state.bounds)
        model.here, model._posterior, model.stiffness_ = state.where, state.posterior, state.stiffness
        model.recent, model.rays = state.recent, state.rays
        model.n_scans_, model.n_ghosts_ = state.n_scans, state.n_ghosts
        return model

    def _add_scan(self, points: SurfacePoints) -> Self:
        """Add the points of one scan, and its lines of sight."""
        scan = self._accepted(points)
        self.posterior.information.add(self._on_lattice(scan[:, :4]))
        self.recent.add(scan)
        self.n_scans_ += 1
        self._calibration = self._bounds = self._factors = None
        if self.config.learns and _is_power_of_two(self.n_scans_):
            self.stiffness_ = (
                likeliest_stiffness(self.recent.xyzw, self.config.node_step_m, self._learned)
                or self.stiffness_
            )
        part = self._part_about(points)
        if self.rays is None:
            self._solve(part)
        else:
            self._solve_freely(part)
            carving = scan[~self._ends_low(scan)]
            self.rays.add(self.where.window, carving[:, 4:], carving[:, :3], 1.0 / np.sqrt(carving[:, 3]))
            self._solve(part)
        return self

    def _accepted(self, points: SurfacePoints) -> FloatArray:
        """Return easting, northing, height above the datum and weight (N, 4) of points that are no ghosts.

        Where lines of sight count, the sensor's places follow (N, 7).
        """
        datum_m = self.where.datum_m
        scan = np.empty((len(points), 4 if self.rays is None else 7))
        scan[:, :2], scan[:, 2] = points.xy, points.z - datum_m
        scan[:, 3] = 1.0 / (points.sigma_z * points.sigma_z)
        if self.rays is not None:
            scan[:, 4:] = checked_origins(points) - [0.0, 0.0, datum_m]
        if self.config.gate:
            ghost = ghosts(scan[:, :3])
            self.n_ghosts_ += int(ghost.sum())
            scan = scan[~ghost] if ghost.any() else scan
        return scan

    def _ends_low(self, scan: FloatArray) -> BoolArray:
        """Return which points of a scan lie so far below the surface that their lines of sight are rejected."""
        low = bilinear(self._nodes(), self.where.window.coordinates(scan[:, :2])) - scan[:, 2]
        # Beyond the map there is no information.
        return ends_far_below(low, 1.0 / np.sqrt(scan[:, 3])) | np.isnan(low)

    def _on_lattice(self, scan: FloatArray) -> FloatArray:
        window, points = self.where.window, scan.copy()
        points[:, :2] /= window.step_m
        points[:, 0] -= window.west
        points[:, 1] -= window.south
        return points

    def _solve(self, part: Part) -> None:
        """Solve a part of the map, below its ceiling if lines of sight count."""
        ceiling = None if self.rays is None else self._ceiling(part)
        self.n_iterations_ = self.posterior.solve(
            part, self.where.window.step_m, self.stiffness_, self.config, ceiling
        )

    def _solve_freely(self, part: Part) -> None:
        """Solve without ceiling, well enough for the ground's slopes and for points that lie too low."""
        roughly = self.config.model_copy(update={"tolerance": 10.0 * self.config.tolerance})
        self.posterior.solve(part, self.where.window.step_m, self.stiffness_, roughly)

    def _ceiling(self, part: Part) -> FloatArray:
        """Return the greatest heights above the datum (h, w) that lines of sight allow in a part of the map [m]."""
        if self.rays is None:
            raise InputError("the field lattice was set up without lines of sight; set rays.")
        slope = steepness(self._nodes()[part], self.where.window.step_m)
        return self.rays.within(*part).ceiling(slope)

    def _whole(self) -> Part:
        rows, columns = self.where.window.shape
        return Part(slice(0, rows), slice(0, columns))

    def _part_about(self, points: SurfacePoints) -> Part:
        """Return the part of the map to solve: all, or the window about the sensor."""
        rows, columns = self.where.window.shape
        n = self.config.window_nodes
        if n is None:
            return self._whole()
        centre = points.xy.mean(axis=0) if points.origins is None else sensor_place(points.origins)
        u, v = self.where.window.coordinates(centre)
        return Part.about(round(float(v)), round(float(u)), n, (rows, columns))

    def _window(self, points: SurfacePoints, old: NodeWindow | None) -> NodeWindow:
        """Return the nodes that the map is to have after these points."""
        step_m = self.config.node_step_m
        if self.bounds is not None:
            window = NodeWindow.over(self.bounds, step_m)
        elif self.config.side_m is not None:
            window = NodeWindow.around(sensor_place(points.origins), self.config.side_m, step_m)
        else:
            (xmin, ymin), (xmax, ymax) = points.xy.min(axis=0), points.xy.max(axis=0)
            if old is not None and old.covers((xmin, ymin, xmax, ymax)):
                return old
            spare = _SPARE_NODES * step_m
            window = NodeWindow.over((xmin - spare, ymin - spare, xmax + spare, ymax + spare), step_m)
            window = window if old is None else old.joined(window)
        spare_nodes = 2 * _SPARE_NODES if self.bounds is None and self.config.side_m is None else 0
        require_room(window, self.config.bytes_per_node, self.config.memory_mb, spare_nodes)
        return window

    def _move(self, window: NodeWindow) -> None:
        old = self.where.window
        if window != old:
            self._posterior = self.posterior.carried(window, old)
            self.rays = None if self.rays is None else self.rays.carried(window, old)
            self.here = self.where._replace(window=window)

    def _n_draws(self, window: NodeWindow) -> int:
        """Return how many draws to keep: none for a map that stays small enough to do without."""
        stays = self.bounds is not None or self.config.side_m is not None
        return 0 if stays and is_small(window.shape) else self.config.n_draws

    def _given(self) -> Stiffness | None:
        if self.config.stiffness is None:
            return None
        endless_m = 1e3 * self.config.node_step_m
        return Stiffness(self.config.stiffness, self.config.range_m or endless_m)

    @property
    def _learned(self) -> Stiffness | None:
        return None if self.stiffness_ is _INITIAL_STIFFNESS else self.stiffness_

    @property
    def posterior(self) -> FieldPosterior:
        """Posterior of the nodes."""
        if self._posterior is None:
            raise not_fitted()
        return self._posterior

    def _nodes(self) -> FloatArray:
        return self.posterior.heights()

    def _weights(self) -> FloatArray:
        weights: FloatArray = self.posterior.information.stencil[0]
        return weights

    def _reach_m(self) -> float:
        return self.stiffness_.range_m

    def _node_std(self) -> FloatArray:
        if self.config.window_nodes is not None:
            self.settle()
        return self.calibration.surface * self.posterior.std(self.where.window, self.stiffness_)

    def _bound(self, xy: FloatArray, what: Literal["lower", "upper"]) -> FloatArray:
        if self.rays is None:
            return super()._bound(xy, what)
        here = self.where
        return bilinear(self._node_bounds()[what == "upper"], here.window.coordinates(xy)) + here.datum_m

    def _node_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the greatest height above the datum (H, W) that the ground may have [m].

        Both are as far from the map as ground hidden from imagined sensors was; lines of sight cut the upper one.
        """
        if self._bounds is None:
            if self.config.window_nodes is not None:
                self.settle()
            std = self.posterior.std(self.where.window, self.stiffness_)
            spread = np.sqrt(std**2 + self.recent.noise_m2(self.stiffness_))
            below, above = self.bound_factors.at(self._away_m() / self.where.window.step_m)
            z = self._nodes()
            ceiling = np.maximum(self._ceiling(self._whole()), z)
            self._bounds = z - below * spread, np.minimum(z + above * spread, ceiling)
        return self._bounds

    @property
    def bound_factors(self) -> BoundFactors:
        """How many spreads the ground may lie below and above the map."""
        if self._factors is None:
            wanted = self.config.calibrate
            self._factors = (
                self.recent.bound_factors(self.config, self.stiffness_) if wanted else BoundFactors.normal()
            )
        return self._factors

    def _node_support(self) -> npt.NDArray[np.uint8]:
        support = super()._node_support()
        if self.rays is None:
            return support
        return np.where(self.rays.covered() & (support != MEASURED), RAY_BOUNDED, support).astype(np.uint8)

    @property
    def calibration(self) -> LatticeCalibration:
        """The factors on the standard deviations of surface and points, from blocks that were left out."""
        if self._calibration is None:
            wanted = self.config.calibrate
            self._calibration = (
                self.recent.calibration(self.config, self.stiffness_) if wanted else LatticeCalibration()
            )
        return self._calibration

    def _record(self) -> tuple[dict[str, Any], dict[str, Any]]:
        learned = {
            "stiffness": self.stiffness_.stiffness,
            "range_m": self.stiffness_.range_m,
            "noise_factor": self.stiffness_.noise_factor,
        }
        facts = {
            "step_m": self.where.window.step_m,
            "n_scans": self.n_scans_,
            "n_points": self.posterior.information.n_points,
            "n_ghosts": self.n_ghosts_,
            "prior_std_m": self.stiffness_.prior_std_m(),
            "calibration": self.calibration.facts(),
        }
        if self.rays is not None:
            facts["ray_covered_share"] = float(self.rays.covered().mean())
            facts["bound_factors"] = self.bound_factors.facts()
        return learned, facts


def _is_power_of_two(n: int) -> bool:
    return n & (n - 1) == 0


_FORMAT = "firnline field lattice 2"
_NOTHING = np.zeros((0, 0, 0))


class FieldState(NamedTuple):
    """Everything that a fitted field lattice is made of."""

    config: FieldLatticeConfig
    bounds: Bounds | None
    where: LatticeFrame
    posterior: FieldPosterior
    stiffness: Stiffness
    recent: RecentPoints
    n_scans: int
    n_ghosts: int
    rays: LowestRays | None


def write_field(path: str | Path, model: FieldState) -> None:
    """Write a fitted model; equal models give equal bytes."""
    here, known = model.where, model.posterior
    window, information = here.window, known.information
    facts = {
        "config": model.config.model_dump(),
        "bounds": model.bounds,
        "window": [window.step_m, window.west, window.south, window.rows, window.columns],
        "datum_m": here.datum_m,
        "crs": here.crs.to_wkt(),
        "vertical_datum": here.vertical_datum,
        "stiffness": list(model.stiffness),
        "n_scans": model.n_scans,
        "n_ghosts": model.n_ghosts,
        "n_points": information.n_points,
        "lengths": [len(scan) for scan in model.recent.scans],
    }
    arrays = {
        "stencil": information.stencil,
        "rhs": information.rhs,
        "draws": information.draws,
        "moments": information.moments,
        "z": known.z,
        "soft": _NOTHING if known.soft is None else known.soft,
        "recent": np.concatenate(model.recent.scans),
        "rays": _NOTHING if model.rays is None else np.stack([model.rays.height, model.rays.offset]),
    }
    write_arrays(path, _FORMAT, facts, arrays)


def read_field(path: str | Path) -> FieldState:
    """Read what `write_field` wrote."""
    facts, arrays = read_arrays(path, _FORMAT)
    config = validated(FieldLatticeConfig, facts["config"], "the field lattice's settings")
    window = NodeWindow(*facts["window"])
    information = Information(
        arrays["stencil"], arrays["rhs"], arrays["draws"], arrays["moments"], facts["n_points"]
    )
    ends = np.cumsum(facts["lengths"])[:-1]
    return FieldState(
        config,
        tuple(facts["bounds"]) if facts["bounds"] else None,
        LatticeFrame(window, facts["datum_m"], CRS.from_wkt(facts["crs"]), facts["vertical_datum"]),
        FieldPosterior(information, arrays["z"], arrays["soft"] if arrays["soft"].size else None),
        Stiffness(*facts["stiffness"]),
        RecentPoints(np.split(arrays["recent"], ends)),
        facts["n_scans"],
        facts["n_ghosts"],
        LowestRays(*arrays["rays"]) if arrays["rays"].size else None,
    )
