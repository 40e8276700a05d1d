"""Memory and time of commands that read maps larger than the memory: score, change and export."""

import sys
from collections.abc import Iterator
from pathlib import Path

import geopandas as gpd
import numpy as np
import rasterio
import shapely
from rasterio.transform import from_origin
from rasterio.windows import Window

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import CRS_NAME
from benchmarks.whole_glacier.mapping import Used, used_by

_SIDES = (6500, 10_000)
_ROWS = 1000
_WEST_M, _NORTH_M = 500_000.0, 6_500_000.0
_MOST_MB = 2000.0


def streamed(folder: Path) -> Iterator[Row]:
    """Yield memory and CPU time for maps of two sizes, and the memory for 10⁹ cells that follows."""
    used: dict[str, list[Used]] = {}
    for side in _SIDES:
        for name, one in _commands(folder, side):
            used.setdefault(name, []).append(one)
            yield Row(f"{name}, {side**2 / 1e6:.0f} million cells: memory", one.memory_mb, "MB")
            yield Row(f"{name}, {side**2 / 1e6:.0f} million cells: CPU time", one.cpu_s, "s")
    cells = [side**2 for side in _SIDES]
    for name, (small, large) in used.items():
        rise = max(large.memory_mb - small.memory_mb, 0.0) / (cells[1] - cells[0])
        memory_mb = large.memory_mb + rise * (1e9 - cells[1])
        yield Row.of(f"{name}, 10⁹ cells, extrapolated: memory", memory_mb, "MB", "<=", _MOST_MB)
        power = np.log(large.cpu_s / small.cpu_s) / np.log(cells[1] / cells[0])
        yield Row.of(f"{name}: exponent of the CPU time", float(power), "", "<=", 1.05)


def _commands(folder: Path, side: int) -> Iterator[tuple[str, Used]]:
    """Yield what each command used on maps of so many cells a side."""
    later, earlier = (
        made_map(folder / f"{name}.tif", side, k) for k, name in enumerate(("later", "earlier"))
    )
    outline = folder / "outline.gpkg"
    middle = shapely.Point(_WEST_M + 0.5 * side, _NORTH_M - 0.5 * side)
    gpd.GeoDataFrame(geometry=[middle.buffer(0.25 * side)], crs=CRS_NAME).to_file(outline)
    yield "score", used_by(_firnline("score", later, "--truth", earlier))
    change = ("--outline", outline, "--out", folder / f"change_{side}")
    yield "change", used_by(_firnline("change", later, earlier, *change))
    yield "export", used_by(_firnline("export", later, folder / f"export_{side}.tif"))


def _firnline(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "sim.cli.main", *map(str, arguments)]


def made_map(file: Path, side: int, seed: int) -> Path:
    """Write heights and standard deviations of so many cells of 1 m a side, and return the file."""
    rng = np.random.default_rng(seed)
    profile = {
        **{
            "driver": "GTiff",
            "height": side,
            "width": side,
            "count": 2,
            "dtype": "float32",
            "nodata": -9999.0,
        },
        **{"tiled": True, "blockxsize": 512, "blockysize": 512, "bigtiff": "IF_SAFER", "crs": CRS_NAME},
        "transform": from_origin(_WEST_M, _NORTH_M, 1.0, 1.0),
    }
    noise = 0.2 * rng.standard_normal((_ROWS, side)).astype(np.float32)
    slope = 0.02 * np.arange(side, dtype=np.float32)
    with rasterio.open(file, "w", **profile) as target:
        for first in range(0, side, _ROWS):
            rows = min(_ROWS, side - first)
            window = Window(0, first, side, rows)
            target.write(np.roll(noise, first // _ROWS, axis=0)[:rows] + slope, 1, window=window)
            target.write(np.full((rows, side), 0.2, np.float32), 2, window=window)
    return file
