"""Elevation rasters written as Cloud-Optimized GeoTIFF, Esri ASCII grid or NetCDF, and their reprojection."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS
from pyproj.crs import CompoundCRS

from survey.core.arrays import FloatArray
from survey.core.checksum import checksum
from survey.core.crs.checks import projected_crs
from survey.core.crs.vertical_datum import UNSTATED, VERTICAL_CRS
from survey.core.errors import InputError
from survey.core.files.library_messages import warnings_logged
from survey.core.files.writing import replacing, unwritable
from survey.io.companions import stale_files
from survey.io.raster.crs_tag import crs_tag
from survey.io.raster.facts import VERTICAL_TAG
from survey.io.raster.georeference import check_transform
from survey.io.raster.opening import gdal_faults
from survey.io.raster.reading import (
    CRC_TAG,
    NODATA,
    Raster,
    checksum_parts,
)

COG_OPTIONS = {
    "driver": "COG",
    "compress": "deflate",
    "predictor": "yes",
    "overview_resampling": "average",
    "num_threads": "1",
}
"""How GDAL writes Cloud-Optimized GeoTIFFs."""
# Nine significant digits bring every float32 back exactly.
ASCII_OPTIONS = {"driver": "AAIGrid", "significant_digits": 9, "force_cellsize": "true"}
"""How GDAL writes Esri ASCII grids."""


def write_raster(
    path: str | Path,
    bands: Mapping[str, FloatArray],
    transform: Affine,
    crs: CRS,
    vertical_datum: str = UNSTATED,
) -> None:
    """Write named bands of float32 in the format that the file's ending names, or leave what was there.

    ``.asc`` is an Esri ASCII grid of one band with its CRS in a ``.prj`` beside it, which states no
    vertical datum; ``.nc`` is NetCDF; everything else is a Cloud-Optimized GeoTIFF.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; its suffix names the format.
    bands : mapping of str to (H, W) ndarray
        Bands by name [m], NaN for nodata.
    transform : affine.Affine
        Maps (column, row) of a cell's corner to easting and northing [m].
    crs : pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        Name of the surface that heights count from.

    Raises
    ------
    InputError
        When the raster is not north-up with square cells, the file cannot be written, several bands are to go to an ASCII grid, or what
        NetCDF needs is not installed.
    """
    check_transform(transform)
    suffix = Path(path).suffix.lower()
    if suffix == ".nc":
        from survey.io.raster.netcdf import write_netcdf

        write_netcdf(path, bands, transform, written_crs(crs, vertical_datum), vertical_datum)
        return
    if suffix == ".asc" and len(bands) != 1:
        raise InputError(f"{path}: an ASCII grid holds one band, not {len(bands)}; write them one by one.")
    options = ASCII_OPTIONS if suffix == ".asc" else COG_OPTIONS
    written = (
        projected_crs(crs, "the raster to write") if suffix == ".asc" else written_crs(crs, vertical_datum)
    )
    _write_gdal(
        Path(path), bands, {**options, "transform": transform, "crs": written.to_wkt()}, crs, vertical_datum
    )


def write_bytes_raster(
    path: Path, name: str, codes: npt.NDArray[np.uint8], transform: Affine, crs: CRS
) -> None:
    """Write one band of bytes as a Cloud-Optimized GeoTIFF without nodata.

    Parameters
    ----------
    path : pathlib.Path
        The GeoTIFF.
    name : str
        Name of the band.
    codes : (H, W) ndarray of uint8
        Values.
    transform : affine.Affine
        Maps (column, row) of a cell's corner to easting and northing [m].
    crs : pyproj.CRS
        Projected, in metres.

    Raises
    ------
    InputError
        When the raster is not north-up with square cells, or the file cannot be written.
    """
    check_transform(transform)
    written = written_crs(crs, UNSTATED).to_wkt()
    options = {"dtype": "uint8", "nodata": None, "overview_resampling": "mode"}
    _write_gdal(
        path,
        {name: codes.astype(np.float64)},
        {**COG_OPTIONS, **options, "transform": transform, "crs": written},
        crs,
        UNSTATED,
    )


def _tags(
    bands: Mapping[str, FloatArray], transform: Affine, crs: CRS, vertical_datum: str
) -> dict[str, str]:
    """Return what a GeoTIFF says of itself: the CRS, the vertical datum and a checksum for each band."""
    crcs = " ".join(checksum(checksum_parts(values, transform, vertical_datum)) for values in bands.values())
    return {CRC_TAG: crcs, **crs_tag(crs), **({VERTICAL_TAG: vertical_datum} if vertical_datum else {})}


def _write_gdal(
    path: Path, bands: Mapping[str, FloatArray], options: Mapping[str, Any], crs: CRS, vertical_datum: str
) -> None:
    import rasterio

    height, width = next(iter(bands.values())).shape
    profile = {"height": height, "width": width, "count": len(bands), "dtype": "float32", "nodata": NODATA}
    profile |= options
    with replacing(path, stale=stale_files(path)) as draft:
        try:
            with warnings_logged(), rasterio.open(draft, "w", **profile) as target:
                if options["driver"] == "COG":
                    target.update_tags(**_tags(bands, options["transform"], crs, vertical_datum))
                for index, (name, values) in enumerate(bands.items(), start=1):
                    target.write(
                        np.where(np.isfinite(values), values, NODATA).astype(profile["dtype"]), index
                    )
                    if options["driver"] == "COG":
                        target.set_band_description(index, name)
        except gdal_faults() as error:
            raise unwritable(path, error) from error
        if not draft.is_file() or draft.stat().st_size == 0:
            raise unwritable(path, "nothing arrived on the disk")


def reprojected(raster: Raster, crs: CRS, step_m: float) -> Raster:
    """Resample a raster (in degrees, say) to square cells of a projected CRS, bilinearly.

    The error of the resampling comes on top of the raster's own: use it for priors.

    Parameters
    ----------
    raster : Raster
        In any CRS.
    crs : pyproj.CRS
        Projected CRS of the result.
    step_m : float
        Side of its cells [m].

    Returns
    -------
    Raster
        North-up, NaN where the raster does not reach.
    """
    from rasterio.transform import array_bounds
    from rasterio.warp import Resampling, calculate_default_transform, reproject

    rows, columns = raster.values.shape
    bounds = array_bounds(rows, columns, raster.transform)
    transform, width, height = calculate_default_transform(
        raster.crs, crs.to_wkt(), columns, rows, *bounds, resolution=step_m
    )
    values = np.full((height, width), np.nan)
    reproject(
        raster.values,
        values,
        src_transform=raster.transform,
        src_crs=raster.crs,
        dst_transform=transform,
        dst_crs=crs.to_wkt(),
        src_nodata=np.nan,
        dst_nodata=np.nan,
        resampling=Resampling.bilinear,
        num_threads=1,
    )
    return Raster(values, transform, crs, raster.vertical_datum)


def written_crs(crs: CRS, vertical_datum: str) -> CRS:
    """Return the CRS that a file states: with its vertical part where the datum has a code.

    Parameters
    ----------
    crs : pyproj.CRS
        Projected.
    vertical_datum : str
        Name of the surface that heights count from.

    Returns
    -------
    pyproj.CRS
        Projected or compound.
    """
    horizontal = projected_crs(crs, "the raster to write")
    # GDAL writes the vertical part of a CRS only when it has a code of its own.
    code = VERTICAL_CRS.get(vertical_datum)
    if code is None:
        return horizontal
    return CompoundCRS(f"{horizontal.name} + {vertical_datum}", [horizontal, CRS.from_user_input(code)])
