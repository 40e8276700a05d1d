"""Space-carving kernels: compact kernels fitted to points and constrained to lie below lines of sight (Hadsell, Bagnell, Huber, Hebert)."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt

from survey.core import FloatArray, InputError, IntArray, checked, root_mean_square, same_crs, stream
from survey.data import Dem, Grid, SurfacePoints
from survey.reconstruction.carving.carved_surface import (
    CarvedSurface,
    CarvingFrame,
    CarvingState,
    Cloud,
    Codes,
    Frame,
    Pass,
    pass_of,
    read_carving,
    support_of_nodes,
    write_carving,
)
from survey.reconstruction.carving.config import SpaceCarvingConfig, raster_step_m, require_kernel_memory
from survey.reconstruction.carving.descent import BY_POINT, BY_RAY, Bases, Step
from survey.reconstruction.line_of_sight.returns import checked_origins, ghosts
from survey.reconstruction.nodes import NodeWindow
from survey.reconstruction.terrain_map import SIGMAS_95, UNSEEN, Reconstruction
from survey.reconstruction.terrain_model import Capabilities, TerrainModel, local_datum_m, not_fitted

MEAN, LOWER, UPPER = "mean", "lower", "upper"
_METHOD = "carving"
# η falls by √2 after so many passes; λ is that of a step among so many points.
_PASSES_TO_SLOW, _N_OF_DECAY = 4.0, 10_000.0
_NOTE = "learned without bounds; the band holds the root mean square distance of the points from the surface"


@dataclass(eq=False)
class SpaceCarvingKernel(TerrainModel):
    r"""A sum of compact kernels that meets points and stays under lines of sight.

    .. math::  f(x) = f_0 + \sum_j \alpha_j k_{\sigma_j}(x, x_j), \qquad
               \min_f \; \lambda \|f\|^2 + \frac1N \sum_i \tfrac12 (f(x_i) - z_i)^2
               + \tfrac12 \max(0, \max_x f(x) - g_i(x))^2

    (Eqs. 5, 8 and 9), by stochastic steps, in every pass for all points and then for all lines of
    sight g_i, with a length scale σ that shrinks from pass to pass. Two further surfaces, which begin
    `bound_offset_m` above and below, meet the first where data are and part from it where none
    are: their distance is the paper's uncertainty.

    `config`: length scales, rates, and whether lines of sight carve.

    The paper leaves open how σ shrinks, η₀, λ and the size of a violation that counts; the
    configuration states our choices. Wu's kernel is divided by 4, so that it is 1 at 0.

    The bounds are no bounds in the sense of a probability: in gaps all three surfaces are drawn
    by the same kernels and share their error; of the study's piles of rubble 77 % lies
    within. Those of `FieldLattice` are calibrated. The standard deviation is
    that of a normal distribution whose 95 % they would hold.

    Learning is anytime: `passes` can be left after any pass, and points can be added between
    two. An update visits the new points and the old ones within the largest length scale;
    lines of sight of other points are not visited again.

    >>> rng = np.random.default_rng(1)
    >>> xy = rng.uniform(0.0, 8.0, (900, 2))
    >>> xyz = np.column_stack([xy, 0.2 * xy[:, 0] + 0.02 * rng.standard_normal(900)])
    >>> points = SurfacePoints(xyz, sigma_m=0.02, origins=np.tile([4.0, 4.0, 9.0], (900, 1)), crs="EPSG:32608")
    >>> model = SpaceCarvingKernel().fit(points)
    >>> bool(abs(model.predict([[4.0, 4.0]])[0] - 0.8) < 0.03)
    True
    """

    capabilities: ClassVar = Capabilities(samples=False, rays=True)
    method: ClassVar = _METHOD

    config: SpaceCarvingConfig = field(default_factory=SpaceCarvingConfig)
    surfaces_: dict[str, CarvedSurface] = field(default_factory=dict, init=False, repr=False)
    passes_: list[Pass] = field(default_factory=list, init=False, repr=False)
    """What every pass of the latest run did."""
    n_scans_: int = field(default=0, init=False)
    """How often it has learned: once per fit or update."""
    n_ghosts_: int = field(default=0, init=False)
    spread_m_: float = field(default=np.nan, init=False)
    """Root mean square distance of the points from the surface [m]."""
    frame: Frame = field(default=None, init=False, repr=False)  # type: ignore[assignment]  # laid with the first points
    place: CarvingFrame | None = field(default=None, init=False, repr=False)
    cloud: Cloud = field(default_factory=Cloud, init=False, repr=False)
    n_learned_: int = field(default=0, init=False, repr=False)
    _codes: Codes | None = field(default=None, init=False, repr=False)

    def fit(self, points: SurfacePoints) -> Self:
        """Discard the present map and fit the points."""
        return self.begin(points).learn()

    def update(self, points: SurfacePoints) -> Self:
        """Add points in place, and learn from them and from the old ones within their reach."""
        return (self.begin(points) if self.place is None else self.add(points)).learn()

    def learn(self) -> Self:
        """Make passes until they have converged."""
        for _ in self.passes():
            pass
        return self

    def begin(self, points: SurfacePoints) -> Self:
        """Discard the present map and add points, without optimizing yet."""
        self.n_scans_ = self.n_ghosts_ = self.n_learned_ = 0
        accepted = self._accepted(points)
        datum_m = local_datum_m(accepted.z)
        step_m = raster_step_m(self.config.lengths_m())
        self.place = CarvingFrame(0, 0, step_m, datum_m, points.crs, points.vertical_datum)
        self.cloud, self.surfaces_, self.passes_, self._codes = Cloud(), {}, [], None
        self._cover(accepted.xy)
        level = self.config.prior_m if self.config.prior_m is not None else float(np.median(accepted.z))
        offset = self.config.bound_offset_m
        above = {MEAN: 0.0} | ({LOWER: -offset, UPPER: offset} if self.config.bounds else {})
        self.surfaces_ = {
            name: CarvedSurface.new(self.frame, Step(level - datum_m + dz, *self._pace(len(accepted))))
            for name, dz in above.items()
        }
        return self._taken(accepted)

    def add(self, points: SurfacePoints) -> Self:
        """Take more points, without learning from them yet; a run under way visits them from its next pass on."""
        same_crs(self.where.crs, points.crs, "the map and the points")
        accepted = self._accepted(points)
        self._cover(accepted.xy)
        return self._taken(accepted)

    def passes(self) -> Iterator[Pass]:
        """Learn pass by pass: between two the model can be asked, given points, or left as it is."""
        visited = self._to_visit()
        for surface in self.surfaces_.values():
            surface.settle(Step(surface.step.prior_m, *self._pace(len(visited))))
        rng = stream(self.config.seed, "space carving", self.n_scans_)
        rng_of_tiles = stream(self.config.seed, "space carving", "tiles", self.n_scans_)
        self.n_scans_ += 1
        self.passes_ = []
        n_steps, sights = 0, None
        for level, length_m in enumerate(self.config.lengths_m()):
            added = self._newly_added()
            visited = np.concatenate([visited, added])
            order = self.cloud.shuffled(visited, rng, rng_of_tiles)
            if sights is None or len(added):
                sights = self.cloud.sights(visited, self.config, (self.frame.width_m, self.frame.height_m))
            tallies = {
                name: surface.learn(sights, order, level, n_steps) for name, surface in self.surfaces_.items()
            }
            n_steps += len(order)
            self.spread_m_ = root_mean_square(self.surfaces_[MEAN].latest_heights() - sights.xyz[:, 2])
            self.passes_.append(pass_of(tallies[MEAN], float(length_m), self._validation_m()))
            yield self.passes_[-1]
            if self._has_converged():
                break

    def prior_surfaces(self, xy: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper surface (N,) [m] as the paper draws them; NaN beyond the frame."""
        places = checked(xy, (None, 2), "the places to predict")
        self._require_bounds()
        return self._surface(LOWER, places), self._surface(UPPER, places)

    def n_bases(self) -> tuple[int, int]:
        """Return how many bases of the mean surface points made, and how many lines of sight."""
        made_by = self.mean_surface.bases().made_by
        return int((made_by == BY_POINT).sum()), int((made_by == BY_RAY).sum())

    def contributions(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return the sums of |α| of the mean surface's bases that rays and that points made, in the cell about each node (H, W) [m].

        The paper's Fig. 10.
        """
        return contributions(self.mean_surface.bases(), self.where.corner[:2], grid)

    def sample(self, grid: Grid, n: int, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Refuse: the surfaces state no distribution."""
        raise InputError(
            "a SpaceCarvingKernel has three surfaces and no distribution to draw from; take a FieldLattice."
        )

    def grid(self, grid: Grid) -> Reconstruction:
        """Return the map on the nodes of a grid; NaN beyond the frame.

        Learned without bounds, it gives the spread of the points about the surface in place of
        a standard deviation, and says so.
        """
        places, datum = grid.xy, self.where.vertical_datum

        def dem(values: FloatArray) -> Dem:
            return Dem.on(grid, values.reshape(grid.shape), datum)

        mean = self._height(places)
        bounds = self.config.bounds
        std = self._std(places) if bounds else np.where(np.isnan(mean), np.nan, self.spread_m_)
        return Reconstruction(
            dem(mean),
            dem(std),
            self._support(places).reshape(grid.shape),
            self.method,
            {"first_length_m": self.config.first_length_m, "last_length_m": self.config.last_length_m},
            dem(self._bound(places, "lower")) if bounds else None,
            dem(self._bound(places, "upper")) if bounds else None,
            diagnostics=self._record(),
        )

    def full_grid(self, step_m: float | None = None) -> Grid:
        """Return a grid over the points, its nodes at whole multiples of a step; of the last length scale without one."""
        self.mean_surface  # noqa: B018  # refuses a model without points
        xy = self.cloud.xyz[:, :2] + self.where.corner[:2]
        low, high = xy.min(axis=0), xy.max(axis=0)
        window = NodeWindow.over((*low, *high), step_m or self.config.last_length_m)
        return Grid(window.bounds, window.step_m, self.where.crs)

    def save(self, path: str | Path) -> None:
        """Write the model to one ``.npz`` file; equal models give equal bytes."""
        state = CarvingState(
            self.config,
            self.where,
            self.frame,
            self.cloud,
            self.surfaces_,
            self.spread_m_,
            self.n_scans_,
            self.n_ghosts_,
            self.n_learned_,
        )
        write_carving(path, state)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; further points give the same map as without the break."""
        state = read_carving(path)
        model = cls(state.config)
        model.place, model.frame, model.cloud = state.where, state.frame, state.cloud
        model.surfaces_, model.spread_m_ = state.surfaces, state.spread_m
        model.n_scans_, model.n_ghosts_, model.n_learned_ = state.n_scans, state.n_ghosts, state.n_learned
        return model

    @property
    def where(self) -> CarvingFrame:
        """Where the frame is, the level of its heights, and their system."""
        if self.place is None:
            raise not_fitted()
        return self.place

    def _accepted(self, points: SurfacePoints) -> SurfacePoints:
        """Return the points without ghosts, thinned, once their lines of sight make sense."""
        if self.config.carve:
            checked_origins(points)
        ghost = ghosts(points.xyz) if self.config.gate else np.zeros(len(points), dtype=bool)
        self.n_ghosts_ += int(ghost.sum())
        kept = ~ghost
        if self.config.thin_m:
            cells = np.floor(points.xy[kept] / self.config.thin_m).astype(np.int64)
            first = np.unique(cells, axis=0, return_index=True)[1]
            kept[np.delete(np.flatnonzero(kept), first)] = False
        return points if kept.all() else points.select(kept)

    def _pace(self, n: int) -> tuple[float, float, float, float, bool, float]:
        """Return the parameters of a pass over so many points."""
        config = self.config
        decay = config.decay * min(_N_OF_DECAY / max(n, 1), 1.0)
        slow_after = _PASSES_TO_SLOW * max(n, 1)
        return config.dead_band_m, config.rate, slow_after, decay, config.carve, config.ray_rate

    def _taken(self, points: SurfacePoints) -> Self:
        """Keep points, some of them held back."""
        rng = stream(self.config.seed, "space carving", "held back", len(self.cloud))
        self.cloud.add(points, self.where, rng.random(len(points)) < self.config.validation_share)
        self._codes = None
        return self

    def _newly_added(self) -> IntArray:
        """Return the numbers of the points to learn from that no run has seen, and count them as seen."""
        first, self.n_learned_ = self.n_learned_, len(self.cloud)
        return self.cloud.learned_from(first)

    def _to_visit(self) -> IntArray:
        """Return the points that a run begins with: new ones and old ones within their reach, or all where none is new."""
        first = self.n_learned_
        new = self._newly_added()
        if not first:
            return new
        if not len(new):
            return self.cloud.learned_from()
        return np.concatenate([self.cloud.within_reach(first, self.config.first_length_m), new])

    def _cover(self, xy: FloatArray) -> None:
        """Lay the frame over points and the reach of the kernels about them, or widen it so that it covers them."""
        place, reach_m = self.where, self.config.first_length_m
        low, high = xy.min(axis=0), xy.max(axis=0)
        size = (self.frame.width_m, self.frame.height_m) if self.surfaces_ else (0.0, 0.0)
        corner = place.corner[:2]
        if self.surfaces_ and (low >= corner).all() and (high <= corner + size).all():
            return
        low, high = low - reach_m, high + reach_m
        if self.surfaces_:
            low, high = np.minimum(low, corner), np.maximum(high, corner + size)
        west, south = (int(n) for n in np.floor(low / place.step_m + 1e-6))
        moved = place._replace(west=west, south=south)
        width_m, height_m = (float(side) for side in high - moved.corner[:2])
        require_kernel_memory(self.config, width_m, height_m, len(self.cloud) + len(xy))
        frame = Frame.over(width_m, height_m, self.config.lengths_m())
        if self.surfaces_:
            shift = place.west - west, place.south - south
            self.cloud.move(np.array(shift) * place.step_m)
            for surface in self.surfaces_.values():
                surface.move(frame, *shift)
        self.place, self.frame = moved, frame

    def _validation_m(self) -> float:
        """Return the root mean square error at the points held back [m]; NaN without any."""
        held = self.cloud.xyz[self.cloud.held]
        return root_mean_square(self.mean_surface.heights(held[:, :2]) - held[:, 2]) if len(held) else np.nan

    def _has_converged(self) -> bool:
        """Return whether violations are small enough, or the error of the points held back has grown."""
        latest = self.passes_[-1]
        grown = len(self.passes_) > 1 and latest.validation_rmse_m > self.passes_[-2].validation_rmse_m
        return latest.gradient_m < self.config.gradient_tolerance_m or grown

    @property
    def mean_surface(self) -> CarvedSurface:
        """The surface that began at the prior itself."""
        if not self.surfaces_:
            raise not_fitted()
        return self.surfaces_[MEAN]

    def _surface(self, name: str, xy: FloatArray) -> FloatArray:
        """Return one surface's heights (N,) [m]; NaN beyond the frame."""
        local = xy - self.where.corner[:2]
        inside = (local >= 0.0).all(axis=1) & (local <= (self.frame.width_m, self.frame.height_m)).all(axis=1)
        heights = np.full(len(xy), np.nan)
        heights[inside] = self.surfaces_[name].heights(local[inside]) + self.where.datum_m
        return heights

    def _height(self, xy: FloatArray) -> FloatArray:
        self.mean_surface  # noqa: B018  # refuses a model without points
        return self._surface(MEAN, xy)

    def _bound(self, xy: FloatArray, what: Literal["lower", "upper"]) -> FloatArray:
        """Return the outermost of the three surfaces, and beyond it what the points scatter."""
        self._require_bounds()
        lower, upper = self.prior_surfaces(xy)
        mean, scatter = self._height(xy), SIGMAS_95 * self.spread_m_
        if what == UPPER:
            return np.maximum(mean, np.maximum(lower, upper)) + scatter
        return np.minimum(mean, np.minimum(lower, upper)) - scatter

    def _std(self, xy: FloatArray) -> FloatArray:
        return (self._bound(xy, "upper") - self._bound(xy, "lower")) / (2.0 * SIGMAS_95)

    def _require_bounds(self) -> None:
        self.mean_surface  # noqa: B018  # refuses a model without points
        if not self.config.bounds:
            raise InputError(
                "this SpaceCarvingKernel was to learn without bounds; set bounds = true and fit again."
            )

    def _support(self, xy: FloatArray) -> Codes:
        nodes = self._support_nodes()
        if self._codes is None:
            reach_m = self.config.first_length_m
            self._codes = support_of_nodes(nodes, self.cloud, reach_m, rays=self.config.carve)
        u, v = np.round(nodes.coordinates(xy - self.where.corner[:2])).astype(np.int64).T
        inside = (u >= 0) & (v >= 0) & (u < nodes.columns) & (v < nodes.rows)
        codes = self._codes[np.where(inside, v, 0), np.where(inside, u, 0)]
        return np.where(inside, codes, UNSEEN).astype(np.uint8)

    def _support_nodes(self) -> NodeWindow:
        """Return nodes one last length scale apart over the frame, in its coordinates."""
        self.mean_surface  # noqa: B018  # refuses a model without points
        return NodeWindow.over((0.0, 0.0, self.frame.width_m, self.frame.height_m), self.config.last_length_m)

    def _record(self) -> dict[str, Any]:
        """Return what was found out, for the record."""
        by_points, by_rays = self.n_bases()
        facts = {
            "n_points": len(self.cloud),
            "n_ghosts": self.n_ghosts_,
            "n_scans": self.n_scans_,
            "n_point_bases": by_points,
            "n_ray_bases": by_rays,
            "spread_m": self.spread_m_,
        }
        return facts if self.config.bounds else facts | {"standard_deviation": _NOTE}


def contributions(bases: Bases, corner: npt.NDArray[np.float64], grid: Grid) -> tuple[FloatArray, FloatArray]:
    """Return the sums of |α| (H, W) [m] of the bases that rays and that points made, in the cell about each node.

    `corner` (2,): place of the bases' origin [m].
    """
    column = np.round((bases.x + corner[0] - grid.x[0]) / grid.step_m).astype(np.int64)
    row = np.round((grid.y[0] - bases.y - corner[1]) / grid.step_m).astype(np.int64)
    rows, columns = grid.shape
    inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
    sums = []
    for maker in (BY_RAY, BY_POINT):
        chosen = inside & (bases.made_by == maker)
        total = np.zeros(grid.shape)
        np.add.at(total, (row[chosen], column[chosen]), np.abs(bases.weight[chosen]))
        sums.append(total)
    return sums[0], sums[1]
