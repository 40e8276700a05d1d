"""Memory and time of commands that read maps larger than the memory: score, change and export."""

import sys
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import geopandas as gpd
import numpy as np
import rasterio
import shapely
from pyproj import CRS
from rasterio.transform import from_origin
from rasterio.windows import Window

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import CRS_NAME
from benchmarks.whole_glacier.mapping import Used, used_by
from survey.io.raster.large import MosaicBand, MosaicTile, write_mosaic

_SMALL_CELLS, _TILE_CELLS = 6500, 5000
_COLUMNS, _ROWS_OF_TILES = 8, 5
_ROWS = 1000
_WEST_M, _NORTH_M = 500_000.0, 6_500_000.0
_MOST_MB = 2000.0
_CACHE_BYTES = 64 * 2**20


def streamed(folder: Path) -> Iterator[Row]:
    """Yield memory and CPU time for maps of 42 million cells and of 10⁹, a mosaic that consists of one tile forty times."""
    small = (_SMALL_CELLS, _SMALL_CELLS)
    large = (_ROWS_OF_TILES * _TILE_CELLS, _COLUMNS * _TILE_CELLS)
    before = dict(_commands(_pair(folder, "small", _single), folder, small))
    after = dict(_commands(_pair(folder, "large", _mosaic), folder, large))
    for name, used in before.items():
        yield Row(f"{name}, 42 million cells: memory", used.memory_mb, "MB")
        yield Row(f"{name}, 42 million cells: CPU time", used.cpu_s, "s")
        yield Row.of(f"{name}, 10⁹ cells: memory", after[name].memory_mb, "MB", "<=", _MOST_MB)
        yield Row(f"{name}, 10⁹ cells: CPU time", after[name].cpu_s, "s")
        power = np.log(after[name].cpu_s / used.cpu_s) / np.log(np.prod(large) / np.prod(small))
        yield Row.of(f"{name}: exponent of the CPU time", float(power), "", "<=", 1.05)


def _pair(folder: Path, name: str, write: Callable[[Path, int], Path]) -> tuple[Path, Path]:
    """Return the rasters of two epochs."""
    return write(folder / f"{name}_later", 0), write(folder / f"{name}_earlier", 1)


def _single(stem: Path, seed: int) -> Path:
    """Write one raster."""
    return made_map(stem.with_suffix(".tif"), _SMALL_CELLS, seed)


def _mosaic(stem: Path, seed: int) -> Path:
    """Write a tile, and a mosaic that has it in every place."""
    tile, n = made_map(stem.with_suffix(".tif"), _TILE_CELLS, seed), _TILE_CELLS
    places = [
        MosaicTile(tile, n * i, n * j, n, n) for j, i in product(range(_ROWS_OF_TILES), range(_COLUMNS))
    ]
    out = stem.with_suffix(".vrt")
    bands = [MosaicBand(name, "Float32", -9999.0) for name in ("elevation", "standard_deviation")]
    write_mosaic(
        out,
        places,
        bands,
        shape=(_ROWS_OF_TILES * n, _COLUMNS * n),
        transform=from_origin(_WEST_M, _NORTH_M, 1.0, 1.0),
        crs=CRS(CRS_NAME),
    )
    return out


def _commands(epochs: tuple[Path, Path], folder: Path, shape: tuple[int, int]) -> Iterator[tuple[str, Used]]:
    """Yield what each command used on maps of two epochs with so many rows and columns."""
    later, earlier = epochs
    rows, columns = shape
    outline = folder / "outline.gpkg"
    middle = shapely.Point(_WEST_M + 0.5 * columns, _NORTH_M - 0.5 * rows)
    gpd.GeoDataFrame(geometry=[middle.buffer(0.25 * min(shape))], crs=CRS_NAME).to_file(outline)
    yield "score", used_by(_firnline("score", later, "--truth", earlier))
    change = ("--outline", outline, "--out", folder / f"change_{columns}")
    yield "change", used_by(_firnline("change", later, earlier, *change))
    exported = folder / f"export_{columns}.tif"
    yield "export", used_by(_firnline("export", later, exported))
    exported.unlink()


def _firnline(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "firnline.cli.main", *map(str, arguments)]


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
    # Linux counts the memory of this process to the commands that it starts.
    with rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES), rasterio.open(file, "w", **profile) as target:
        for first in range(0, side, _ROWS):
            rows = min(_ROWS, side - first)
            window = Window(0, first, side, rows)
            target.write(np.roll(noise, first // _ROWS, axis=0)[:rows] + slope, 1, window=window)
            target.write(np.full((rows, side), 0.2, np.float32), 2, window=window)
    return file
