"""A made survey of two overlapping strips over gentle ground, as LAZ files."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from survey.core.arrays import FloatArray

OFFSET_M, TILT_M, SHIFT_M = 0.25, 0.1, 0.3


def ground(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the height of hills of 15 and 40 m length [m]."""
    return 100.0 + 2.0 * np.sin(x / 15.0) * np.cos(y / 12.0) + 3.0 * np.sin((x + y) / 40.0)


def write_laz(path: Path, xyz: FloatArray, strip: FloatArray, classes: int = 2) -> Path:
    """Write points as LAZ with their strips."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets, header.scales = np.floor(xyz.min(axis=0)), np.full(3, 1e-3)
    header.add_crs(CRS("EPSG:32608"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.point_source_id = strip.astype(np.uint16)
    las.classification = np.full(len(xyz), classes, np.uint8)
    las.write(str(path))
    return path


def strip_points(seed: int, west: float, east: float, offset_m: float, n: int = 20_000) -> FloatArray:
    """Return the points of a strip between two eastings, 120 m long, with its offset and errors of 2 cm."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(west, east, n), rng.uniform(0.0, 120.0, n)
    z = ground(x, y) + offset_m + 0.02 * rng.standard_normal(n)
    return np.column_stack([x, y, z])


@pytest.fixture(scope="session")
def laz_files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two strips, 0.25 m apart in height, that overlap over 60 m; the second one in two files."""
    folder = tmp_path_factory.mktemp("strips")
    first, second = strip_points(1, 0.0, 120.0, OFFSET_M), strip_points(2, 60.0, 190.0, 0.0)
    north = second[:, 1] > 60.0
    return [
        write_laz(folder / "a.laz", first, np.full(len(first), 11)),
        write_laz(folder / "b.laz", second[north], np.full(north.sum(), 12)),
        write_laz(folder / "c.laz", second[~north], np.full((~north).sum(), 12)),
    ]
