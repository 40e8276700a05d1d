"""Experiment of the carving paper on synthetic terrain: five terrains scanned by a Velodyne HDL-64.

The paper's scans are not to be had. Five terrains stand for its five: rough ground falling by 5°,
hills, piles of rubble, nearly flat and flat ground, 30 × 30 m, seen from 2.2 m above the ground.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from papers.emap.world import RasterHeights
from survey import Grid, SurfacePoints
from survey.core import FloatArray, projected_crs, stream
from survey.data.sensors.lidar import Scanner
from survey.reconstruction.nodes import bilinear
from survey.terrain.random_fields import fractional_brownian, squared_exponential_field

HALF_M = 15.0
SENSOR_HEIGHT_M, NOISE_M = 2.2, 0.02
N_TRAIN, N_TEST, N_GRID = 10_000, 5_000, 60
VIEWS = ((0.0, 0.0), (8.0, 5.0), (-6.0, 8.0))
"""Places of the sensor [m]: the first one alone or all three."""
CRS = projected_crs("EPSG:32608", "the study")
_MARGIN_M, _STEP_M = 3.0, 0.1
_FARTHEST_M = 32.0

Rng = np.random.Generator


@dataclass(frozen=True)
class CarvingWorld:
    """Synthetic terrain.

    `name`: what it is. `field`: its heights, as the rays meet them.
    """

    name: str
    field: RasterHeights

    @classmethod
    def new(cls, name: str, seed: int) -> "CarvingWorld":
        """Return one of the five terrains."""
        side = HALF_M + _MARGIN_M
        grid = Grid((-side, -side, side, side), _STEP_M, CRS)
        east, north = np.meshgrid(grid.x, grid.y)
        z = TERRAINS[name](grid, east, north, stream(seed, "carving", name))
        field = RasterHeights(np.ascontiguousarray(z[::-1]), _STEP_M, float(grid.x[0]), float(grid.y[-1]))
        return cls(name, field)

    def heights(self, xy: FloatArray) -> FloatArray:
        """Return the ground's height (N,) [m]."""
        corner = np.array([self.field.west_m, self.field.south_m])
        return bilinear(self.field.z, (xy - corner) / self.field.step_m)

    def sensor(self, place: tuple[float, float]) -> FloatArray:
        """Return the position (3,) of the sensor at a place [m]."""
        return np.array([*place, float(self.heights(np.array([place]))[0]) + SENSOR_HEIGHT_M])

    def scan(self, views: tuple[tuple[float, float], ...], rng: Rng, clutter_m: float = 0.0) -> SurfacePoints:
        """Return the hits within the square of one turn of an HDL-64 at every place, ranges off by Gaussian noise.

        `clutter_m`: standard deviation of the heights of hits on what stands on the ground [m].
        """
        directions = Scanner.hdl_64().rays().reshape(-1, 3)
        hits, origins = [], []
        for place in views:
            sensor = self.sensor(place)
            reached = self.field.hits(sensor, directions, _FARTHEST_M)
            met = np.isfinite(reached)
            measured = reached[met] + NOISE_M * rng.standard_normal(int(met.sum()))
            xyz = sensor + measured[:, None] * directions[met]
            if clutter_m > 0.0:
                xyz[:, 2] += clutter_m * rng.standard_normal(len(xyz))
            within = (np.abs(xyz[:, :2]) < HALF_M).all(axis=1)
            hits.append(xyz[within])
            origins.append(np.broadcast_to(sensor, hits[-1].shape))
        return SurfacePoints(np.concatenate(hits), sigma_m=NOISE_M, origins=np.concatenate(origins), crs=CRS)


