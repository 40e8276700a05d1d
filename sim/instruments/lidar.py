"""Simulated spinning LiDAR: rays on the real terrain, with noise, dropouts, ghosts and spray.

The rover moves while the scanner turns. Every pulse leaves from the real pose at its own time, in a direction that
differs from the nominal one by the error of the mounting and by a draw within its beam. It is returned by the terrain
where it meets it, unless the angle of incidence is too grazing for the distance. Some returns are lost, some have a
wrong range, and some come from snow that is blown about near the scanner. `HeightRaster` casts the rays on the bilinear
surface of the elevations, exact to rounding.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation, Slerp

from sim.config.mission import MissionConfig
from sim.config.sensors import LidarConfig
from sim.instruments.sensor import StatisticalDrive
from sim.vehicle.motion import exact_drive, poses_at_rest
from survey import Dem, Trajectory, Truth
from survey.core import FloatArray, stream
from survey.data.recording import table_file
from survey.data.sensors.lidar import LidarReturns, LidarScans, Scanner, minute_of, n_minutes

_FLAT = 1e-12


class Hits(NamedTuple):
    """Distances (N,) along rays to the surface [m], infinite where there is none, and cosines of incidence (N,)."""

    range_m: FloatArray
    cosine: FloatArray


class HeightRaster(NamedTuple):
    """Heights (H, W) [m] at cell centres, rows northwards, with the place of the first one and the spacing [m]."""

    z: FloatArray
    highest: FloatArray
    """Greatest height (H - 1, W - 1) of each patch between four centres [m], infinite where one is not known."""
    west_m: float
    south_m: float
    step_m: float

    @classmethod
    def of(cls, terrain: Dem) -> "HeightRaster":
        """Return the heights of a DEM of square cells; unknown cells are NaN."""
        (xmin, ymin, *_), step = terrain.grid().bounds, terrain.step_m
        z = np.ascontiguousarray(terrain.elevation[::-1])
        highest = np.max([z[:-1, :-1], z[:-1, 1:], z[1:, :-1], z[1:, 1:]], axis=0)
        return cls(z, np.where(np.isnan(highest), np.inf, highest), xmin, ymin, step)

    def hits(self, start: FloatArray, direction: FloatArray, farthest_m: float) -> Hits:
        """Return where rays from `start` (N, 3) [m] along unit vectors (N, 3) meet the surface from above.

        A ray that leaves the raster or reaches unknown ground meets nothing.
        """
        origin = np.array([self.west_m, self.south_m, 0.0])
        scale = np.array([1.0 / self.step_m, 1.0 / self.step_m, 1.0])
        top = float(np.nanmax(self.z))
        reached, cosine = _cast_rays(
            self.z,
            self.highest,
            np.ascontiguousarray((start - origin) * scale),
            np.ascontiguousarray(direction * scale),
            (farthest_m, self.step_m, top),
        )
        return Hits(reached, cosine)


@njit(cache=True)
def _cast_rays(
    z: FloatArray,
    highest: FloatArray,
    start: FloatArray,
    along: FloatArray,
    limits: tuple[float, float, float],
) -> tuple[FloatArray, FloatArray]:
    """Follow every ray from patch to patch; x and y count in nodes, distances in metres."""
    farthest_m, step_m, top = limits
    n_north, n_east = z.shape
    reached = np.full(len(start), np.inf)
    cosine = np.zeros(len(start))
    for k in range(len(start)):
        du, dv, dz = along[k]
        travelled = 0.0
        while travelled < farthest_m:
            u, v = start[k, 0] + du * travelled, start[k, 1] + dv * travelled
            height = start[k, 2] + dz * travelled
            # A ray on the edge between patches belongs to the one that it enters.
            i, j = int(np.floor(u + 1e-9 * du)), int(np.floor(v + 1e-9 * dv))
            if i < 0 or j < 0 or i >= n_east - 1 or j >= n_north - 1 or (dz >= 0.0 and height > top):
                break
            length = min(_to_edge(u - i, du), _to_edge(v - j, dv), farthest_m - travelled)
            # Most patches lie below the ray: the equation is solved only where the patch may reach it.
            if height + min(dz * length, 0.0) <= highest[j, i]:
                corners = z[j, i], z[j, i + 1], z[j + 1, i], z[j + 1, i + 1]
                if not np.isfinite(highest[j, i]):
                    break
                met = _root(corners, (u - i, v - j, height), (du, dv, dz), length)
                if met >= 0.0:
                    reached[k] = travelled + met
                    cosine[k] = _incidence(corners, u - i + du * met, v - j + dv * met, (du, dv, dz), step_m)
                    break
            travelled += length + 1e-9
    return reached, cosine


@njit(cache=True, inline="always")
def _to_edge(inside: float, along: float) -> float:
    """Return the distance to the edge of the patch in one direction."""
    if along > _FLAT:
        return max((1.0 - inside) / along, 0.0)
    if along < -_FLAT:
        return max(inside / -along, 0.0)
    return np.inf


@njit(cache=True, inline="always")
def _root(
    corners: tuple[float, float, float, float],
    start: tuple[float, float, float],
    along: tuple[float, float, float],
    length: float,
) -> float:
    """Return the first distance at which a ray is at or below the patch, or -1; its height there is quadratic."""
    z00, z10, z01, z11 = corners
    s, t, height = start
    du, dv, dz = along
    a, b, twist = z10 - z00, z01 - z00, z00 - z10 - z01 + z11
    c0 = height - (z00 + a * s + b * t + twist * s * t)
    if c0 <= 0.0:
        return 0.0
    c1 = dz - (a * du + b * dv + twist * (s * dv + t * du))
    c2 = -twist * du * dv
    inside = c1 * c1 - 4.0 * c2 * c0
    if inside < 0.0:
        return -1.0
    # Of the two roots c0 / q and q / c2 the first positive one counts.
    q = -0.5 * (c1 + (np.sqrt(inside) if c1 >= 0.0 else -np.sqrt(inside)))
    first = c0 / q if abs(q) > _FLAT else -1.0
    second = q / c2 if abs(c2) > _FLAT else -1.0
    low, high = min(first, second), max(first, second)
    met = low if low >= 0.0 else high
    return met if 0.0 <= met <= length else -1.0


@njit(cache=True, inline="always")
def _incidence(
    corners: tuple[float, float, float, float],
    s: float,
    t: float,
    along: tuple[float, float, float],
    step_m: float,
) -> float:
    """Return the cosine of the angle between a ray and the normal of the patch."""
    z00, z10, z01, z11 = corners
    to_east = ((z10 - z00) * (1.0 - t) + (z11 - z01) * t) / step_m
    to_north = ((z01 - z00) * (1.0 - s) + (z11 - z10) * s) / step_m
    facing = to_east * along[0] * step_m + to_north * along[1] * step_m - along[2]
    return float(abs(facing) / np.sqrt(1.0 + to_east**2 + to_north**2))


_INTERVAL_S = 0.1
_NEAREST_M = 0.5


def draw_lidar(drive: StatisticalDrive) -> LidarScans | None:
    """Draw the scans of a drive that follows its route exactly; None where the mission has no LiDAR."""
    mission, config = drive.mission, drive.mission.sensors.lidar
    if config.beams == 0:
        return None
    motion, _ = exact_drive(drive.terrain, drive.route, mission.rover.speed_m_s, _INTERVAL_S)
    return scans_along(motion, drive.terrain, config, mission.seed)


def record_scans(truth: Truth, mission: MissionConfig, folder: Path) -> None:
    """Write the scans of a drive into the folder of its recording, where the mission has a LiDAR."""
    config = mission.sensors.lidar
    if config.beams:
        scans = scans_along(truth.trajectory, truth.dem, config, mission.seed)
        scans.write(folder / table_file("lidar"))


def scans_along(motion: Trajectory, terrain: Dem, config: LidarConfig, seed: int) -> LidarScans:
    """Return the scans along a real path; their returns are drawn minute by minute, when they are used.

    The middles of the turns are at multiples of one over the rate, as of a scanner that the odometry triggers.
    """
    begin, end = motion.time_s[[0, -1]].tolist()
    first, last = np.ceil(begin * config.rate_hz + 0.5), np.floor(end * config.rate_hz - 0.5)
    at_s = np.arange(first, max(last, first) + 1.0) / config.rate_hz - 0.5 * config.turn_s
    drawn = DrawnMinutes(_Setup.of(motion, terrain, config, seed), at_s)
    return LidarScans(scanner_of(config), at_s + config.clock_offset_s, drawn)


class TurningScanner:
    """Scanner that turns once wherever its rover stands.

    `terrain`: real terrain. `config`: scanner and its errors. `seed`: of the error of the mounting and of all noise.
    """

    def __init__(self, terrain: Dem, config: LidarConfig, seed: int) -> None:
        middle = np.mean(np.reshape(terrain.grid().bounds, (2, 2)), axis=0)
        resting, _ = poses_at_rest(terrain, np.tile(middle, (2, 1)), np.zeros(2), np.arange(2.0))
        self._setup = _Setup.of(resting, terrain, config, seed)
        self._rng = stream(seed, "sensors", "lidar", "turns")

    def turn(self, pose: Trajectory) -> FloatArray:
        """Return the places (N, 3) of the returns of one turn in the frame of the body [m], from the first pose of a path."""
        still = Trajectory(
            pose.time_s[0] + np.arange(2.0),
            np.tile(pose.position[0], (2, 1)),
            np.tile(pose.quaternion[0], (2, 1)),
            np.zeros((2, 3, 3)),
            pose.crs,
        )
        turning = Slerp(still.time_s, Rotation.from_quat(still.quaternion))
        found = _turn(
            self._setup._replace(motion=still, turning=turning), 0, float(still.time_s[0]), self._rng
        )
        nominal = scanner_of(self._setup.config).rays()[found.column, found.beam]
        return 1e-3 * found.range_mm[:, None] * nominal + (0.0, 0.0, self._setup.config.height_m)


def scanner_of(config: LidarConfig) -> Scanner:
    """Return the scanner as its data sheet describes it."""
    low, high = config.elevation_deg
    return Scanner(
        elevation_deg=tuple(np.linspace(low, high, config.beams).tolist()),
        n_columns=config.columns,
        turn_s=config.turn_s,
        mount_m=(0.0, 0.0, config.height_m),
        range_sigma_m=config.range_sigma_m,
        angle_sigma_deg=config.divergence_deg,
    )


class _Setup(NamedTuple):
    """Everything that scans are drawn from."""

    config: LidarConfig
    seed: int
    raster: HeightRaster
    motion: Trajectory
    turning: Slerp
    rays: FloatArray
    """Directions (n_columns, n_beams, 3) in the body's frame, with the error of the mounting."""

    @classmethod
    def of(cls, motion: Trajectory, terrain: Dem, config: LidarConfig, seed: int) -> "_Setup":
        rng = stream(seed, "sensors", "lidar", "mounting")
        tilted = Rotation.from_rotvec(np.radians(config.mounting_sigma_deg) * rng.standard_normal(3))
        turning = Slerp(motion.time_s, Rotation.from_quat(motion.quaternion))
        rays = scanner_of(config).rays() @ tilted.as_matrix().T
        return cls(config, seed, HeightRaster.of(terrain), motion, turning, rays)


