"""Spinning LiDAR on the rover: ray casting against the fine terrain.

The scanner turns while the rover moves, so every point has its own time and origin.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from pyproj import CRS
from scipy.spatial.transform import Rotation, Slerp

from sim.world.scenery import FineTerrain
from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory


@dataclass(frozen=True)
class Scanner:
    """Spinning LiDAR: beams, range, errors.

    Parameters
    ----------
    elevation_deg : tuple of float
        Angles of the beams above the scanner's plane [deg].
    n_columns : int
        Directions per turn.
    turn_s : float
        Time of a turn [s].
    farthest_m : float
        Range at which a matt white surface, hit squarely, returns in 63 % of the cases [m].
    range_sigma_m : float
        Standard deviation of a range [m].
    ghost_share : float
        Share of the returns that are not from the ground: half of them short (blowing
        snow), half long (reflected twice), which places them below it.
    height_m : float
        Above the body's origin [m].
    """

    elevation_deg: tuple[float, ...]
    n_columns: int
    turn_s: float = 0.1
    farthest_m: float = 120.0
    range_sigma_m: float = 0.03
    ghost_share: float = 0.0
    height_m: float = 1.0

    @classmethod
    def os1_64(cls) -> "Scanner":
        """Ouster OS1-64 at 512 columns: 64 beams over ±22.5°, 512 × 64 rays a turn."""
        return cls(tuple(np.linspace(22.5, -22.5, 64).tolist()), 512)

    @classmethod
    def hdl_64(cls) -> "Scanner":
        """Velodyne HDL-64: 32 beams from 2° to -8.33° and 32 from -8.83° to -24.33°, 2083 columns."""
        upper, lower = np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.33, 32)
        return cls((*upper.tolist(), *lower.tolist()), 2083, range_sigma_m=0.02)

    def rays(self) -> FloatArray:
        """Return the unit directions (n_columns, n_beams, 3) in the body's frame; columns turn counter-clockwise."""
        azimuth = 2.0 * np.pi * np.arange(self.n_columns)[:, None] / self.n_columns
        up = np.radians(self.elevation_deg)[None]
        return np.stack(
            [np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up) + 0.0 * azimuth], axis=-1
        )


class Scan(NamedTuple):
    """The returns of one turn.

    ``time_s`` (N,) of each; ``beam`` (N,) index of its beam; ``offset`` (N, 3) [m] in the
    body's frame at that time, as measured; ``origin`` (N, 3) where the scanner
    was then and ``hit`` (N, 3) where that puts the point in the world, both with the real
    pose; ``is_ghost`` (N,) marks returns that are not from the ground.
    """

    time_s: FloatArray
    beam: IntArray
    offset: FloatArray
    origin: FloatArray
    hit: FloatArray
    is_ghost: npt.NDArray[np.bool_]

    def surface_points(self, scanner: Scanner, crs: CRS, vertical_datum: str = "") -> SurfacePoints:
        """Return the hits as points on the terrain, the range's error along each ray, 1 mm across it."""
        ray = self.hit - self.origin
        range_m = np.linalg.norm(ray, axis=1)
        ray = ray / range_m[:, None]
        outer = ray[:, :, None] * ray[:, None, :]
        covariance = scanner.range_sigma_m**2 * outer + 1e-6 * np.eye(3)
        return SurfacePoints(
            self.hit,
            covariance,
            origins=self.origin,
            range_m=range_m,
            crs=crs,
            vertical_datum=vertical_datum,
        )


def scan(
    ground: FineTerrain, scanner: Scanner, trajectory: Trajectory, from_s: float, *, seed: int, index: int = 0
) -> Scan:
    r"""Scan one turn from a moving rover.

    A beam that meets the ground at range r under the angle θ from its normal returns with
    the probability

    .. math:: P = 1 - \exp(-\cos\theta \, (r_{max} / r)^2)

    so that grazing and far ground drops out.

    Parameters
    ----------
    ground : FineTerrain
        What is scanned.
    scanner : Scanner
        Beams and errors.
    trajectory : Trajectory
        The real motion.
    from_s : float
        When the turn begins [s].
    seed, index : int
        The mission's seed and the number of the scan: equal ones give equal scans.

    Raises
    ------
    InputError
        The trajectory does not cover the turn, or the scanner is not above the ground.

    Notes
    -----
    Beams are lines without width: an edge never splits a beam's footprint in two returns.
    """
    time_s = from_s + scanner.turn_s * np.arange(scanner.n_columns) / scanner.n_columns
    if time_s[0] < trajectory.time_s[0] or time_s[-1] > trajectory.time_s[-1]:
        raise InputError(
            f"the scan from {from_s:.2f} s is not within the drive ({trajectory.time_s[0]:.2f} to "
            f"{trajectory.time_s[-1]:.2f} s); choose another time."
        )
    attitude, origin = _poses(trajectory, time_s, scanner)
    if not (ground.elevation(origin[:, :2]) < origin[:, 2]).all():
        raise InputError(
            f"the scanner is not above the ground at {from_s:.2f} s; raise it or stay on the map."
        )
    rays = scanner.rays()
    directions = np.einsum("cij,cbj->cbi", attitude, rays)
    range_m, cosine = np.empty(rays.shape[:2]), np.empty(rays.shape[:2])
    low = np.array([*ground.origin, float(ground.height.mean(dtype=np.float64))])
    heights = np.ascontiguousarray(ground.height[::-1]).astype(np.float64) - low[2]
    _cast(heights, ground.step_m, origin - low, directions, 1.5 * scanner.farthest_m, range_m, cosine)
    rng = stream(seed, "lidar", index)
    column, beam, measured_m, is_ghost = _returns(scanner, range_m, cosine, rng)
    offset = measured_m[:, None] * rays[column, beam] + [0.0, 0.0, scanner.height_m]
    hit = origin[column] + measured_m[:, None] * directions[column, beam]
    return Scan(time_s[column], beam, offset, origin[column], hit, is_ghost)


