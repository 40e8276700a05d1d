"""NetCDF after the climate and forecast (CF) conventions, version 1.11, through xarray.

`dataset_of` gives variables, axes and CRS the attributes that CF asks for; `write_netcdf` writes such a data set. Heights
get a standard name where their vertical datum is stated: CF has one for heights above a geoid and one for those above the
ellipsoid. xarray, h5netcdf and h5py are optional dependencies.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS

from survey.core import FloatArray, InputError, replacing
from survey.core.crs import ELLIPSOIDAL
from survey.core.files import unwritable, warnings_logged
from survey.io.dataset_files import stale_files

if TYPE_CHECKING:
    from xarray import Dataset

_FILL = np.float32(-9999.0)
_MAPPING = "spatial_ref"
Variables = Mapping[str, tuple[npt.NDArray[Any], Mapping[str, Any]]]
"""Arrays (H, W) with their attributes, by name."""


def height_attributes(vertical_datum: str) -> dict[str, str]:
    """Return unit and names of heights above a vertical datum, of ``""`` where none is stated.

    >>> height_attributes("EGM2008 height")["standard_name"], "standard_name" in height_attributes("")
    ('surface_altitude', False)
    """
    above = f", {vertical_datum}" if vertical_datum else ""
    names = {"long_name": f"elevation of the surface{above}", "units": "m"}
    if vertical_datum:
        is_ellipsoidal = vertical_datum == ELLIPSOIDAL
        names["standard_name"] = "height_above_reference_ellipsoid" if is_ellipsoidal else "surface_altitude"
    return names


def deviation_attributes(of: Mapping[str, str]) -> dict[str, str]:
    """Return unit and names of the standard deviation of a variable that has the attributes `of`."""
    names = {"units": of["units"], "long_name": "standard deviation of the error"}
    return names | (
        {"standard_name": f"{of['standard_name']} standard_error"} if "standard_name" in of else {}
    )


def band_attributes(name: str, vertical_datum: str) -> dict[str, str]:
    """Return unit and names of a band in metres: of heights, of their standard deviation, or of its own name."""
    heights = height_attributes(vertical_datum)
    known = {"elevation": heights, "standard_deviation": deviation_attributes(heights)}
    return known.get(name, {"long_name": name.replace("_", " "), "units": "m"})


def dataset_of(
    variables: Variables,
    transform: Affine,
    crs: CRS,
    vertical_datum: str,
    facts: Mapping[str, str] | None = None,
) -> "Dataset":
    """Return a data set with dimensions y and x [m] whose coordinate ``spatial_ref`` holds the CRS.

    `transform`: maps (column, row) of a cell's corner to easting and northing [m]. `facts`: further attributes of the
    data set.
    """
    import xarray

    rows, columns = next(iter(variables.values()))[0].shape
    data = {
        name: (("y", "x"), values, {**attributes, "grid_mapping": _MAPPING})
        for name, (values, attributes) in variables.items()
    }
    axes = {
        name: (name, places, {"standard_name": f"projection_{name}_coordinate", "units": "m"})
        for name, places in (
            ("x", transform.c + transform.a * (np.arange(columns) + 0.5)),
            ("y", transform.f + transform.e * (np.arange(rows) + 0.5)),
        )
    }
    datum = {"vertical_datum": vertical_datum} if vertical_datum else {}
    about = {
        "Conventions": "CF-1.11",
        "title": ", ".join(variables).replace("_", " "),
        "history": "written by firnline",
    }
    dataset: Dataset = xarray.Dataset(data, axes, {**about, **datum, **(facts or {})})
    for name in axes:
        dataset[name].encoding["_FillValue"] = None  # CF allows no missing coordinates
    return dataset.assign_coords({_MAPPING: ((), np.int32(0), _grid_mapping(crs, transform))})


def _grid_mapping(crs: CRS, transform: Affine) -> dict[str, Any]:
    """Return what CF readers and GDAL need to place the grid."""
    geo = " ".join(repr(float(v)) for v in transform.to_gdal())
    with warnings_logged():  # CF has no words for some projections; the WKT has
        cf = crs.to_cf()
    return {
        **cf,
        "long_name": "coordinate reference system",
        "spatial_ref": crs.to_wkt(),
        "GeoTransform": geo,
    }


def write_netcdf(
    path: str | Path, variables: Variables, transform: Affine, crs: CRS, vertical_datum: str
) -> None:
    """Write variables as float32 over y and x [m], NaN as nodata, with CRS and vertical datum.

    `transform`: maps (column, row) of a cell's corner to easting and northing [m].
    """
    try:
        import h5netcdf  # noqa: F401  # xarray looks for both by name
        import h5py  # noqa: F401
        import xarray  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"{path}: NetCDF needs xarray, h5netcdf and h5py, which are not installed; install firnline[netcdf]."
        ) from error
    filled = {name: (_filled(values), attributes) for name, (values, attributes) in variables.items()}
    dataset = dataset_of(filled, transform, crs, vertical_datum)
    # `grid_mapping` names it: as a coordinate it would be written in a second attribute as well.
    dataset = dataset.reset_coords(_MAPPING)
    encoding = {name: {"_FillValue": _FILL, "zlib": True, "fletcher32": True} for name in variables}
    with replacing(path, stale=stale_files(path)) as draft:
        try:
            dataset.to_netcdf(draft, engine="h5netcdf", encoding=encoding)
        except (OSError, ValueError, RuntimeError) as error:
            raise unwritable(Path(path), error) from error


def _filled(values: FloatArray) -> npt.NDArray[np.float32]:
    return np.where(np.isfinite(values), values, _FILL).astype(np.float32)
