"""Writing of features: GeoPackage, GeoJSON, KML, Shapefile."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.core.crs.choice import coded_crs
from survey.core.errors import InputError
from survey.core.files.writing import replacing, unwritable
from survey.io.companions import stale_files
from survey.io.degrees import WGS84, in_degrees, require_transformation
from survey.io.vector.gdal import gdal_bindings, gdal_faults

_DRIVERS = {
    ".gpkg": "GPKG",
    ".geojson": "GeoJSON",
    ".json": "GeoJSON",
    ".kml": "KML",
    ".gpx": "GPX",
    ".shp": "ESRI Shapefile",
}

_SHAPEFILE_NAME = 10
_GDAL_UTC = 100
# Shapefiles carry the day of their last change; a fixed one keeps equal content equal to the byte.
_DRIVER_OPTIONS = {"ESRI Shapefile": {"DBF_DATE_LAST_UPDATE": "2000-01-01"}}


class Layer(NamedTuple):
    """Features of one layer.

    Parameters
    ----------
    geometry : sequence of shapely.Geometry
        Shapes, one per feature.
    attributes : mapping of str to (N,) array_like
        Columns by name.
    """

    geometry: Sequence[Any] | npt.NDArray[Any]
    attributes: Mapping[str, Any]


def write_features(
    path: str | Path,
    geometry: Sequence[Any] | npt.NDArray[Any],
    attributes: Mapping[str, Any],
    crs: CRS,
    *,
    layer: str,
    kind: str | None = None,
    indexed: bool = True,
) -> None:
    """Write features to the format that the file's ending names, or leave what was there.

    `kind` names the geometry of a layer that has no features yet; a GeoPackage without spatial
    index can be written to by SQLite alone.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; its suffix names the format.
    geometry : sequence of shapely.Geometry
        Shapes, one per feature.
    attributes : mapping of str to (N,) array_like
        Columns by name.
    crs : pyproj.CRS
        Of the shapes.
    layer : str
        Name of the layer.
    kind : str, optional
        Kind of geometry of a layer without features.
    indexed : bool
        Whether a GeoPackage gets a spatial index.
    """
    write_layers(path, {layer: Layer(geometry, attributes)}, crs, kind=kind, indexed=indexed)


def write_layers(
    path: str | Path,
    layers: Mapping[str, Layer],
    crs: CRS,
    *,
    kind: str | None = None,
    indexed: bool = True,
) -> None:
    """Write layers of features to one file, or leave what was there; a GeoPackage alone holds several.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; its suffix names the format.
    layers : mapping of str to Layer
        Layers by name.
    crs : pyproj.CRS
        Of the shapes.
    kind, indexed
        As for `write_features`.

    Raises
    ------
    InputError
        Another format, or several layers in one that holds one layer.
    """
    target = Path(path)
    driver = _DRIVERS.get(target.suffix.lower())
    if driver is None:
        raise InputError(
            f"{target.name} ends in {target.suffix!r}; one of {', '.join(sorted(_DRIVERS))} was expected."
        )
    if len(layers) > 1 and driver != "GPKG":
        raise InputError(f"{target.name} holds one layer, not {len(layers)}; write .gpkg.")
    options = {**_DRIVER_OPTIONS.get(driver, {}), **({} if indexed else {"SPATIAL_INDEX": "NO"})}
    facts = {name: _facts(driver, layer, crs, target, kind) for name, layer in layers.items()}
    with replacing(target, stale=stale_files(target)) as draft, gdal_bindings() as gdal:
        try:
            for number, (name, values) in enumerate(facts.items()):
                gdal.raw.write(draft, driver=driver, layer=name, append=number > 0, **values, **options)
        except gdal_faults() as error:
            raise unwritable(target, error) from error


def _facts(driver: str, layer: Layer, crs: CRS, target: Path, kind: str | None) -> dict[str, Any]:
    """Return what GDAL writes of a layer."""
    shapes = np.asarray(layer.geometry, dtype=object)
    if driver == "ESRI Shapefile":
        _check_for_shapefile(target, shapes, layer.attributes)
    shapes, attributes, crs = _for_driver(driver, shapes, layer.attributes, crs, target)
    return {
        "geometry": shapely.to_wkb(shapes),
        "field_data": [np.asarray(column) for column in attributes.values()],
        "fields": list(attributes),
        "geometry_type": kind or _common_type(shapes),
        "crs": crs.to_wkt(),
        "gdal_tz_offsets": _in_utc(attributes),
    }


def _for_driver(
    driver: str, shapes: npt.NDArray[Any], attributes: Mapping[str, Any], crs: CRS, path: Path
) -> tuple[npt.NDArray[Any], Mapping[str, Any], CRS]:
    """Return what a format can hold: a GeoJSON names a registered CRS, else it holds degrees."""
    if driver in ("KML", "GPX"):
        require_transformation(crs, path)
    if driver != "GeoJSON":
        return shapes, attributes, crs
    registered = coded_crs(crs)
    if registered is not None:
        return shapes, attributes, registered
    return *in_degrees(shapes, attributes, crs, path), WGS84


def _in_utc(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return GDAL's mark of UTC for every column of times."""
    return {
        name: np.full(len(column), _GDAL_UTC, dtype=np.int32)
        for name, column in attributes.items()
        if np.issubdtype(np.asarray(column).dtype, np.datetime64)
    }


def _check_for_shapefile(path: Path, shapes: npt.NDArray[Any], attributes: Mapping[str, Any]) -> None:
    """Refuse what a Shapefile would change silently: mixed kinds, and column names that it cuts off."""
    kinds = sorted({shape.geom_type.removeprefix("Multi") for shape in shapes})
    if len(kinds) > 1:
        raise InputError(
            f"{path}: a Shapefile holds one kind of geometry, not {' and '.join(kinds)}; write .gpkg or .geojson."
        )
    long = [name for name in attributes if len(name) > _SHAPEFILE_NAME]
    if long:
        raise InputError(
            f"{path}: a Shapefile cuts the column {long[0]!r} to {_SHAPEFILE_NAME} letters; write .gpkg or .geojson."
        )


def _common_type(shapes: npt.NDArray[Any]) -> str:
    kinds = {shape.geom_type for shape in shapes}
    name = kinds.pop() if len(kinds) == 1 else "Unknown"
    return f"{name} Z" if name != "Unknown" and bool(np.all(shapely.has_z(shapes))) else name
