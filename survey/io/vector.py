"""Vector files: GeoPackage, GeoJSON, KML, Shapefile, through GDAL."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.errors import InputError
from survey.io.files import existing_file, replacing, unwritable

_DRIVERS = {
    ".gpkg": "GPKG",
    ".geojson": "GeoJSON",
    ".json": "GeoJSON",
    ".kml": "KML",
    ".gpx": "GPX",
    ".shp": "ESRI Shapefile",
}

_GDAL_OPTIONS = {
    # GeoPackages carry the time of their last change; a fixed one keeps equal content equal to the byte.
    "OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z",
    # A ring that is not closed is refused, not closed behind the user's back.
    "OGR_GEOMETRY_ACCEPT_UNCLOSED_RING": "NO",
}


@cache
def _gdal() -> Any:
    """Return the bindings to GDAL, loaded when first needed: maps from arrays do without their 30 MB."""
    import pyogrio

    pyogrio.set_gdal_config_options(_GDAL_OPTIONS)
    return pyogrio


class Features(NamedTuple):
    """Geometries with their attributes, column by column."""

    geometry: npt.NDArray[Any]
    attributes: dict[str, npt.NDArray[Any]]
    crs: Any


def read_features(
    path: str | Path, *, layer: str | int | None = None, what: str = "the vector file"
) -> Features:
    """Read all features of a layer (the first one unless named).

    Raises
    ------
    InputError
        Missing, empty, damaged, or without any geometry.
    """
    file = existing_file(path, what)
    gdal = _gdal()
    try:
        meta, _, geometry, columns = gdal.raw.read(file, layer=layer)
    except (gdal.errors.DataSourceError, gdal.errors.DataLayerError, ValueError) as error:
        raise InputError(
            f"{what} {file} is damaged or no vector format that GDAL knows ({error}); get it again."
        ) from error
    if geometry is None or len(geometry) == 0:
        raise InputError(f"{what} {file} holds no features; draw at least one and save it again.")
    try:
        shapes = shapely.from_wkb(geometry)
    except shapely.errors.GEOSException as error:
        raise InputError(
            f"{what} {file} holds a geometry that cannot be built ({error}); correct it in a GIS."
        ) from error
    return Features(
        np.asarray(shapes, dtype=object), dict(zip(meta["fields"], columns, strict=True)), meta["crs"]
    )


def write_features(
    path: str | Path,
    geometry: Sequence[Any] | npt.NDArray[Any],
    attributes: Mapping[str, Any],
    crs: CRS,
    *,
    layer: str,
) -> None:
    """Write features to the format that the file's ending names, or leave what was there."""
    target = Path(path)
    driver = _DRIVERS.get(target.suffix.lower())
    if driver is None:
        raise InputError(
            f"{target.name} ends in {target.suffix!r}; one of {', '.join(sorted(_DRIVERS))} was expected."
        )
    shapes = np.asarray(geometry, dtype=object)
    columns = [np.asarray(column) for column in attributes.values()]
    gdal = _gdal()
    faults = gdal.errors
    with replacing(target) as draft:
        try:
            gdal.raw.write(
                draft,
                geometry=shapely.to_wkb(shapes),
                field_data=columns,
                fields=list(attributes),
                geometry_type=_common_type(shapes),
                crs=crs.to_wkt(),
                driver=driver,
                layer=layer,
            )
        except (
            faults.DataLayerError,
            faults.DataSourceError,
            faults.FeatureError,
            faults.GeometryError,
        ) as error:
            raise unwritable(target, error) from error


def _common_type(shapes: npt.NDArray[Any]) -> str:
    kinds = {shape.geom_type for shape in shapes}
    name = kinds.pop() if len(kinds) == 1 else "Unknown"
    return f"{name} Z" if name != "Unknown" and bool(np.all(shapely.has_z(shapes))) else name
