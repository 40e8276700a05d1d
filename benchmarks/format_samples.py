"""One small file of every format that firnline reads, and ways to damage it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from pyproj import CRS

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.io.trajectory_files import read_kitti, read_track, read_tum, write_kitti, write_track, write_tum

UTM = "EPSG:32608"
_WEST, _SOUTH = 500_000.0, 6_700_000.0
_GRID = Grid((_WEST, _SOUTH, _WEST + 390.0, _SOUTH + 290.0), 10.0, UTM)
_TIMES = 0.5 * np.arange(40.0)
_PLACES = np.column_stack([_WEST + 3.0 * _TIMES, _SOUTH + _TIMES, 1000.0 + _TIMES])
Answer = tuple[bytes, ...]


class Sample(NamedTuple):
    """A format: how a good file is written, and what reading it gives (comparable, rounded to 0.1 mm)."""

    write: Callable[[Path], None]
    read: Callable[[Path], Answer]


def _plain(*arrays: np.ndarray) -> Answer:
    return tuple(np.round(array, 4).tobytes() for array in arrays)


def _dem() -> Dem:
    heights = np.random.default_rng(1).normal(1000.0, 5.0, _GRID.shape).astype(np.float32)
    return Dem.on(_GRID, heights.astype(np.float64), "EGM96 height")


def _read_dem(path: Path) -> Answer:
    dem = Dem.read(path)
    return *_plain(dem.elevation, np.array(dem.transform)), str(dem.crs.to_epsg()).encode()


def _points() -> SurfacePoints:
    rng = np.random.default_rng(2)
    xyz = (_WEST, _SOUTH, 1000.0) + 9.0 * rng.random((50, 3))
    return SurfacePoints(xyz, sigma_m=0.1 + rng.random(50), crs=UTM)


def _read_points(path: Path) -> Answer:
    points = SurfacePoints.read(path, crs=UTM)
    return _plain(points.xyz, points.sigma_z)


def _area() -> SurveyArea:
    corners = np.array([(0.0, 0.0), (600.0, 10.0), (590.0, 600.0), (0.0, 590.0)])
    return SurveyArea(shapely.Polygon(corners + (_WEST, _SOUTH)), UTM)


def _read_area(path: Path) -> Answer:
    return _plain(shapely.get_coordinates(SurveyArea.read(path, crs=UTM).polygon.normalize()))


def _write_kitti(path: Path) -> None:
    poses = np.tile(np.eye(3, 4), (len(_PLACES), 1, 1))
    poses[:, :, 3] = _PLACES
    write_kitti(path, poses)


SAMPLES: dict[str, Sample] = {
    **{
        f"dem{ending}": Sample(lambda path: _dem().write(path), _read_dem)
        for ending in (".tif", ".asc", ".nc")
    },
    **{
        f"points{ending}": Sample(lambda path: _points().write(path), _read_points)
        for ending in (".csv", ".gpkg", ".geojson", ".las", ".laz", ".ply")
    },
    **{
        f"area{ending}": Sample(lambda path: _area().write(path), _read_area)
        for ending in (".geojson", ".gpkg", ".kml", ".shp")
    },
    "track.tum": Sample(
        lambda path: write_tum(
            path, np.column_stack([_TIMES, _PLACES, np.tile((0.0, 0.0, 0.0, 1.0), (40, 1))])
        ),
        lambda path: _plain(read_tum(path)),
    ),
    "track.txt": Sample(_write_kitti, lambda path: _plain(read_kitti(path))),
    **{
        f"track{ending}": Sample(
            lambda path: write_track(path, _TIMES, _PLACES, CRS(UTM)),
            lambda path: _plain(*read_track(path, CRS(UTM))),
        )
        for ending in (".gpx", ".gpkg")
    },
}
"""Every format by file name."""


def truncated(whole: bytes) -> Iterator[bytes]:
    """Cut a file off at every 5 % of its length."""
    for percent in range(0, 100, 5):
        yield whole[: len(whole) * percent // 100]


def flipped(whole: bytes, n: int, n_bits: int = 1) -> Iterator[bytes]:
    """Flip bits at random places, in n different ways."""
    for seed in range(n):
        rng = np.random.default_rng(seed)
        data = bytearray(whole)
        for place in rng.integers(len(data), size=n_bits):
            data[place] ^= 1 << rng.integers(8)
        yield bytes(data)


def mutated(whole: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file at random: bits, bytes, extreme numbers, cuts, copies, insertions."""
    data = bytearray(whole)
    for _ in range(int(rng.integers(1, 6))):
        if not data:
            break
        place = int(rng.integers(len(data)))
        length = int(rng.integers(1, 64))
        kind = int(rng.integers(7))
        if kind == 0:
            data[place] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data[place : place + 8] = rng.bytes(min(8, len(data) - place))
        elif kind == 2:
            extreme = (b"\xff", b"\x00", b"\x7f", b"9")[int(rng.integers(4))]
            width = (1, 2, 4, 8)[int(rng.integers(4))]
            data[place : place + width] = extreme * min(width, len(data) - place)
        elif kind == 3:
            del data[place : place + length]
        elif kind == 4:
            data[place:place] = rng.bytes(length)
        elif kind == 5:
            other = int(rng.integers(len(data)))
            data[place : place + length] = data[other : other + length]
        else:
            del data[place:]
    return bytes(data)


def put(path: Path, content: bytes) -> None:
    """Write a new file: libraries may still know what the one of that name held."""
    path.unlink(missing_ok=True)
    path.write_bytes(content)
