"""Made airborne LiDAR surveys: fractal ground that is known everywhere, strips whose errors are known, control points."""

from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from numba import njit
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.streams import stream

CRS_NAME = "EPSG:32608"
_OCTAVES, _LONGEST_M, _RELIEF_M = 11, 2048.0, 120.0
_SPACING_M, _WIDTH_M = 400.0, 560.0
_NOISE_M, _CONTROL_SIGMA_M = 0.03, 0.02
_FILE_M = 1000.0
_WEST_M, _SOUTH_M = 500_000.0, 6_500_000.0


class StripError(NamedTuple):
    """True errors of a strip: offset, tilts at its end [m], shift [m], its middle and half-length [m]."""

    offset_m: float
    tilt_m: tuple[float, float]
    shift_m: tuple[float, float]
    middle: tuple[float, float]
    half_m: float


class MadeSurvey(NamedTuple):
    """A made survey: seed, sides [m], points for each square metre and strip, and size of the strips' errors [m]."""

    seed: int
    width_m: float
    height_m: float
    density: float = 2.0
    strip_m: float = 0.2

    @property
    def n_strips(self) -> int:
        """Number of strips, which run northwards."""
        return max(round(self.width_m / _SPACING_M), 1)

    @property
    def n_points(self) -> int:
        """Number of points of all strips."""
        return sum(
            int(max(high - low, 0.0) * self.height_m * self.density)
            for low, high in (self._extent(error, 0.0, self.width_m) for error in self.strip_errors())
        )

    def strip_errors(self) -> list[StripError]:
        """Return the true errors of all strips."""
        rng = stream(self.seed, "made survey", "strips")
        found = []
        for k in range(self.n_strips):
            offset, *rest = rng.standard_normal(5) * self.strip_m * np.array([1.0, 0.3, 0.5, 0.25, 0.25])
            middle = (_WEST_M + (k + 0.5) * self.width_m / self.n_strips, _SOUTH_M + 0.5 * self.height_m)
            tilts, shift = (float(rest[0]), float(rest[1])), (float(rest[2]), float(rest[3]))
            found.append(StripError(float(offset), tilts, shift, middle, 0.5 * self.height_m))
        return found

    def heights(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the true heights (N,) [m] at eastings and northings [m]."""
        return ground(x - _WEST_M, y - _SOUTH_M, self.seed)

    def control(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Return control points (n, 3) and their standard deviations (n,) [m]."""
        rng = stream(self.seed, "made survey", "control")
        xy = rng.uniform((5.0, 5.0), (self.width_m - 5.0, self.height_m - 5.0), (n, 2)) + [_WEST_M, _SOUTH_M]
        z = self.heights(*xy.T) + _CONTROL_SIGMA_M * rng.standard_normal(n)
        return np.column_stack([xy, z]), np.full(n, _CONTROL_SIGMA_M)

    def write(self, folder: Path) -> list[Path]:
        """Write the survey as LAZ files of one kilometre a side; files that are there stay."""
        folder.mkdir(parents=True, exist_ok=True)
        files = []
        for south in np.arange(0.0, self.height_m, _FILE_M):
            for west in np.arange(0.0, self.width_m, _FILE_M):
                file = folder / f"points_{int(south):05d}_{int(west):05d}.laz"
                if not file.exists():
                    self._write_file(file, float(west), float(south))
                files.append(file)
        return files

    def _write_file(self, file: Path, west: float, south: float) -> None:
        parts = [self._strip_points(k, error, west, south) for k, error in enumerate(self.strip_errors())]
        xyz, number = (np.concatenate(column) for column in zip(*parts, strict=True))
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.offsets, header.scales = np.floor(xyz.min(axis=0)), np.full(3, 1e-3)
        header.add_crs(CRS(CRS_NAME))
        las = laspy.LasData(header)
        las.x, las.y, las.z = xyz.T
        las.point_source_id, las.classification = number, np.full(len(xyz), 2, np.uint8)
        draft = file.with_name(f".{file.name}")
        las.write(str(draft), do_compress=True)
        draft.rename(file)

    def _extent(self, error: StripError, west: float, east: float) -> tuple[float, float]:
        """Return the western and the eastern edge of a strip between two eastings [m]."""
        middle = error.middle[0] - _WEST_M
        return max(middle - 0.5 * _WIDTH_M, west), min(middle + 0.5 * _WIDTH_M, east)

    def _strip_points(
        self, k: int, error: StripError, west: float, south: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the points (N, 3) of a strip in a file, with its errors, and its number (N,)."""
        width, height = min(_FILE_M, self.width_m - west), min(_FILE_M, self.height_m - south)
        low, high = self._extent(error, west, west + width)
        rng = stream(self.seed, "made survey", "points", k, int(west), int(south))
        n = int(max(high - low, 0.0) * height * self.density)
        if n == 0:
            return np.zeros((0, 3)), np.zeros(0, np.uint16)
        x, y = rng.uniform(low, high, n) + _WEST_M, rng.uniform(south, south + height, n) + _SOUTH_M
        along = (x - error.middle[0]) / error.half_m * error.tilt_m[0] + (
            y - error.middle[1]
        ) / error.half_m * error.tilt_m[1]
        # A point that is reported at x lies at x minus the shift.
        z = self.heights(x - error.shift_m[0], y - error.shift_m[1]) + error.offset_m + along
        z += _NOISE_M * rng.standard_normal(n)
        return np.column_stack([x, y, z]), np.full(n, k + 1, np.uint16)


@njit(cache=True, inline="always")
def _value(i: int, j: int, octave: int, seed: int) -> float:
    """Return a number between -1 and 1 that belongs to a node of an octave's lattice."""
    key = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(j) * np.uint64(0xD1B54A32D192ED03)
    key += np.uint64(octave * 7919 + seed * 104729)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    key = key ^ (key >> np.uint64(31))
    return float(key >> np.uint64(11)) / 2.0**52 - 1.0


@njit(cache=True)
def ground(x: FloatArray, y: FloatArray, seed: int) -> FloatArray:
    """Return fractal ground (N,) [m]: value noise of eleven octaves from 2048 m to 2 m, half as high at half the length."""
    out = np.zeros(len(x))
    for octave in range(_OCTAVES):
        length = _LONGEST_M / 2.0**octave
        amplitude = _RELIEF_M / 2.0 ** (1.1 * octave)
        for k in range(len(x)):
            u, v = x[k] / length + 1000.37, y[k] / length + 1000.71
            i, j = int(np.floor(u)), int(np.floor(v))
            s, t = u - i, v - j
            s, t = s * s * s * (s * (6.0 * s - 15.0) + 10.0), t * t * t * (t * (6.0 * t - 15.0) + 10.0)
            south = _value(i, j, octave, seed) * (1 - s) + _value(i + 1, j, octave, seed) * s
            north = _value(i, j + 1, octave, seed) * (1 - s) + _value(i + 1, j + 1, octave, seed) * s
            out[k] += amplitude * (south * (1 - t) + north * t)
    return out
