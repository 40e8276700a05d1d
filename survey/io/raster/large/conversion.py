"""Conversion of a raster that does not fit the memory to another format, window by window."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pyproj import CRS

from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import warnings_logged
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing, unwritable
from survey.io.companions import stale_files
from survey.io.raster.crs_tag import crs_tag
from survey.io.raster.facts import VERTICAL_TAG, band_names, stated_datum
from survey.io.raster.georeference import check_transform
from survey.io.raster.opening import gdal_faults
from survey.io.raster.reading import NODATA
from survey.io.raster.strips import opened_raster, read_window
from survey.io.raster.writing import ASCII_OPTIONS, COG_OPTIONS, written_crs

_TILE_CELLS = 512
_WINDOW_CELLS = 2048
# Files of compressed cells that may exceed 4 GB have to be BigTIFF from their first byte.
_LARGE_COG_OPTIONS = {**COG_OPTIONS, "bigtiff": "IF_SAFER"}


def convert_in_windows(source: str | Path, out: str | Path, crs: CRS) -> None:
    """Write a raster of any size as Cloud-Optimized GeoTIFF or as an Esri ASCII grid.

    Parameters
    ----------
    source : str or pathlib.Path
        A north-up raster with square cells.
    out : str or pathlib.Path
        ``.asc`` for an ASCII grid of one band, anything else for a GeoTIFF. The folder has to have room for the raster
        without compression beside it.
    crs : pyproj.CRS
        The raster's projected CRS.

    Raises
    ------
    InputError
        As in `survey.io.raster.read_raster`; the file cannot be written.
    CapacityError
        The ending names NetCDF, which is written in one part.
    """
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
            _write_tiled(existing_file(source, "the raster"), Path(folder) / "cells.tif", names, crs)
            _copy(Path(folder) / "cells.tif", draft, options)
        except gdal_faults() as error:
            raise unwritable(target, error) from error


def _write_tiled(source: Path, draft: Path, names: list[str], crs: CRS) -> None:
    """Write the bands as float32 with nodata to a GeoTIFF in tiles, without compression."""
    import rasterio

    with opened_raster(source) as raster, warnings_logged():
        check_transform(raster.transform)
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
                    values = read_window(raster, band, window)
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
