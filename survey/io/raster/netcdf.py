"""Elevation rasters as NetCDF after the climate and forecast (CF) conventions, through xarray."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files.library_messages import warnings_logged
from survey.core.files.writing import replacing, unwritable
from survey.io.companions import stale_files

_FILL = np.float32(-9999.0)


def write_netcdf(
    path: str | Path,
    bands: Mapping[str, FloatArray],
    transform: Affine,
    crs: CRS,
    vertical_datum: str,
    *,
    attributes: Mapping[str, Mapping[str, str]] | None = None,
) -> None:
    """Write each band as a float32 variable over y and x [m], with CRS and vertical datum.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    bands : mapping of str to (H, W) ndarray
        Bands by name [m], NaN for nodata.
    transform : affine.Affine
        Maps (column, row) of a cell's corner to easting and northing [m].
    crs : pyproj.CRS
        Projected, with the vertical part if it has a code.
    vertical_datum : str
        Name of the surface that heights count from.
    attributes : mapping of str to mapping, optional
        CF attributes of bands by their names; ``units`` are metres unless stated.

    Raises
    ------
    InputError
        When xarray, h5netcdf or h5py are not installed, or the file cannot be written.
    """
    try:
        import h5netcdf  # noqa: F401  # xarray looks for both by name
        import h5py  # noqa: F401
        import xarray
    except ImportError as error:
        raise InputError(
            f"{path}: NetCDF needs xarray, h5netcdf and h5py, which are not installed; install firnline[netcdf]."
        ) from error
    dataset = xarray.Dataset(
        _variables(bands, attributes or {}), _axes(bands, transform), _facts(vertical_datum)
    )
    dataset["spatial_ref"] = ((), np.int32(0), _grid_mapping(crs, transform))
    encoding = {name: {"_FillValue": _FILL, "zlib": True, "fletcher32": True} for name in bands}
    with replacing(path, stale=stale_files(path)) as draft:
        try:
            dataset.to_netcdf(draft, engine="h5netcdf", encoding=encoding)
        except (OSError, ValueError, RuntimeError) as error:
            raise unwritable(Path(path), error) from error


def _variables(
    bands: Mapping[str, FloatArray], attributes: Mapping[str, Mapping[str, str]]
) -> dict[str, Any]:
    mapping = {"grid_mapping": "spatial_ref", "units": "m"}
    return {
        name: (
            ("y", "x"),
            np.where(np.isfinite(values), values, _FILL).astype(np.float32),
            mapping | dict(attributes.get(name, {})),
        )
        for name, values in bands.items()
    }


def _axes(bands: Mapping[str, FloatArray], transform: Affine) -> dict[str, Any]:
    rows, columns = next(iter(bands.values())).shape
    x = transform.c + transform.a * (np.arange(columns) + 0.5)
    y = transform.f + transform.e * (np.arange(rows) + 0.5)
    units = {"units": "m"}
    return {
        "x": ("x", x, {"standard_name": "projection_x_coordinate", **units}),
        "y": ("y", y, {"standard_name": "projection_y_coordinate", **units}),
    }


def _grid_mapping(crs: CRS, transform: Affine) -> dict[str, Any]:
    """Return what CF readers and GDAL need to place the grid."""
    geo = " ".join(repr(float(v)) for v in transform.to_gdal())
    with warnings_logged():  # CF has no words for some projections; the WKT has
        cf = crs.to_cf()
    return {**cf, "spatial_ref": crs.to_wkt(), "GeoTransform": geo}


def _facts(vertical_datum: str) -> dict[str, str]:
    return {"Conventions": "CF-1.8", **({"vertical_datum": vertical_datum} if vertical_datum else {})}
