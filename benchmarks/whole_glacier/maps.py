"""Maps of made surveys against their ground, and of small tiles against one large one."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import rasterio

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import MadeSurvey
from benchmarks.whole_glacier.mapping import command, control_file, judged, used_by

SEEDS = (101, 102, 103)
_MOST_MINUTES = 60.0


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
    yield from coverage_rows(what, found.coverage_95, has_bar=made.n_strips > 10)
    yield Row(f"{what}: RMSE", found.rmse_m, "m")
    yield Row(f"{what}: stated RMSE", found.stated_m, "m")
    yield Row(f"{what}: CPU time", used.cpu_s, "s")
    yield Row.of(f"{what}: time", minutes, "min", "<=", _MOST_MINUTES)
    yield Row.of(f"{what}: memory of the largest process", used.memory_mb, "MB", "<=", 4000.0)


def coverage_rows(what: str, share: float, *, has_bar: bool) -> Iterator[Row]:
    """Yield the coverage of 95 % intervals, with the bars of both sides."""
    if not has_bar:
        yield Row(f"{what}: coverage of 95 % intervals, one draw of the level", share, "")
        return
    yield Row.of(f"{what}: coverage of 95 % intervals, at least", share, "", ">=", 0.93)
    yield Row.of(f"{what}: coverage of 95 % intervals, at most", share, "", "<=", 0.97)


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
