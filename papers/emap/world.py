"""Experiment of the EMap paper: a spinning scanner over sine hills, utility functions and scores.

Where the paper leaves something open, or prints it wrongly, our reading is stated beside it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import erf

from survey import InputError, SurfacePoints
from survey.core import BoolArray, FloatArray, projected_crs, stream

N_COLUMNS, N_BEAMS = 512, 64
HALF_VIEW_DEG = 22.5
RANGE_M = 10.0
NOISE_M = 0.05
# Not in the paper: the sensor's height above the mean plane, the number of scans, and their spacing.
SENSOR_HEIGHT_M = 2.0
N_SCANS, SCAN_STEP_M = 40, 0.5
N_RUNS = 10
CRS = projected_crs("EPSG:32608", "the study")

MIDDLE_M, THRESHOLD_M = 6.0, 4.0
NEAREST_M = 0.25

Height = Callable[[FloatArray], FloatArray]


def sine_hills(xy: FloatArray) -> FloatArray:
    """Return the paper's surface sin(x/π) sin(y/π) (N,) [m]."""
    heights: FloatArray = np.sin(xy[:, 0] / np.pi) * np.sin(xy[:, 1] / np.pi)
    return heights


@dataclass(frozen=True)
class RasterHeights:
    """Heights (H, W) [m] on a raster of equal steps, as the rays meet them.

    `z` (H, W): heights, rows northwards. `step_m`: spacing [m]. `west_m`, `south_m`: place of the first node
    [m].
    """

    z: FloatArray
    step_m: float
    west_m: float
    south_m: float

    @classmethod
    def of(
        cls, height: Height, bounds: tuple[float, float, float, float], step_m: float = 0.05
    ) -> "RasterHeights":
        """Sample a surface over ``(xmin, ymin, xmax, ymax)`` [m]."""
        x = np.arange(bounds[0], bounds[2] + step_m, step_m)
        y = np.arange(bounds[1], bounds[3] + step_m, step_m)
        east, north = np.meshgrid(x, y)
        z = height(np.column_stack([east.ravel(), north.ravel()])).reshape(east.shape)
        return cls(z, step_m, float(x[0]), float(y[0]))

    def hits(self, sensor: FloatArray, directions: FloatArray, farthest_m: float) -> FloatArray:
        """Return the distance (N,) along unit rays to the surface [m]; infinite where there is none."""
        start = np.array([(sensor[0] - self.west_m), (sensor[1] - self.south_m), sensor[2]])
        return _march(self.z, self.step_m, start, directions, farthest_m)


@njit(cache=True)
def _above(z: FloatArray, step_m: float, p: FloatArray) -> float:
    """Return the height of a point over the bilinear surface; infinite beyond it."""
    u, v = p[0] / step_m, p[1] / step_m
    i, j = int(np.floor(u)), int(np.floor(v))
    if i < 0 or j < 0 or i >= z.shape[1] - 1 or j >= z.shape[0] - 1:
        return np.inf
    s, t = u - i, v - j
    south = z[j, i] * (1 - s) + z[j, i + 1] * s
    north = z[j + 1, i] * (1 - s) + z[j + 1, i + 1] * s
    return float(p[2] - (south * (1 - t) + north * t))


@njit(cache=True)
def _march(
    z: FloatArray, step_m: float, start: FloatArray, directions: FloatArray, farthest_m: float
) -> FloatArray:
    """Step along every ray until it is below the surface, then bisect.

    No step is longer than the steepest slope of the raster allows, nor shorter than half a node.
    """
    reached = np.full(len(directions), np.inf)
    steepest = max(np.abs(z[:, 1:] - z[:, :-1]).max(), np.abs(z[1:] - z[:-1]).max()) / step_m * np.sqrt(2.0)
    highest = z.max()
    for k in range(len(directions)):
        ray = directions[k]
        closing = max(steepest * np.hypot(ray[0], ray[1]) - ray[2], 1e-3)
        before, gap = 0.0, _above(z, step_m, start)
        while before < farthest_m and not (ray[2] >= 0.0 and start[2] + before * ray[2] > highest):
            after = min(before + max(gap / closing, 0.5 * step_m), farthest_m)
            gap = _above(z, step_m, start + after * ray)
            if gap <= 0.0:
                for _ in range(24):
                    middle = 0.5 * (before + after)
                    if _above(z, step_m, start + middle * ray) <= 0.0:
                        after = middle
                    else:
                        before = middle
                reached[k] = after
                break
            before = after
    return reached


