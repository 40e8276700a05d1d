"""One surface that learns from points and lines of sight, pass by pass."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.carving.bases import Bases, Fresh, LevelCells
from survey.reconstruction.carving.cloud import SightLines
from survey.reconstruction.carving.descent import MOST_PER_POINT, Rasters, Step, Tally, Visited, descend
from survey.reconstruction.carving.room import raster_step_m

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

    Parameters
    ----------
    frame : Frame
        What it covers.
    step : Step
        Parameters of a pass.
    settled, latest : Bases
        What earlier runs and this run have learned.
    raster : (H, W) ndarray
        Both on the frame's nodes [m], where lines of sight carve.
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
