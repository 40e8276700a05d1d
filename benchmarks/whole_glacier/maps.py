"""Maps of made surveys against their ground, of real strips against one another, and of small tiles against one large one."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import rasterio

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import MadeSurvey
from benchmarks.whole_glacier.mapping import (
    Judged,
    above_triangles_m,
    command,
    control_file,
    judged,
    overlap_of,
    used_by,
)

SEEDS = (101, 102, 103)
_DATA = Path(os.environ.get("FIRNLINE_DATA", "../shared/data"))
_RAW_OFFSET_M = 0.100
_STRIPS_M = (0.1, 0.2, 0.3)
_POOLED_KM2 = 0.5
_MOST_MINUTES = 60.0


def real_strips(folder: Path) -> Iterator[Row]:
    """Yield the offset between two real strips."""
    file = _DATA / "dem_gullies_santacruz_pozo" / "Blanca_in_Pozo_cl2_SC12.laz"
    if not file.exists():
        return
    used_by(command([file], folder / "real", "--workers", "1"))
    found = overlap_of(folder / "real", ["8705", "8706"])
    offset_m, sigma_m = found["offset_m"], found["offset_m_sigma"]
    yield Row("Santa Cruz: strip 8705 above 8706 in their overlap", offset_m, "m")
    yield Row("Santa Cruz: its standard deviation", sigma_m, "m")
    points_m = above_triangles_m(file, 8705, 8706)
    yield Row("Santa Cruz: median of points above triangles of the other strip", points_m, "m")
    off = abs(offset_m - points_m) / sigma_m
    yield Row.of("Santa Cruz: distance from it in standard deviations", off, "", "<=", 1.0)
    # The points of the two strips lie at other places of a cell, which the slope turns into heights.
    expected_m = found["expected_cell_difference_m"]
    yield Row("Santa Cruz: difference of raw cells that the map expects", expected_m, "m")
    off = abs(expected_m - _RAW_OFFSET_M) / found["expected_cell_difference_m_sigma"]
    yield Row.of(
        "Santa Cruz: distance of the raw cells' 0.100 m from it in standard deviations", off, "", "<=", 1.0
    )


def made_survey(folder: Path, km2: float, density: float) -> Iterator[Row]:
    """Yield coverage, errors, time and memory of a made survey of a size."""
    side_m = 1000.0 * np.sqrt(km2)
    made = MadeSurvey(SEEDS[0], side_m, side_m, density)
    files = made.write(folder / "made")
    options = ["--control", str(control_file(made, folder)), "--workers", "2"]
    began = time.perf_counter()
    used = used_by(command(files, folder / "map", *options))
    minutes = (time.perf_counter() - began) / 60.0
    found, what = judged(made, folder / "map" / "dem.vrt"), f"{km2:g} km²"
    yield Row(f"{what}: points", made.n_points / 1e6, "million")
    yield from _coverage_rows(what, found.coverage_95, has_bar=made.n_strips > 10)
    yield Row(f"{what}: RMSE", found.rmse_m, "m")
    yield Row(f"{what}: stated RMSE", found.stated_m, "m")
    yield Row(f"{what}: CPU time", used.cpu_s, "s")
    yield Row.of(f"{what}: time", minutes, "min", "<=", _MOST_MINUTES)
    yield Row.of(f"{what}: memory of the largest process", used.memory_mb, "MB", "<=", 4000.0)


def _coverage_rows(what: str, share: float, *, has_bar: bool) -> Iterator[Row]:
    """Yield the coverage of 95 % intervals, with the bars of both sides."""
    if not has_bar:
        yield Row(f"{what}: coverage of 95 % intervals, one draw of the level", share, "")
        return
    yield Row.of(f"{what}: coverage of 95 % intervals, at least", share, "", ">=", 0.93)
    yield Row.of(f"{what}: coverage of 95 % intervals, at most", share, "", "<=", 0.97)


def coverage(folder: Path, density: float) -> Iterator[Row]:
    """Yield the coverage over nine small surveys with strip errors of 0.1 to 0.3 m."""
    side_m = 1000.0 * np.sqrt(_POOLED_KM2)
    found: list[Judged] = []
    for strip_m in _STRIPS_M:
        for seed in SEEDS:
            made, own = MadeSurvey(seed, side_m, side_m, density, strip_m), folder / f"{seed}_{strip_m:g}"
            files = made.write(own)
            used_by(command(files, own / "map", "--control", str(control_file(made, own)), "--workers", "1"))
            found.append(judged(made, own / "map" / "dem.vrt"))
    share = float(np.mean([one.coverage_95 for one in found]))
    yield from _coverage_rows("nine surveys of 0.5 km², strip errors of 0.1 to 0.3 m", share, has_bar=True)
    ratio = np.sqrt(np.mean([one.rmse_m**2 for one in found]) / np.mean([one.stated_m**2 for one in found]))
    yield Row("nine surveys of 0.5 km²: RMSE over stated RMSE", float(ratio), "")


def exponent(found: list[Row]) -> Iterator[Row]:
    """Yield the exponent of the CPU time with the number of points, and what 10⁹ points take, of three sizes or more."""
    times = [row.value for row in found if row.name.endswith("km²: CPU time")]
    points = [row.value for row in found if row.name.endswith("km²: points")]
    if len(times) > 2:
        slope, level = np.polyfit(np.log(points), np.log(times), 1)
        yield Row.of("exponent of the CPU time with the number of points", float(slope), "", "<=", 1.05)
        hours = float(np.exp(level + slope * np.log(1000.0))) / 3600.0
        yield Row("10⁹ points, extrapolated: CPU time", hours, "h")


def seams(folder: Path, density: float) -> Iterator[Row]:
    """Yield differences beside the edges of tiles to one big tile."""
    made = MadeSurvey(SEEDS[1], 600.0, 600.0, density)
    files = made.write(folder / "seams")
    maps = []
    for cells in (200, 600):
        out = folder / f"seams_{cells}"
        used_by(command(files, out, "--workers", "1", "--set", f"tiles.tile_cells={cells}"))
        with rasterio.open(out / "dem.vrt") as source:
            maps.append(source.read(masked=True).filled(np.nan))
    edges = np.zeros(maps[0].shape[1:], bool)
    for at in (200, 400):
        edges[:, at - 2 : at + 2], edges[-at - 2 : -at + 2] = True, True
    height_m, std_m = (np.nanmean(np.abs(maps[0] - maps[1])[band][edges]) for band in (0, 1))
    yield Row.of("seam: mean difference of heights to one tile", float(height_m), "m", "<=", 1e-3)
    share = float(std_m / np.nanmean(maps[1][1][edges]))
    yield Row.of("seam: mean difference of standard deviations", share, "", "<=", 0.02)