def beams() -> FloatArray:
    """Return the unit directions (N_COLUMNS · N_BEAMS, 3) of an OS1-64 with 512 columns."""
    azimuth = 2.0 * np.pi * np.arange(N_COLUMNS) / N_COLUMNS
    rise = np.radians(np.linspace(-HALF_VIEW_DEG, HALF_VIEW_DEG, N_BEAMS))
    turn, up = (angles.ravel() for angles in np.meshgrid(azimuth, rise))
    return np.column_stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])


def scan(
    field: RasterHeights, sensor: FloatArray, rng: np.random.Generator, sigma_m: float = NOISE_M
) -> SurfacePoints:
    """Return the points of one turn of the scanner within its range, each range off by Gaussian noise."""
    directions = beams()
    distance = field.hits(sensor, directions, RANGE_M)
    hit = np.isfinite(distance)
    measured = distance[hit] + sigma_m * rng.standard_normal(int(hit.sum()))
    xyz = sensor + measured[:, None] * directions[hit]
    origins = np.broadcast_to(sensor, xyz.shape)
    return SurfacePoints(xyz, sigma_m=sigma_m, origins=origins, crs=CRS)


@dataclass(frozen=True)
class EmapRun:
    """One run: along x at constant height, started at a y of its own (1 m apart from run to run)."""

    run: int = 0
    height: Height = sine_hills
    n_scans: int = N_SCANS
    sensor_height_m: float = SENSOR_HEIGHT_M

    def sensors(self) -> FloatArray:
        """Return the sensor's places (n_scans, 3) [m]."""
        x = SCAN_STEP_M * np.arange(self.n_scans)
        return np.column_stack([x, np.full_like(x, float(self.run)), np.full_like(x, self.sensor_height_m)])

    def scans(self) -> Iterator[tuple[FloatArray, SurfacePoints]]:
        """Yield the sensor's place and the scan taken there."""
        reach = RANGE_M + 1.0
        places = self.sensors()
        bounds = (-reach, self.run - reach, places[-1, 0] + reach, self.run + reach)
        field = RasterHeights.of(self.height, bounds)
        rng = stream(0, "emap", "run", self.run)
        for place in places:
            yield place, scan(field, place, rng)


def utilities(offset: FloatArray) -> dict[str, FloatArray]:
    r"""Return the four utility functions F (N,) of places (N, 2) relative to the sensor [m].

    Nearest (Eq. 5) is 1 within 0.25 m. Gaussian (Eq. 6) is read as
    :math:`\exp(-\frac12 (r - r_g)^2)`: with the printed r + r_g it is zero everywhere. CDF (Eq. 7) is
    read as :math:`1 - \frac12 (1 + \mathrm{erf}((r - r_s)/\sqrt 2))`: printed, it goes from 0.85 to 0.15.

    >>> F = utilities(np.array([[0.0, 0.0], [6.0, 0.0], [90.0, 0.0]]))
    >>> F["CDF"].round(3).tolist(), F["Gaussian"].round(3).tolist()
    ([1.0, 0.023, 0.0], [0.0, 1.0, 0.0])
    """
    r = np.hypot(*offset.T)
    return {
        "Raw": np.ones_like(r),
        "Nearest": (r < NEAREST_M).astype(np.float64),
        "Gaussian": np.exp(-0.5 * (r - MIDDLE_M) ** 2),
        "CDF": 1.0 - 0.5 * (1.0 + erf((r - THRESHOLD_M) / np.sqrt(2.0))),
    }


def weighted_mse_cm2(error_m: FloatArray, utility: FloatArray) -> float:
    r"""Return :math:`\sum e^2 F^2 / \sum F^2` [cm²]: the mean over the nodes that count (Eq. 4, normalised).

    >>> round(weighted_mse_cm2(np.array([0.1, 9.0]), np.array([1.0, 0.0])), 9)
    100.0
    """
    weight = utility**2
    total = float(weight.sum())
    if total <= 0.0:
        raise InputError(
            "the utility is 0 at every node, so that there is nothing to average; take a finer lattice or a wider utility."
        )
    return 1e4 * float(np.sum(error_m**2 * weight)) / total


def printed_mse_cm2(error_m: FloatArray, utility: FloatArray) -> float:
    """Return Eq. 4 as printed: the mean over all nodes, whatever they count [cm²]."""
    return 1e4 * float(np.mean((error_m * utility) ** 2))


def seen_gap_outside(nodes: FloatArray, sensor: FloatArray, seen: BoolArray) -> dict[str, BoolArray]:
    """Split nodes into those with points, those without within the range, and those beyond it."""
    within = np.hypot(*(nodes - sensor[:2]).T) <= RANGE_M
    return {"seen": seen, "gap": ~seen & within, "outside": ~seen & ~within}
