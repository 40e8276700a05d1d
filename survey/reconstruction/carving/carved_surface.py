"""One carved surface, the points and lines of sight that it learns from, and the record of its passes.

`Cloud` holds the points in the coordinates of the frame, those held back for validation among them, and gives the
lines of sight of a pass. `CarvedSurface` learns from them pass by pass. `Pass` is the record of one pass.
`support_of_nodes` states for every node whether points measured it, lie within reach, or rays alone bound it.

`write_carving` and `read_carving` write a fitted model to one file and read it.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pyproj import CRS
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import binary_dilation, distance_transform_edt

from survey.core import BoolArray, FloatArray, IntArray, validated
from survey.data import SurfacePoints
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.carving.config import SpaceCarvingConfig, raster_step_m
from survey.reconstruction.carving.descent import (
    MOST_PER_POINT,
    Bases,
    Columns,
    Fresh,
    LevelCells,
    Rasters,
    Step,
    Tally,
    Visited,
    descend,
)
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.line_of_sight.returns import ends_far_below
from survey.reconstruction.nodes import NodeWindow
from survey.reconstruction.terrain_map import INTERPOLATED, MEASURED, RAY_BOUNDED, UNSEEN

_TILE_M = 48.0


class CarvingFrame(NamedTuple):
    """Where a frame is: its south-west corner in nodes of its raster, the level of heights, CRS and vertical datum."""

    west: int
    south: int
    step_m: float
    datum_m: float
    crs: CRS
    vertical_datum: str

    @property
    def corner(self) -> FloatArray:
        """Easting, northing and height [m] of the frame's origin."""
        return np.array([self.west * self.step_m, self.south * self.step_m, self.datum_m])


class Vote(NamedTuple):
    """The heights (H, W) below which lines of sight are outvoted by others [m], on nodes so far apart from (0, 0) [m]."""

    outvoted: FloatArray
    step_m: float


class SightLines(NamedTuple):
    """Hits and sensors (N, 3) [m], errors of the heights (N,) [m], how deep under a surface each line of sight may run (N,) [m], and the vote.

    `gated` states whether lines of sight that end far below the surface are rejected.
    """

    xyz: FloatArray
    origins: FloatArray
    sigma_m: FloatArray
    slack_m: FloatArray
    vote: Vote
    gated: bool

    def accepted(self, heights: FloatArray) -> BoolArray:
        """Return which lines of sight (N,) are accepted, given the surface's heights at their ends (N,) [m]."""
        if not self.gated:
            return np.ones(len(heights), dtype=bool)
        return ~ends_far_below(heights - self.xyz[:, 2], self.sigma_m)


@dataclass
class Cloud:
    """Hits and sensors (N, 3) in the frame's coordinates [m], errors of the heights (N,) [m], and who is held back for validation."""

    xyz: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    origins: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    sigma_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    held: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __len__(self) -> int:
        return len(self.xyz)

    def add(self, points: SurfacePoints, place: CarvingFrame, held: BoolArray) -> None:
        """Add points; a point without a sensor counts as its own sensor."""
        origins = points.xyz if points.origins is None else points.origins
        self.xyz = np.concatenate([self.xyz, points.xyz - place.corner])
        self.origins = np.concatenate([self.origins, origins - place.corner])
        self.sigma_m = np.concatenate([self.sigma_m, points.sigma_z])
        self.held = np.concatenate([self.held, held])

    def move(self, by: FloatArray) -> None:
        """Shift everything eastwards and northwards."""
        self.xyz[:, :2] += by
        self.origins[:, :2] += by

    def sights(
        self, visited: IntArray, config: SpaceCarvingConfig, size_m: tuple[float, float]
    ) -> "SightLines":
        """Return what a pass goes over, in a frame of this width and height."""
        xyz, origins, sigma_m = self.xyz[visited], self.origins[visited], self.sigma_m[visited]
        slack_m = np.maximum(config.ray_sigmas * sigma_m, config.dead_band_m)
        gated = config.carve and config.gate
        vote = Vote(np.full((1, 1), -np.inf), config.last_length_m)
        if gated:
            window = NodeWindow.over((0.0, 0.0, *size_m), config.last_length_m)
            rays = LowestRays.empty(window.shape)
            rays.add(window, origins, xyz, np.zeros(len(xyz)))
            vote = Vote(rays.outvoted(), window.step_m)
        return SightLines(xyz, origins, sigma_m, slack_m, vote, gated)

    def shuffled(
        self, visited: IntArray, rng: np.random.Generator, rng_of_tiles: np.random.Generator
    ) -> IntArray:
        """Return an order in which to visit points: at random, tile by tile, and the tiles at random too.

        Points farther apart than a kernel is wide do not affect one another; keeping to one
        tile keeps its bases at hand, whatever the size of the map.
        """
        order = rng.permutation(len(visited))
        tile = np.floor(self.xyz[visited, :2] / _TILE_M).astype(np.int64)
        tile -= tile.min(axis=0)
        # By one number each: to sort pairs takes as long as a pass.
        number = np.unique(tile[:, 0] * (tile[:, 1].max() + 1) + tile[:, 1], return_inverse=True)[1]
        rank = rng_of_tiles.permutation(int(number.max()) + 1)
        return order[np.argsort(rank[number[order]], kind="stable")]

    def learned_from(self, first: int = 0) -> IntArray:
        """Return the numbers of the points from one on that are not held back."""
        return first + np.flatnonzero(~self.held[first:])

    def within_reach(self, first_new: int, reach_m: float) -> IntArray:
        """Return the numbers of the older points that lie in a square of this side with a new one, or in one beside it."""
        square = np.floor(self.xyz[:, :2] / reach_m).astype(np.int64)
        low = square.min(axis=0)
        square -= low
        touched = np.zeros(square.max(axis=0) + 1, dtype=bool)
        touched[tuple(square[first_new:].T)] = True
        near = binary_dilation(touched, np.ones((3, 3), dtype=bool))[tuple(square[:first_new].T)]
        return np.flatnonzero(near & ~self.held[:first_new])


