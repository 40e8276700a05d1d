"""Vector files: GeoPackage, GeoJSON, KML, Shapefile, through GDAL."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.core.crs.choice import coded_crs
from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line, warnings_logged
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing, unwritable
from survey.core.text import printable
from survey.io.companions import stale_files
from survey.io.degrees import SURVEY_CRS, WGS84, in_degrees, in_survey_crs, require_transformation
from survey.io.file_kinds import OFFLINE, check_vector_file

_DRIVERS = {
    ".gpkg": "GPKG",
    ".geojson": "GeoJSON",
    ".json": "GeoJSON",
    ".kml": "KML",
    ".gpx": "GPX",
    ".shp": "ESRI Shapefile",
}

LARGEST_FEATURES = 5_000_000
"""Most features that are read at once: some 2 GB for points with a few attributes."""
_COUNTED = frozenset({".gpkg", ".shp", ".fgb"})
# GPX files have the same five layers always.
_LAYERED = frozenset({".gpkg", ".kml"})
_SHAPEFILE_NAME = 10
_GDAL_UTC = 100
# Shapefiles carry the day of their last change; a fixed one keeps equal content equal to the byte.
_DRIVER_OPTIONS = {"ESRI Shapefile": {"DBF_DATE_LAST_UPDATE": "2000-01-01"}}

_GDAL_OPTIONS = {
    **OFFLINE,
    # GeoPackages carry the time of their last change; a fixed one keeps equal content equal to the byte.
    "OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z",
    # A ring that is not closed is refused, not closed behind the user's back.
    "OGR_GEOMETRY_ACCEPT_UNCLOSED_RING": "NO",
}


@contextmanager
def _gdal() -> Iterator[Any]:
    """Yield the bindings to GDAL, without network; options that others have set come back afterwards."""
    import pyogrio  # loaded when first needed: maps from arrays do without its 30 MB

    before = {name: pyogrio.get_gdal_config_option(name) for name in _GDAL_OPTIONS}
    pyogrio.set_gdal_config_options(_GDAL_OPTIONS)
    try:
        yield pyogrio
    finally:
        pyogrio.set_gdal_config_options(before)


class Features(NamedTuple):
    """Geometries with their attributes, column by column."""

    geometry: npt.NDArray[Any]
    attributes: dict[str, npt.NDArray[Any]]
    crs: Any


def read_features(
    path: str | Path, *, layer: str | int | None = None, what: str = "the vector file"
) -> Features:
    """Read all features of a layer.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose suffix is in `survey.io.file_kinds.VECTOR_SUFFIXES`.
    layer : str or int, optional
        Name or number of the layer; the only one by default.
    what : str
        What the file is, for the message.

    Returns
    -------
    Features
        Geometries as the file has them, columns, CRS.

    Raises
    ------
    InputError
        Missing, empty, damaged, without any geometry, or with several layers where none is named.
    """
    file = existing_file(path, what)
    check_vector_file(file, what)
    try:
        with _gdal() as gdal, warnings_logged():
            if layer is None:
                _refuse_several_layers(gdal, file, what)
            _refuse_too_many(gdal, file, layer, what)
            meta, _, geometry, columns = gdal.raw.read(file.absolute(), layer=layer)
    except InputError:
        raise
    except _faults() as error:
        raise InputError(
            f"{what} {file} is damaged or no vector format that GDAL knows ({first_line(error)}); get it again."
        ) from error
    if geometry is None or len(geometry) == 0:
        raise InputError(f"{what} {file} holds no features; draw at least one and save it again.")
    try:
        shapes = shapely.from_wkb(geometry)
    except shapely.errors.GEOSException as error:
        raise InputError(
            f"{what} {file} holds a geometry that cannot be built ({first_line(error)}); correct it in a GIS."
        ) from error
    shapes, attributes = np.asarray(shapes, dtype=object), dict(zip(meta["fields"], columns, strict=True))
    if SURVEY_CRS in attributes:
        return Features(*in_survey_crs(shapes, attributes, f"{what} {file}"))
    return Features(shapes, attributes, meta["crs"])


def layer_names(path: str | Path, *, what: str = "the vector file") -> list[str]:
    """Return the names of the layers of a vector file, such as the folders of KML.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose suffix is in `survey.io.file_kinds.VECTOR_SUFFIXES`.
    what : str
        What the file is, for the message.

    Returns
    -------
    list of str
        In the order of the file.

    Raises
    ------
    InputError
        Missing, empty or damaged.
    """
    file = existing_file(path, what)
    check_vector_file(file, what)
    try:
        with _gdal() as gdal, warnings_logged():
            return [str(name) for name, _ in gdal.list_layers(file.absolute())]
    except _faults() as error:
        raise InputError(
            f"{what} {file} is damaged or no vector format that GDAL knows ({first_line(error)}); get it again."
        ) from error


def geometry_types(path: str | Path, *, what: str = "the vector file") -> set[str]:
    """Return the types of geometry in all layers of a vector file: Point, LineString, Polygon.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose suffix is in `survey.io.file_kinds.VECTOR_SUFFIXES`.
    what : str
        What the file is, for the message.

    Returns
    -------
    set of str
        Parts of a multiple geometry have the type of one. A layer that declares a type is not read.

    Raises
    ------
    InputError
        Missing, empty or damaged.
    """
    found: set[str] = set()
    for name in layer_names(path, what=what):
        with _gdal() as gdal, warnings_logged():
            declared = gdal.read_info(Path(path).absolute(), layer=name)["geometry_type"]
        if declared is None:
            continue
        if declared.startswith(("Unknown", "GeometryCollection")):
            shapes = read_features(path, layer=name, what=what).geometry
            found |= {shape.geom_type for shape in shapes if shape is not None}
        else:
            found.add(declared)
    return {name.split()[0].removeprefix("2.5D").removeprefix("Multi") for name in found}


def _refuse_several_layers(gdal: Any, file: Path, what: str) -> None:
    """Refuse a GeoPackage or KML file with several layers of geometries; any of them could be meant."""
    if file.suffix.lower() not in _LAYERED:
        return
    layers = [name for name, kind in gdal.list_layers(file.absolute()) if kind is not None]
    if len(layers) > 1:
        shown = ", ".join(printable(str(name)) for name in layers[:5])
        raise InputError(
            f"{what} {file} has {len(layers)} layers ({shown}); save the one that is meant as a file of its own."
        )


def _refuse_too_many(gdal: Any, file: Path, layer: str | int | None, what: str) -> None:
    """Refuse more features than fit the memory, where the format counts them in its header."""
    if file.suffix.lower() not in _COUNTED:
        return
    n_features = gdal.read_info(file.absolute(), layer=layer)["features"]
    if n_features > LARGEST_FEATURES:
        raise CapacityError(
            f"{what} {file} has {n_features:,} features; {LARGEST_FEATURES:,} can be read at once, cut or thin it."
        )


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
    target = Path(path)
    driver = _DRIVERS.get(target.suffix.lower())
    if driver is None:
        raise InputError(
            f"{target.name} ends in {target.suffix!r}; one of {', '.join(sorted(_DRIVERS))} was expected."
        )
    shapes = np.asarray(geometry, dtype=object)
    if driver == "ESRI Shapefile":
        _check_for_shapefile(target, shapes, attributes)
    shapes, attributes, crs = _for_driver(driver, shapes, attributes, crs, target)
    columns = [np.asarray(column) for column in attributes.values()]
    with replacing(target, stale=stale_files(target)) as draft, _gdal() as gdal:
        try:
            gdal.raw.write(
                draft,
                geometry=shapely.to_wkb(shapes),
                field_data=columns,
                fields=list(attributes),
                geometry_type=kind or _common_type(shapes),
                crs=crs.to_wkt(),
                driver=driver,
                layer=layer,
                gdal_tz_offsets=_in_utc(attributes),
                **_DRIVER_OPTIONS.get(driver, {}),
                **({} if indexed else {"SPATIAL_INDEX": "NO"}),
            )
        except _faults() as error:
            raise unwritable(target, error) from error


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


def _faults() -> tuple[type[Exception], ...]:
    """Return what reading and writing through GDAL may raise."""
    from pyogrio import errors as e

    return (
        e.DataSourceError,
        e.DataLayerError,
        e.FeatureError,
        e.GeometryError,
        e.FieldError,
        e.CRSError,
        ValueError,
    )


def _common_type(shapes: npt.NDArray[Any]) -> str:
    kinds = {shape.geom_type for shape in shapes}
    name = kinds.pop() if len(kinds) == 1 else "Unknown"
    return f"{name} Z" if name != "Unknown" and bool(np.all(shapely.has_z(shapes))) else name
