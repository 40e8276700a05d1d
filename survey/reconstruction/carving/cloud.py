"""Points of a space-carving model in the coordinates of its frame."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from pyproj import CRS
from scipy.ndimage import binary_dilation

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.line_of_sight.sight_lines import ends_far_below
from survey.reconstruction.nodes import NodeWindow

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