# Nodes per length scale of a pass's own raster.
_NODES = 8.0
_DEGREE = 3


class Frame(NamedTuple):
    """The rectangle from (0, 0) that a surface covers: its size [m], the cells of its levels, its raster's step [m]."""

    width_m: float
    height_m: float
    cells: LevelCells
    step_m: float

    @classmethod
    def over(cls, width_m: float, height_m: float, lengths_m: FloatArray) -> "Frame":
        """Return the frame of a rectangle for levels of these length scales."""
        return cls(width_m, height_m, LevelCells.over(lengths_m, width_m, height_m), raster_step_m(lengths_m))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the raster; one node more than the rectangle needs on two sides."""
        return int(np.ceil(self.height_m / self.step_m)) + 2, int(np.ceil(self.width_m / self.step_m)) + 2


class RasterBlock(NamedTuple):
    """A part of a raster: first row and column, rows and columns."""

    south: int
    west: int
    rows: int
    columns: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """The part's rows and columns."""
        return slice(self.south, self.south + self.rows), slice(self.west, self.west + self.columns)


@dataclass
class CarvedSurface:
    """A surface f(x) = prior + Σ α k(x, x_j), in the coordinates of its frame.

    `frame`: what it covers. `step`: parameters of a pass. `settled`, `latest`: what earlier runs and this run
    have learned. `raster` (H, W): both on the frame's nodes [m], where lines of sight carve.
    """

    frame: Frame
    step: Step
    settled: Bases
    latest: Bases
    raster: FloatArray
    before: FloatArray = field(default_factory=lambda: np.zeros(0))
    known: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Heights at the points that this run visits, by earlier runs and by this one."""

    @classmethod
    def new(cls, frame: Frame, step: Step) -> "CarvedSurface":
        """Return a surface without bases."""
        none = Bases.none(frame.cells)
        return cls(frame, step, none, none, np.zeros(frame.shape if step.carve else (2, 2)))

    def heights(self, xy: FloatArray) -> FloatArray:
        """Return heights at places (N, 2)."""
        return self.step.prior_m + self.settled.heights(xy) + self.latest.heights(xy)

    def latest_heights(self) -> FloatArray:
        """Return the heights at the points that this run visits."""
        return self.step.prior_m + self.before + self.known

    def bases(self) -> Bases:
        """Return all bases."""
        return self.settled.merged(self.latest.columns()) if self.latest.n else self.settled

    def settle(self, step: Step) -> None:
        """Close a run; the next one uses `step`."""
        self.settled, self.latest, self.step = self.bases(), Bases.none(self.frame.cells), step
        self.before = self.known = np.zeros(0)

    def move(self, frame: Frame, east: int, north: int) -> None:
        """Take another frame, whose first node lies so many nodes west and south of this one's."""
        by = east * self.frame.step_m, north * self.frame.step_m
        self.settled, self.latest = self.settled.on(frame.cells, *by), self.latest.on(frame.cells, *by)
        if self.step.carve:
            raster = np.zeros(frame.shape)
            rows, columns = self.raster.shape
            raster[north : north + rows, east : east + columns] = self.raster
            self.raster = raster
        self.frame = frame

    def learn(self, sights: SightLines, order: IntArray, level: int, first_step: int) -> Tally:
        """Make one pass over points with kernels of one level."""
        xyz, origins = sights.xyz, sights.origins
        self._meet(xyz[len(self.known) :])
        visited = Visited(
            xyz,
            origins,
            sights.slack_m,
            sights.accepted(self.latest_heights()),
            sights.vote.outvoted,
            sights.vote.step_m,
            self.before,
            self.known,
            self.settled,
            self.latest,
        )
        fresh = Fresh.on(self.frame.cells, level, len(order) * (MOST_PER_POINT if self.step.carve else 1))
        block = self._block(xyz, origins, fresh.length_m)
        rasters = self._rasters(fresh.length_m, block)
        tally = descend(visited, order, first_step, fresh, rasters, self.step)
        added = Bases.none(self.frame.cells).merged(fresh.taken(level))
        self.known = tally.decayed * (self.known + added.heights(xyz[:, :2]))
        joined = self.latest.merged(added.columns())
        self.latest = joined._replace(weight=tally.decayed * joined.weight)
        if self.step.carve:
            self.raster[block.slices] += tally.decayed * self._refined(rasters, block)
        return tally

    def _meet(self, new: FloatArray) -> None:
        """Find the heights at points that this run has not visited."""
        if len(new):
            self.before = np.concatenate([self.before, self.settled.heights(new[:, :2])])
            self.known = np.concatenate([self.known, self.latest.heights(new[:, :2])])

    def _block(self, xyz: FloatArray, origins: FloatArray, reach_m: float) -> RasterBlock:
        """Return the part of the raster that a pass over points can change, with their sensors as far as they are in the frame."""
        if not self.step.carve:
            return RasterBlock(0, 0, 2, 2)
        size = np.array([self.frame.width_m, self.frame.height_m])
        both = np.concatenate([xyz[:, :2], np.clip(origins[:, :2], 0.0, size)])
        low = np.floor(np.maximum(both.min(axis=0) - reach_m, 0.0) / self.frame.step_m).astype(int)
        high = np.ceil(np.minimum(both.max(axis=0) + reach_m, size) / self.frame.step_m).astype(int) + 1
        columns, rows = high - low + 1
        return RasterBlock(int(low[1]), int(low[0]), int(rows), int(columns))

    def _rasters(self, length_m: float, block: RasterBlock) -> Rasters:
        """Return the rasters of a pass: all before it, and an empty one as fine as its kernels need."""
        step_m = max(length_m / _NODES, self.frame.step_m)
        ratio = self.frame.step_m / step_m
        shape = (
            max(int(np.ceil((block.rows - 1) * ratio - 1e-9)) + 1, _DEGREE + 1),
            max(int(np.ceil((block.columns - 1) * ratio - 1e-9)) + 1, _DEGREE + 1),
        )
        corner = block.west * self.frame.step_m, block.south * self.frame.step_m
        highest = np.array([float(self.raster[block.slices].max()), 0.0])
        return Rasters(self.raster, self.frame.step_m, np.zeros(shape), step_m, *corner, highest)

    def _refined(self, rasters: Rasters, block: RasterBlock) -> FloatArray:
        """Return what a pass added on the fine nodes of its block."""
        if rasters.coarse_step_m == rasters.fine_step_m:
            return rasters.coarse[: block.rows, : block.columns]
        rows, columns = rasters.coarse.shape
        spline = RectBivariateSpline(
            np.arange(rows) * rasters.coarse_step_m,
            np.arange(columns) * rasters.coarse_step_m,
            rasters.coarse,
        )
        refined: FloatArray = spline(
            np.arange(block.rows) * rasters.fine_step_m, np.arange(block.columns) * rasters.fine_step_m
        )
        return refined