@dataclass(frozen=True)
class ScanTrial:
    """Training points, test points of the same scan, and the ground on a regular grid (3600, 3)."""

    world: CarvingWorld
    train: SurfacePoints
    test: SurfacePoints
    reference: FloatArray

    @classmethod
    def new(
        cls,
        name: str,
        seed: int,
        *,
        n_views: int = 1,
        n_train: int = N_TRAIN,
        n_test: int = N_TEST,
        clutter_m: float = 0.0,
    ) -> "ScanTrial":
        """Scan a terrain with clutter of this standard deviation [m], and split its hits."""
        world = CarvingWorld.new(name, seed)
        rng = stream(seed, "carving", name, "scan", n_views)
        points = world.scan(VIEWS[:n_views], rng, clutter_m)
        order = rng.permutation(len(points))
        rank = np.argsort(order)
        train = points.select(rank < n_train)
        test = points.select((rank >= n_train) & (rank < n_train + n_test))
        step_m = 2.0 * HALF_M / N_GRID
        across = -HALF_M + step_m * (0.5 + np.arange(N_GRID))
        xy = np.column_stack([axis.ravel() for axis in np.meshgrid(across, across)])
        return cls(world, train, test, np.column_stack([xy, world.heights(xy)]))

    @property
    def sensor_height_m(self) -> float:
        """Height of the first place the sensor stood at [m]."""
        return float(self.world.sensor(VIEWS[0])[2])

    def errors(self, predict: Callable[[FloatArray], FloatArray]) -> tuple[float, float]:
        """Return the mean square errors [m²] on the test points and on the grid (Eq. 14)."""
        on_test = predict(self.test.xy) - self.test.z
        on_grid = predict(self.reference[:, :2]) - self.reference[:, 2]
        return float(np.mean(on_test**2)), float(np.mean(on_grid**2))


def _rough(grid: Grid, rng: Rng, relief_m: float) -> FloatArray:
    z: FloatArray = fractional_brownian(grid, rng, relief_m=relief_m, hurst=0.6).elevation
    return z - float(np.median(z))


def _rubble(east: FloatArray, north: FloatArray, rng: Rng, n: int) -> FloatArray:
    """Return heaps 0.3 to 1.5 m high, as steep as loose blocks lie."""
    z = np.zeros_like(east)
    side = HALF_M + _MARGIN_M
    for (x, y), height in zip(rng.uniform(-side, side, (n, 2)), rng.uniform(0.3, 1.5, n), strict=True):
        z = np.maximum(z, height - 1.2 * np.hypot(east - x, north - y))
    return z


def _downhill(grid: Grid, east: FloatArray, north: FloatArray, rng: Rng) -> FloatArray:
    falling = -np.tan(np.radians(5.0)) * east
    ground: FloatArray = falling + _rough(grid, rng, 3.0) + _rubble(east, north, rng, 90)
    return ground


def _hilly(grid: Grid, east: FloatArray, north: FloatArray, rng: Rng) -> FloatArray:
    hills = squared_exponential_field(grid, rng, relief_m=3.0, length_scale_m=4.0).elevation
    return hills - float(np.median(hills)) + _rough(grid, rng, 1.8) + _rubble(east, north, rng, 90)


def _piles(grid: Grid, east: FloatArray, north: FloatArray, rng: Rng) -> FloatArray:
    return _rough(grid, rng, 1.2) + _rubble(east, north, rng, 135)


def _nearly_flat(grid: Grid, east: FloatArray, north: FloatArray, rng: Rng) -> FloatArray:  # noqa: ARG001
    return _rough(grid, rng, 0.3)


def _flat(grid: Grid, east: FloatArray, north: FloatArray, rng: Rng) -> FloatArray:  # noqa: ARG001
    return _rough(grid, rng, 0.05)


TERRAINS: dict[str, Callable[[Grid, FloatArray, FloatArray, Rng], FloatArray]] = {
    "downhill": _downhill,
    "hilly": _hilly,
    "piles": _piles,
    "nearly flat": _nearly_flat,
    "flat": _flat,
}
"""Five terrains that stand for the paper's five, rough ones first."""