class DrawnMinutes:
    """Returns of minutes, drawn from random streams of their own when they are used.

    `setup`: path, terrain and scanner. `at_s` (S,): real times at which the turns begin [s].
    """

    def __init__(self, setup: _Setup, at_s: FloatArray) -> None:
        self._setup, self._at_s = setup, at_s

    def __len__(self) -> int:
        return n_minutes(self._at_s)

    def __getitem__(self, number: int) -> LidarReturns:
        scans = np.flatnonzero(minute_of(self._at_s) == number)
        rng = stream(self._setup.seed, "sensors", "lidar", number)
        parts = [_turn(self._setup, scan, float(self._at_s[scan]), rng) for scan in scans.tolist()]
        if not parts:
            return LidarReturns.of([], [], [], np.empty(0))
        return LidarReturns(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _turn(setup: _Setup, scan: int, begin_s: float, rng: np.random.Generator) -> LidarReturns:
    """Draw the returns of one turn."""
    config, n_beams = setup.config, setup.rays.shape[1]
    start, direction = _pulses(setup, begin_s, rng)
    ground_m, cosine = setup.raster.hits(start, direction, config.range_m)
    # Lambert's law: the echo falls with the cosine of incidence and the square of the range.
    is_returned = (ground_m > _NEAREST_M) & (ground_m <= config.reach_m * np.sqrt(cosine))
    range_m = np.where(is_returned, ground_m, np.inf) + config.range_sigma_m * rng.standard_normal(
        len(ground_m)
    )
    range_m = _disturbed(range_m, config, rng)
    arrives = (
        (rng.random(len(range_m)) >= config.dropped_share) & (range_m > _NEAREST_M) & np.isfinite(range_m)
    )
    number = np.flatnonzero(arrives)
    column, beam = np.divmod(number, n_beams)
    return LidarReturns.of(np.full(len(number), scan), column, beam, range_m[number])


def _pulses(setup: _Setup, begin_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return starts and unit directions (n_columns · n_beams, 3) of the pulses of a turn in the world."""
    config, (n_columns, n_beams, _) = setup.config, setup.rays.shape
    time_s = begin_s + config.turn_s * np.arange(n_columns) / n_columns
    time_s = np.clip(time_s, setup.motion.time_s[0], setup.motion.time_s[-1])
    turn: FloatArray = setup.turning(time_s).as_matrix()
    foot = np.column_stack([np.interp(time_s, setup.motion.time_s, axis) for axis in setup.motion.position.T])
    aimed = setup.rays + np.radians(config.divergence_deg) * rng.standard_normal(setup.rays.shape)
    direction = np.einsum("cij,cbj->cbi", turn, aimed).reshape(-1, 3)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    start = np.repeat(foot + config.height_m * turn[:, :, 2], n_beams, axis=0)
    return start, direction


def _disturbed(range_m: FloatArray, config: LidarConfig, rng: np.random.Generator) -> FloatArray:
    """Return ranges (N,) [m], infinite where nothing is met, with wrong ones and with those of blown snow."""
    is_ghost = np.isfinite(range_m) & (rng.random(len(range_m)) < config.ghost_share)
    range_m = np.where(is_ghost, rng.uniform(_NEAREST_M, config.range_m, len(range_m)), range_m)
    snow_m = rng.exponential(config.spray_m, len(range_m))
    is_snow = (rng.random(len(range_m)) < config.spray_share) & (snow_m < range_m)
    return np.where(is_snow, snow_m, range_m)