class Pass(NamedTuple):
    """What one pass of the mean surface did."""

    length_m: float
    n_point_bases: int
    n_ray_bases: int
    gradient_m: float
    """Mean violation beyond the dead-band [m]."""
    loss_m2: float
    """Mean of r (Eq. 9) as the pass met it [m²]."""
    validation_rmse_m: float
    """Of the points held back [m]; NaN without any."""


def pass_of(tally: Tally, length_m: float, validationrmse_m: float) -> Pass:
    """Return what a tally amounts to per step."""
    n = max(tally.n_steps, 1)
    return Pass(
        length_m, tally.n_points, tally.n_rays, tally.gradient_m / n, tally.loss_m2 / n, validationrmse_m
    )


Codes = npt.NDArray[np.uint8]


def support_of_nodes(window: NodeWindow, cloud: Cloud, reach_m: float, *, rays: bool) -> Codes:
    """Return the support codes (H, W) of nodes: a point within half a step, rays over it, a point within reach.

    `reach_m`: distance within which a point determines the surface [m].
    """
    hit = np.zeros(window.shape, dtype=bool)
    u, v = np.round(window.coordinates(cloud.xyz[:, :2])).astype(np.int64).T
    hit[np.clip(v, 0, window.rows - 1), np.clip(u, 0, window.columns - 1)] = True
    away_m: FloatArray = window.step_m * distance_transform_edt(~hit)
    codes = np.where(away_m <= reach_m, INTERPOLATED, UNSEEN)
    if rays:
        lowest = LowestRays.empty(window.shape)
        lowest.add(window, cloud.origins, cloud.xyz, np.zeros(len(cloud)))
        codes = np.where(lowest.covered(), RAY_BOUNDED, codes)
    return np.where(hit, MEASURED, codes).astype(np.uint8)


