"""Elevation rasters: GeoTIFF and whatever else GDAL reads; written as Cloud-Optimized GeoTIFF."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from affine import Affine
from pyproj import CRS
from pyproj.crs import CompoundCRS

from survey.arrays import FloatArray
from survey.errors import InputError
from survey.geodesy import UNSTATED, projected_crs, vertical_datum_of
from survey.io.files import existing_file, replacing, unwritable

NODATA = -9999.0
_VERTICAL_TAG = "VERTICAL_DATUM"
# GDAL keeps the vertical part of a CRS only when it has a code of its own.
_VERTICAL_CRS = {"EGM96 height": "EPSG:5773", "EGM2008 height": "EPSG:3855", "NAVD88 height": "EPSG:5703"}


class Raster(NamedTuple):
    """One band of a file: values with NaN for nodata, the transform, the CRS, the vertical datum."""

    values: FloatArray
    transform: Affine
    crs: Any
    vertical_datum: str


def read_raster(path: str | Path, *, band: int = 1) -> Raster:
    """Read one band with its georeference; nodata becomes NaN.

    Raises
    ------
    InputError
        The file is missing, empty, damaged, of another kind, or has no such band.
    """
    import rasterio  # GDAL is loaded when first needed: maps from arrays do without its 20 MB

    file = existing_file(path, "the raster")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(file) as source:
                if not 1 <= band <= source.count:
                    raise InputError(f"{file} has {source.count} bands; band {band} was asked for.")
                if np.issubdtype(np.dtype(source.dtypes[band - 1]), np.complexfloating):
                    raise InputError(f"{file} holds complex numbers; elevations in metres were expected.")
                values = source.read(band, masked=True).astype(np.float64).filled(np.nan)
                crs = source.crs.to_wkt() if source.crs else None
                datum = source.tags().get(_VERTICAL_TAG, UNSTATED)
                transform = source.transform
    except _gdal_faults() as error:
        raise InputError(
            f"{file} is damaged or no raster that GDAL knows ({_first_line(error)}); get it again."
        ) from error
    values[~np.isfinite(values)] = np.nan
    return Raster(values, transform, crs, datum or (vertical_datum_of(crs) if crs else UNSTATED))


def band_count(path: str | Path) -> int:
    """Return the number of bands of a raster that `read_raster` has read."""
    import rasterio

    with rasterio.open(path) as source:
        return int(source.count)


def write_raster(
    path: str | Path,
    bands: Mapping[str, FloatArray],
    transform: Affine,
    crs: CRS,
    vertical_datum: str = UNSTATED,
) -> None:
    """Write named bands as one Cloud-Optimized GeoTIFF of float32, or leave what was there."""
    layers = list(bands.values())
    height, width = layers[0].shape
    profile = {
        "driver": "COG",
        "height": height,
        "width": width,
        "count": len(layers),
        "dtype": "float32",
        "nodata": NODATA,
        "crs": _written_crs(crs, vertical_datum).to_wkt(),
        "transform": transform,
        "compress": "deflate",
        "predictor": "yes",
        "overview_resampling": "average",
        "num_threads": "1",
    }
    import rasterio

    with replacing(path) as draft:
        try:
            with rasterio.open(draft, "w", **profile) as target:
                if vertical_datum:
                    target.update_tags(**{_VERTICAL_TAG: vertical_datum})
                for index, (name, values) in enumerate(bands.items(), start=1):
                    target.write(np.where(np.isfinite(values), values, NODATA).astype(np.float32), index)
                    target.set_band_description(index, name)
        except _gdal_faults() as error:
            raise unwritable(Path(path), error) from error
        if not draft.is_file() or draft.stat().st_size == 0:
            raise unwritable(Path(path), "nothing arrived on the disk")


def reprojected(raster: Raster, crs: CRS, step_m: float) -> Raster:
    """Resample a raster (in degrees, say) to square cells of a projected CRS, bilinearly.

    The error of the resampling comes on top of the raster's own: use it for priors.
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


def _written_crs(crs: CRS, vertical_datum: str) -> CRS:
    horizontal = projected_crs(crs, "the raster to write")
    code = _VERTICAL_CRS.get(vertical_datum)
    if code is None:
        return horizontal
    return CompoundCRS(f"{horizontal.name} + {vertical_datum}", [horizontal, CRS.from_user_input(code)])


def _gdal_faults() -> tuple[type[Exception], ...]:
    """Return what reading and writing through GDAL may raise; what GDAL itself reports has no public home."""
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError

    return RasterioError, CPLE_BaseError


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")