def _poses(trajectory: Trajectory, time_s: FloatArray, scanner: Scanner) -> tuple[FloatArray, FloatArray]:
    """Return attitude (N, 3, 3) and place of the scanner (N, 3) at times."""
    attitude = Slerp(trajectory.time_s, Rotation.from_quat(trajectory.quaternion))(time_s)
    place = np.column_stack([np.interp(time_s, trajectory.time_s, axis) for axis in trajectory.position.T])
    return attitude.as_matrix(), place + attitude.apply([0.0, 0.0, scanner.height_m])


def _returns(
    scanner: Scanner, range_m: FloatArray, cosine: FloatArray, rng: np.random.Generator
) -> tuple[IntArray, IntArray, FloatArray, npt.NDArray[np.bool_]]:
    """Draw which beams return and at what range; all are drawn for, so that one beam changes no other."""
    chance, kind = rng.random(range_m.shape), rng.random(range_m.shape)
    share, noise = rng.random(range_m.shape), rng.standard_normal(range_m.shape)
    met = np.isfinite(range_m)
    reach = np.where(met, range_m, 1.0)
    returned = met & (chance < 1.0 - np.exp(-cosine * (scanner.farthest_m / reach) ** 2))
    ghost = kind < scanner.ghost_share
    in_the_air = 0.2 * reach + 0.7 * reach * share
    behind = reach * (1.05 + share)
    measured = np.where(ghost, np.where(kind < 0.5 * scanner.ghost_share, in_the_air, behind), reach)
    measured = measured + scanner.range_sigma_m * noise
    column, beam = np.nonzero(returned & (measured > 0.0))
    return column, beam, measured[column, beam], ghost[column, beam]


@njit(cache=True)
def _cast(
    height: FloatArray,
    step_m: float,
    origin: FloatArray,
    directions: FloatArray,
    farthest_m: float,
    range_m: FloatArray,
    cosine: FloatArray,
) -> None:
    """Ranges and cosines of incidence of rays on bilinear cells; the first row of `height` is the southern one."""
    highest = height.max()
    for c in range(directions.shape[0]):
        for b in range(directions.shape[1]):
            d = directions[c, b]
            start = 0.0
            if origin[c, 2] > highest:
                start = (origin[c, 2] - highest) / -d[2] if d[2] < 0.0 else np.inf
            range_m[c, b], cosine[c, b] = _first_hit(height, step_m, origin[c], d, start, farthest_m, highest)


@njit(cache=True)
def _first_hit(
    height: FloatArray,
    step_m: float,
    origin: FloatArray,
    ray: FloatArray,
    start_m: float,
    farthest_m: float,
    highest: float,
) -> tuple[float, float]:
    """Walk along a ray cell by cell; each cell's surface meets it where a quadratic is 0."""
    rows, columns = height.shape
    t = start_m
    while t < farthest_m:
        x, y = (origin[0] + t * ray[0]) / step_m, (origin[1] + t * ray[1]) / step_m
        if origin[2] + t * ray[2] > highest and ray[2] >= 0.0:
            break
        # On an edge the cell ahead counts.
        i = int(np.floor(x + 1e-9 * np.sign(ray[0])))
        j = int(np.floor(y + 1e-9 * np.sign(ray[1])))
        if i < 0 or j < 0 or i >= columns - 1 or j >= rows - 1:
            break
        t_out = min(_leave(x, i, ray[0] / step_m), _leave(y, j, ray[1] / step_m)) + t
        z00, z10, z01, z11 = height[j, i], height[j, i + 1], height[j + 1, i], height[j + 1, i + 1]
        u, v = x - i, y - j
        du, dv = ray[0] / step_m, ray[1] / step_m
        along_u, along_v, twist = z10 - z00, z01 - z00, z11 - z10 - z01 + z00
        a = -twist * du * dv
        slope = along_u * du + along_v * dv + twist * (u * dv + v * du)
        gap = origin[2] + t * ray[2] - (z00 + along_u * u + along_v * v + twist * u * v)
        s = _root(a, ray[2] - slope, gap, t_out - t)
        if s >= 0.0:
            gx = (along_u + twist * (v + s * dv)) / step_m
            gy = (along_v + twist * (u + s * du)) / step_m
            square = (ray[0] * gx + ray[1] * gy - ray[2]) / np.sqrt(1.0 + gx * gx + gy * gy)
            return t + s, max(square, 0.0)
        t = t_out + 1e-9
    return np.inf, 0.0


@njit(cache=True)
def _leave(x: float, i: int, dx: float) -> float:
    """Distance along a ray until it leaves the cell [i, i + 1] on one axis."""
    if dx > 0.0:
        return (i + 1 - x) / dx
    if dx < 0.0:
        return (i - x) / dx
    return np.inf


@njit(cache=True)
def _root(a: float, b: float, c: float, farthest: float) -> float:
    """First root of a s² + b s + c in [0, farthest], or -1; c at or below 0 is a hit on the spot."""
    if c <= 0.0:
        return 0.0
    if abs(a) < 1e-14:
        s = -c / b if b < 0.0 else np.inf
        return s if s <= farthest else -1.0
    root = b * b - 4.0 * a * c
    if root < 0.0:
        return -1.0
    q = -0.5 * (b + np.copysign(np.sqrt(root), b))
    first, second = q / a, (c / q if q != 0.0 else np.inf)
    if first > second:
        first, second = second, first
    for s in (first, second):
        if 0.0 <= s <= farthest:
            return s
    return -1.0
