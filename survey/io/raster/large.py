"""Rasters that do not fit the memory: averages of their cells, conversion by windows, and mosaics of tiles.

`read_averaged` reads averages of squares of cells in strips of rows. `convert_in_windows` writes another format window by
window; NetCDF is written in one part and refused. `write_mosaic` writes a virtual raster (VRT) of GeoTIFF tiles, with
virtual overviews.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from affine import Affine
from pyproj import CRS

from survey.core import CapacityError, FloatArray, InputError, IntArray, existing_file, replacing
from survey.core.crs import projected_crs, vertical_datum_of
from survey.core.files import unwritable, warnings_logged
from survey.io.dataset_files import stale_files
from survey.io.raster.opening import check_transform, crs_tag, rasterio_errors
from survey.io.raster.reading import (
    NODATA,
    VERTICAL_TAG,
    Raster,
    band_names,
    log_scale,
    open_raster,
    read_window,
    stated_datum,
)
from survey.io.raster.values import crs_of_raster
from survey.io.raster.writing import ASCII_OPTIONS, COG_OPTIONS, written_crs

_CELLS_AT_ONCE = 4_000_000


def read_averaged(
    path: str | Path, cells: int, bands: Sequence[int] = (1,), units: str | None = None
) -> list[Raster]:
    """Return the averages of squares of cells, read in strips of rows.

    Returns: one for each band; NaN where less than half of a square is known.
    """
    with open_raster(existing_file(path, "the raster"), units) as source:
        check_transform(source.transform)
        log_scale(source, path, units)
        wkt, datum = system_of(source)
        step_m, west, north = source.transform.a, source.transform.c, source.transform.f
        columns = _starts(round(west / step_m), source.width, cells)
        rows = _starts(-round(north / step_m), source.height, cells)
        corner = (
            west + step_m * (_first_edge(round(west / step_m), cells)),
            north - step_m * (_first_edge(-round(north / step_m), cells)),
        )
        transform = Affine(cells * step_m, 0.0, corner[0], 0.0, -cells * step_m, corner[1])
        means = [_means(source, band, rows, columns, units) for band in bands]
    return [Raster(values, transform, wkt, datum) for values in means]


def system_of(source: Any) -> tuple[str | None, str]:
    """Return CRS and vertical datum of an open raster that is read in its own places; one in feet is refused later."""
    if not source.crs:
        return None, stated_datum(source)
    return source.crs.to_wkt(), stated_datum(source) or vertical_datum_of(crs_of_raster(source).crs)


def _first_edge(first: int, cells: int) -> int:
    """Return the number of the cell, from the raster's first one, at which its first square begins: 0 or less."""
    return -(first % cells)


def _starts(first: int, n: int, cells: int) -> IntArray:
    """Return the first row or column of each square within a raster of n rows or columns."""
    starts: IntArray = np.maximum(np.arange(_first_edge(first, cells), n, cells), 0)
    return starts


def _means(source: Any, band: int, rows: IntArray, columns: IntArray, units: str | None) -> FloatArray:
    """Return the means over squares that begin at the given rows and columns."""
    from rasterio.windows import Window

    ends = np.append(rows[1:], source.height)
    at_once = max(1, int(_CELLS_AT_ONCE / source.width / max(np.max(ends - rows), 1)))
    means = np.empty((len(rows), len(columns)))
    for k in range(0, len(rows), at_once):
        first, last = int(rows[k]), int(ends[min(k + at_once, len(rows)) - 1])
        values = read_window(source, band, Window(0, first, source.width, last - first), units)
        means[k : k + at_once] = _reduced(values, rows[k : k + at_once] - first, columns)
    return means


