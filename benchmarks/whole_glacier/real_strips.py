"""Offsets between real strips in their overlaps, compared with their points above triangles and with raw cells."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from benchmarks.report import Row
from benchmarks.whole_glacier.mapping import command, used_by
from survey.core.arrays import FloatArray, IntArray

_DATA = Path(os.environ.get("FIRNLINE_DATA", "../shared/data"))
_RAW_OFFSET_M = 0.100
_NEAR_M = 0.4
_GROUND = 2


def real_strips(folder: Path) -> Iterator[Row]:
    """Yield the offsets between real strips; none where the data are not there."""
    pozo = _DATA / "dem_gullies_santacruz_pozo" / "Blanca_in_Pozo_cl2_SC12.laz"
    if pozo.exists():
        yield from _two_strips([pozo], folder / "pozo")
    bcts = sorted((_DATA / "lidar_bcts_3strips").glob("*.laz"))
    if bcts:
        yield from _three_strips(bcts, folder / "bcts")


def _two_strips(files: list[Path], out: Path) -> Iterator[Row]:
    """Yield the offset between the strips of Santa Cruz."""
    found = overlaps_of(files, out)[0]
    offset_m, sigma_m = found["offset_m"], found["offset_m_sigma"]
    yield Row("Santa Cruz: strip 8705 above 8706 in their overlap", offset_m, "m")
    yield Row("Santa Cruz: its standard deviation", sigma_m, "m")
    points_m = above_triangles_m(*ground_points(files), 8705, 8706)
    yield Row("Santa Cruz: median of points above triangles of the other strip", points_m, "m")
    off = abs(offset_m - points_m) / sigma_m
    yield Row.of("Santa Cruz: distance from it in standard deviations", off, "", "<=", 1.0)
    # The points of the two strips lie at other places of a cell, which the slope turns into heights.
    yield Row(
        "Santa Cruz: difference of raw cells that the map expects", found["expected_cell_difference_m"], "m"
    )
    off = abs(found["expected_cell_difference_m"] - _RAW_OFFSET_M) / found["expected_cell_difference_m_sigma"]
    what = "Santa Cruz: distance of the raw cells' 0.100 m from it in standard deviations"
    yield Row.of(what, off, "", "<=", 1.0)


def _three_strips(files: list[Path], out: Path) -> Iterator[Row]:
    """Yield the offsets between the three strips of forest on Vancouver Island, which fit one another to some millimetres."""
    points = ground_points(files)
    off = []
    for pair in overlaps_of(files, out):
        first, second = (int(name) for name in pair["strips"])
        what = f"Vancouver Island: strip {first} above {second}"
        yield Row(f"{what} in their overlap", pair["offset_m"], "m")
        yield Row(f"{what}: standard deviation", pair["offset_m_sigma"], "m")
        yield Row(f"{what}: median of points above triangles", above_triangles_m(*points, first, second), "m")
        raw_m = pair["cell_difference_m"] - pair["expected_cell_difference_m"]
        off.append(abs(raw_m) / pair["expected_cell_difference_m_sigma"])
    what = "Vancouver Island: largest of three distances of raw cells from the map in standard deviations"
    yield Row.of(what, max(off), "", "<=", 2.0)


def overlaps_of(files: list[Path], out: Path) -> list[dict[str, Any]]:
    """Map files, and return what the record says of the overlaps of their strips."""
    used_by(command(files, out, "--workers", "1"))
    facts = json.loads((out / "reconstruction.json").read_text(encoding="utf-8"))
    found: list[dict[str, Any]] = facts["diagnostics"]["overlaps"]
    return found


def ground_points(files: list[Path]) -> tuple[FloatArray, IntArray]:
    """Return the ground points (N, 3) of files, from their lowest corner [m], and the numbers of their strips (N,)."""
    xyz, strip = [], []
    for points in map(laspy.read, files):
        ground = np.asarray(points.classification) == _GROUND
        xyz.append(np.column_stack([points.x, points.y, points.z])[ground])
        strip.append(np.asarray(points.point_source_id, np.int64)[ground])
    every = np.concatenate(xyz)
    return every - every.min(axis=0), np.concatenate(strip)


def above_triangles_m(xyz: FloatArray, strip: IntArray, first: int, second: int) -> float:
    """Return the median height of points of a strip above triangles of another one, where the latter has points [m]."""
    own, other = xyz[strip == first], xyz[strip == second]
    own = own[cKDTree(other[:, :2]).query(own[:, :2])[0] < _NEAR_M]
    height = LinearNDInterpolator(other[:, :2], other[:, 2])(own[:, :2])
    return float(np.nanmedian(own[:, 2] - height))
