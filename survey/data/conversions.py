"""Conversion of data types to xarray and GeoPandas objects, which are optional dependencies."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from pyproj import CRS

from survey.core.errors import InputError

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from xarray import Dataset


def optional(package: str, purpose: str) -> Any:
    """Import an optional package.

    Parameters
    ----------
    package : str
        Name of the package.
    purpose : str
        What needs it, for the message.

    Raises
    ------
    InputError
        When it is not installed.
    """
    try:
        return import_module(package)
    except ImportError as error:
        raise InputError(
            f"{purpose} needs {package}, which is not installed; install firnline[notebook]."
        ) from error


def to_dataset(
    variables: Mapping[str, tuple[npt.NDArray[Any], str]],
    x: npt.NDArray[np.float64],
    y: npt.NDArray[np.float64],
    crs: CRS,
    facts: Mapping[str, str],
) -> "Dataset":
    """Return an `xarray.Dataset` with dimensions y and x and CF grid-mapping metadata.

    Parameters
    ----------
    variables : mapping of str to ((H, W) ndarray, str)
        Values and unit of each variable.
    x, y : (W,) and (H,) ndarray
        Easting and northing of the cell centres [m].
    crs : pyproj.CRS
        Of the coordinates.
    facts : mapping of str to str
        Attributes of the dataset.
    """
    xarray = optional("xarray", "to_xarray")
    mapping = {"grid_mapping": "spatial_ref"}
    data = {
        name: (("y", "x"), values, mapping | ({"units": unit} if unit else {}))
        for name, (values, unit) in variables.items()
    }
    axes = {
        "x": ("x", x, {"standard_name": "projection_x_coordinate", "units": "m"}),
        "y": ("y", y, {"standard_name": "projection_y_coordinate", "units": "m"}),
        "spatial_ref": ((), 0, {"crs_wkt": crs.to_wkt()}),
    }
    dataset: Dataset = xarray.Dataset(data, axes, dict(facts))
    return dataset


def to_geodataframe(geometry: Sequence[Any], columns: Mapping[str, Any], crs: CRS) -> "GeoDataFrame":
    """Return a `geopandas.GeoDataFrame` with one row for each geometry.

    Parameters
    ----------
    geometry : sequence of shapely.Geometry
        Geometries [m].
    columns : mapping of str to sequence
        Attributes, one value for each geometry.
    crs : pyproj.CRS
        Of the geometries.
    """
    geopandas = optional("geopandas", "to_geodataframe")
    frame: GeoDataFrame = geopandas.GeoDataFrame(dict(columns), geometry=list(geometry), crs=crs)
    return frame