_FORMAT = "firnline space-carving kernels 1"


class CarvingState(NamedTuple):
    """Everything that a fitted space-carving model is made of."""

    config: SpaceCarvingConfig
    where: CarvingFrame
    frame: Frame
    cloud: Cloud
    surfaces: dict[str, CarvedSurface]
    spread_m: float
    n_scans: int
    n_ghosts: int
    n_learned: int


def write_carving(path: str | Path, model: CarvingState) -> None:
    """Write a model; equal models give equal bytes."""
    where, cloud = model.where, model.cloud
    facts = {
        "config": model.config.model_dump(),
        "place": [where.west, where.south, where.step_m, where.datum_m],
        "crs": where.crs.to_wkt(),
        "vertical_datum": where.vertical_datum,
        "size_m": [model.frame.width_m, model.frame.height_m],
        "spread_m": model.spread_m,
        "n_scans": model.n_scans,
        "n_ghosts": model.n_ghosts,
        "n_learned": model.n_learned,
        "steps": {name: list(surface.step) for name, surface in model.surfaces.items()},
    }
    arrays: dict[str, Any] = {
        "hits": cloud.xyz,
        "origins": cloud.origins,
        "sigma_m": cloud.sigma_m,
        "held": cloud.held,
    }
    for name, surface in model.surfaces.items():
        arrays |= {f"{name}_{column}": v for column, v in surface.bases().columns()._asdict().items()}
        arrays[f"{name}_raster"] = surface.raster
    write_arrays(path, _FORMAT, facts, arrays)


def read_carving(path: str | Path) -> CarvingState:
    """Read what `write_carving` wrote."""
    facts, arrays = read_arrays(path, _FORMAT)
    config = validated(SpaceCarvingConfig, facts["config"], "the settings of the space-carving kernels")
    crs = CRS.from_wkt(facts["crs"])
    width_m, height_m = facts["size_m"]
    frame = Frame.over(width_m, height_m, config.lengths_m())
    west, south, step_m, datum_m = facts["place"]
    none = Bases.none(frame.cells)
    surfaces = {
        name: CarvedSurface(
            frame,
            Step(*step),
            none.merged(Columns(*(arrays[f"{name}_{column}"] for column in Columns._fields))),
            none,
            arrays[f"{name}_raster"],
        )
        for name, step in facts["steps"].items()
    }
    return CarvingState(
        config,
        CarvingFrame(west, south, step_m, datum_m, crs, facts["vertical_datum"]),
        frame,
        Cloud(arrays["hits"], arrays["origins"], arrays["sigma_m"], arrays["held"]),
        surfaces,
        facts["spread_m"],
        facts["n_scans"],
        facts["n_ghosts"],
        facts["n_learned"],
    )