def _reduced(values: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    known = np.isfinite(values)
    n, size, total = (
        np.add.reduceat(np.add.reduceat(part, columns, axis=1), rows, axis=0)
        for part in (known.astype(np.float64), np.ones(values.shape), np.where(known, values, 0.0))
    )
    means: FloatArray = np.full(n.shape, np.nan)
    np.divide(total, n, out=means, where=2.0 * n >= np.maximum(size, 1.0))
    return means


_TILE_CELLS = 512
_WINDOW_CELLS = 2048
# Files of compressed cells that may exceed 4 GB have to be BigTIFF from their first byte.
_LARGE_COG_OPTIONS = {**COG_OPTIONS, "bigtiff": "IF_SAFER"}


def convert_in_windows(source: str | Path, out: str | Path, crs: CRS, units: str | None = None) -> None:
    """Write a raster of any size as Cloud-Optimized GeoTIFF or as an Esri ASCII grid."""
    target = Path(out)
    if target.suffix.lower() == ".nc":
        raise CapacityError(
            f"{source} does not fit the memory, and NetCDF is written in one part; write a GeoTIFF (.tif), or cut the raster."
        )
    names = list(band_names(source))
    if target.suffix.lower() == ".asc" and len(names) != 1:
        raise InputError(f"{target}: an ASCII grid holds one band, not {len(names)}; write a GeoTIFF (.tif).")
    options = ASCII_OPTIONS if target.suffix.lower() == ".asc" else _LARGE_COG_OPTIONS
    with (
        replacing(target, stale=stale_files(target)) as draft,
        TemporaryDirectory(dir=draft.parent) as folder,
    ):
        try:
            _write_tiled(existing_file(source, "the raster"), Path(folder) / "cells.tif", names, crs, units)
            _copy(Path(folder) / "cells.tif", draft, options)
        except rasterio_errors() as error:
            raise unwritable(target, error) from error


def _write_tiled(source: Path, draft: Path, names: list[str], crs: CRS, units: str | None) -> None:
    """Write the bands as float32 with nodata to a GeoTIFF in tiles, without compression."""
    import rasterio

    with open_raster(source, units) as raster, warnings_logged():
        check_transform(raster.transform)
        log_scale(raster, source, units)
        projected_crs(system_of(raster)[0] or crs, str(source))
        datum = stated_datum(raster)
        profile = {
            **{"driver": "GTiff", "height": raster.height, "width": raster.width, "count": len(names)},
            **{"dtype": "float32", "nodata": NODATA, "transform": raster.transform},
            **{"tiled": True, "blockxsize": _TILE_CELLS, "blockysize": _TILE_CELLS, "bigtiff": "IF_SAFER"},
            "crs": written_crs(crs, datum).to_wkt(),
        }
        with rasterio.open(draft, "w", **profile) as target:
            target.update_tags(**crs_tag(crs), **({VERTICAL_TAG: datum} if datum else {}))
            for band, name in enumerate(names, 1):
                target.set_band_description(band, name)
                for window in _windows(raster):
                    values = read_window(raster, band, window, units)
                    target.write(
                        np.where(np.isfinite(values), values, NODATA).astype("f4"), band, window=window
                    )


def _windows(raster: Any) -> Iterator[Any]:
    """Yield windows of whole tiles over a raster."""
    from rasterio.windows import Window

    for row in range(0, raster.height, _WINDOW_CELLS):
        for column in range(0, raster.width, _WINDOW_CELLS):
            height = min(_WINDOW_CELLS, raster.height - row)
            yield Window(column, row, min(_WINDOW_CELLS, raster.width - column), height)


def _copy(source: Path, draft: Path, options: Mapping[str, Any]) -> None:
    """Copy a GeoTIFF by GDAL, which reads it in blocks."""
    import rasterio
    import rasterio.shutil

    with rasterio.Env(GDAL_CACHEMAX=256 * 2**20), warnings_logged():
        rasterio.shutil.copy(source, draft, **options)


class MosaicTile(NamedTuple):
    """A raster of a mosaic: its file, first column and first row (from the north) in the mosaic, width and height."""

    file: Path
    column: int
    row: int
    width: int
    height: int


class MosaicBand(NamedTuple):
    """A band of a mosaic: name, data type as GDAL names it, and the number that stands for no data, if any."""

    name: str
    kind: str
    nodata: float | None


def write_mosaic(
    path: Path,
    tiles: Sequence[MosaicTile],
    bands: Sequence[MosaicBand],
    *,
    shape: tuple[int, int],
    transform: Affine,
    crs: CRS,
    vertical_datum: str = "",
) -> None:
    """Write a virtual raster that consists of rasters in its folder or below.

    `shape` (2,) int: rows and columns of the mosaic. `transform`: maps (column, row) of a cell's corner to
    easting and northing [m].
    """
    rows, columns = shape
    root = ET.Element("VRTDataset", rasterXSize=str(columns), rasterYSize=str(rows))
    ET.SubElement(root, "SRS").text = crs.to_wkt("WKT1_GDAL")
    ET.SubElement(root, "GeoTransform").text = ", ".join(f"{v:.16e}" for v in transform.to_gdal())
    tags = {**crs_tag(crs), **({VERTICAL_TAG: vertical_datum} if vertical_datum else {})}
    metadata = ET.SubElement(root, "Metadata")
    for key, value in tags.items():
        ET.SubElement(metadata, "MDI", key=key).text = value
    for number, band in enumerate(bands, 1):
        _add_band(root, number, band, tiles, path.parent)
    ET.SubElement(
        root, "OverviewList", resampling="average" if bands[0].kind == "Float32" else "nearest"
    ).text = _overviews(max(shape))
    ET.indent(root)
    with replacing(path, stale=stale_files(path)) as draft:
        draft.write_bytes(ET.tostring(root, encoding="utf-8"))


def _overviews(side: int) -> str:
    """Return the factors of overviews down to some 512 cells a side."""
    factors = [2]
    while side / factors[-1] > 512:
        factors.append(2 * factors[-1])
    return " ".join(map(str, factors))


def _add_band(
    root: ET.Element, number: int, band: MosaicBand, tiles: Sequence[MosaicTile], folder: Path
) -> None:
    element = ET.SubElement(root, "VRTRasterBand", dataType=band.kind, band=str(number))
    ET.SubElement(element, "Description").text = band.name
    if band.nodata is not None:
        ET.SubElement(element, "NoDataValue").text = f"{band.nodata:g}"
    for tile in tiles:
        source = ET.SubElement(element, "SimpleSource")
        ET.SubElement(source, "SourceFilename", relativeToVRT="1").text = tile.file.relative_to(
            folder
        ).as_posix()
        ET.SubElement(source, "SourceBand").text = str(number)
        _add_rectangle(source, "SrcRect", (0, 0, tile.width, tile.height))
        _add_rectangle(source, "DstRect", (tile.column, tile.row, tile.width, tile.height))


def _add_rectangle(source: ET.Element, name: str, numbers: tuple[int, int, int, int]) -> None:
    element = ET.SubElement(source, name)
    for key, number in zip(("xOff", "yOff", "xSize", "ySize"), numbers, strict=True):
        element.set(key, str(number))
