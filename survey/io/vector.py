"""Vector files: GeoPackage, GeoJSON, KML, KMZ, Shapefile, FlatGeobuf and GPX, through GDAL.

Features are read with their layers, attributes and CRS, and written in layers. GeoJSON, KML and GPX hold degrees (WGS 84):
geometries in another CRS are transformed, and a column with its WKT brings them back. GDAL works without network.
"""

import logging
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.core import (
    CapacityError,
    InputError,
    existing_file,
    first_line,
    printable,
    refusing_damage,
    replacing,
)
from survey.core.files import unwritable, warnings_logged
from survey.core.transformation import WGS84, coded_crs, transformed
from survey.io.dataset_files import companion_files, stale_files
from survey.io.file_kinds import OFFLINE, check_vector_file, kml_document

logger = logging.getLogger(__name__)

_GDAL_OPTIONS = {
    **OFFLINE,
    # GeoPackages carry the time of their last change; a fixed one keeps equal content equal to the byte.
    "OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z",
    # A ring that is not closed is refused, not closed behind the user's back.
    "OGR_GEOMETRY_ACCEPT_UNCLOSED_RING": "NO",
}


@contextmanager
def gdal_bindings() -> Iterator[Any]:
    """Yield the bindings to GDAL, without network; options that others have set come back afterwards."""
    pyogrio = _pyogrio()
    before = {name: pyogrio.get_gdal_config_option(name) for name in _GDAL_OPTIONS}
    pyogrio.set_gdal_config_options(_GDAL_OPTIONS)
    try:
        yield pyogrio
    finally:
        pyogrio.set_gdal_config_options(before)


def _pyogrio() -> Any:
    """Import pyogrio, which takes 30 MB, when it is first needed.

    It imports GeoPandas, pandas and PyArrow where they are installed, in 0.5 s, and readers of layers use none of them. A
    command does without; a program of the user's finds all three.
    """
    main = getattr(sys.modules.get("__main__"), "__spec__", None)
    is_command = "firnline.__main__" in sys.modules or getattr(main, "name", "") == "firnline.__main__"
    if is_command and "pyogrio" not in sys.modules:
        hidden = {"geopandas", "pandas", "pyarrow"}.difference(sys.modules)
        sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]  # an import of them fails
        try:
            return import_module("pyogrio")
        finally:
            for name in hidden:
                del sys.modules[name]
    return import_module("pyogrio")


def pyogrio_errors() -> tuple[type[Exception], ...]:
    """Return what reading and writing through GDAL may raise."""
    e = _pyogrio().errors
    return (
        e.DataSourceError,
        e.DataLayerError,
        e.FeatureError,
        e.GeometryError,
        e.FieldError,
        e.CRSError,
        ValueError,
    )


SURVEY_CRS = "survey_crs"
"""Column of a GeoJSON in degrees that holds the projected CRS of its features as WKT."""


def require_transformation(crs: CRS, path: Path) -> None:
    """Refuse a CRS without a transformation to degrees for a file that holds degrees."""
    source = crs.source_crs if crs.is_bound and crs.source_crs is not None else crs
    if source.geodetic_crs is None:
        raise InputError(
            f"{path.name} holds degrees, but {crs.name} is a local system that no transformation ties to the Earth; "
            "write GeoPackage (.gpkg), or assign the data the CRS that they were surveyed in."
        )


def in_degrees(
    geometry: npt.NDArray[Any], attributes: Mapping[str, Any], crs: CRS, path: Path
) -> tuple[npt.NDArray[Any], dict[str, Any]]:
    """Transform geometries to longitude and latitude, and add the column that names their CRS."""
    require_transformation(crs, path)
    moved = _moved(geometry, crs, WGS84, str(path))
    wkt = np.array([crs.to_wkt()] * len(geometry), dtype=object)
    return moved, {**attributes, SURVEY_CRS: wkt}


def in_survey_crs(
    geometry: npt.NDArray[Any], attributes: dict[str, npt.NDArray[Any]], where: str
) -> tuple[npt.NDArray[Any], dict[str, npt.NDArray[Any]], str]:
    """Transform geometries back to the CRS that the column `SURVEY_CRS` names, and return it as WKT."""
    named = {str(value) for value in attributes[SURVEY_CRS]}
    if len(named) != 1:
        raise InputError(f"{where} names {len(named)} systems in its column {SURVEY_CRS}; one was expected.")
    wkt = named.pop()
    moved = _moved(geometry, WGS84, wkt, where)
    return moved, {name: column for name, column in attributes.items() if name != SURVEY_CRS}, wkt


def _moved(geometry: npt.NDArray[Any], source: Any, target: Any, where: str) -> npt.NDArray[Any]:
    """Transform easting and northing, and leave heights as they are."""

    def move(coordinates: npt.NDArray[Any]) -> npt.NDArray[Any]:
        places = transformed(coordinates[:, :2], source, target, where)
        return np.column_stack([places, coordinates[:, 2:]])

    has_z = bool(np.all(shapely.has_z(geometry)))
    return np.asarray(shapely.transform(geometry, move, include_z=has_z), dtype=object)


LARGEST_FEATURES = 5_000_000
"""Most features that are read at once: some 2 GB for points with a few attributes."""
_COUNTED = frozenset({".gpkg", ".shp", ".fgb"})
# GPX files have the same five layers always.
_LAYERED = frozenset({".gpkg", ".kml", ".kmz"})


class Features(NamedTuple):
    """Geometries with their attributes, column by column."""

    geometry: npt.NDArray[Any]
    attributes: dict[str, npt.NDArray[Any]]
    crs: Any


def read_features(
    path: str | Path,
    *,
    layer: str | int | None = None,
    what: str = "the vector file",
    dates_as_text: bool = False,
) -> Features:
    """Read all features of a layer."""
    file = existing_file(path, what)
    n_stated = check_vector_file(file, what)
    if file.suffix.lower() == ".shp" and not any(
        beside.suffix.lower() == ".dbf" for beside in companion_files(file)
    ):
        logger.warning(
            "%s %s has no .dbf beside it; names and roles of its features are missing.", what, file
        )
    with _gdal_of(file, what) as (gdal, source):
        if layer is None:
            _refuse_several_layers(gdal, source, file, what)
        _refuse_too_many(gdal, source, file, layer, what)
        meta, _, geometry, columns = gdal.raw.read(source, layer=layer, datetime_as_string=dates_as_text)
    if geometry is None or len(geometry) == 0:
        raise InputError(f"{what} {file} holds no features; draw at least one and save it again.")
    if n_stated > len(geometry):
        raise InputError(
            f"{what} {file} holds {n_stated} features, of which {len(geometry)} can be read; move all into one list 'features'."
        )
    try:
        shapes = shapely.from_wkb(geometry)
    except shapely.errors.GEOSException as error:
        raise InputError(
            f"{what} {file} holds a shape that cannot be built ({first_line(error).rpartition(': ')[2]}); correct it in a GIS."
        ) from error
    shapes, attributes = np.asarray(shapes, dtype=object), dict(zip(meta["fields"], columns, strict=True))
    if SURVEY_CRS in attributes:
        return Features(*in_survey_crs(shapes, attributes, f"{what} {file}"))
    return Features(shapes, attributes, meta["crs"])


def layer_names(path: str | Path, *, what: str = "the vector file") -> list[str]:
    """Return the names of the layers of a vector file, such as the folders of KML."""
    file = existing_file(path, what)
    check_vector_file(file, what)
    with _gdal_of(file, what) as (gdal, source):
        return [str(name) for name, _ in gdal.list_layers(source)]


def geometry_types(path: str | Path, *, what: str = "the vector file") -> set[str]:
    """Return the types of geometry in all layers of a vector file: Point, LineString, Polygon."""
    return set().union(*(_types_in(path, name, what) for name in layer_names(path, what=what)))


def polygon_layer(path: str | Path, *, what: str = "the vector file") -> str | None:
    """Return the name of the layer of a vector file that holds its polygons, such as a folder of KML.

    Returns: None where the file has one layer only, or where none or several hold polygons. The log states
    the choice.
    """
    names = layer_names(path, what=what)
    if len(names) == 1:
        return None
    found = [name for name in names if "Polygon" in _types_in(path, name, what)]
    if len(found) != 1:
        return None
    logger.warning(
        "%s %s has %d layers; the one with polygons, %s, is read.",
        what,
        path,
        len(names),
        printable(found[0]),
    )
    return found[0]


def _types_in(path: str | Path, layer: str, what: str) -> set[str]:
    """Return the types of geometry in a layer; empty for a table without geometries."""
    with _gdal_of(Path(path), what) as (gdal, source):
        declared = gdal.read_info(source, layer=layer)["geometry_type"]
    if declared is None:
        return set()
    found = {declared}
    if declared.startswith(("Unknown", "GeometryCollection")):
        shapes = read_features(path, layer=layer, what=what).geometry
        known = [shape for shape in shapes if shape is not None]
        found = {part.geom_type for part in shapely.get_parts(shapely.get_parts(known))}
    return {name.split()[0].removeprefix("2.5D").removeprefix("Multi") for name in found}


@contextmanager
def _gdal_of(file: Path, what: str) -> Iterator[tuple[Any, Path]]:
    """Give GDAL's bindings and the file that they open; what they raise about it becomes an `InputError`."""
    with (
        refusing_damage(f"{what} {file}", "vector file that GDAL can read"),
        _opened(file, what) as source,
        gdal_bindings() as gdal,
        warnings_logged(),
    ):
        yield gdal, source


@contextmanager
def _opened(file: Path, what: str) -> Iterator[Path]:
    """Yield the file that GDAL opens: the one that is meant, or one in a folder for the time of reading.

    Of KML the checked document is opened. The bindings take `!` in a path for the end of an archive's name.
    """
    source = file.absolute()
    if file.suffix.lower() not in (".kml", ".kmz") and "!" not in str(source):
        yield source
        return
    with TemporaryDirectory(prefix="firnline-") as name:
        plain = Path(name) / source.name.replace("!", "_")
        if file.suffix.lower() in (".kml", ".kmz"):
            plain = plain.with_suffix(".kml")
            plain.write_bytes(kml_document(file, what))
        else:
            for beside in (source, *companion_files(source)):
                plain.with_suffix(beside.suffix).symlink_to(beside)
        yield plain


def _refuse_several_layers(gdal: Any, source: Path, file: Path, what: str) -> None:
    """Refuse a GeoPackage or KML file with several layers of geometries; any of them could be meant."""
    if file.suffix.lower() not in _LAYERED:
        return
    layers = [name for name, kind in gdal.list_layers(source) if kind is not None]
    if len(layers) > 1:
        shown = ", ".join(printable(str(name)) for name in layers[:5])
        raise InputError(
            f"{what} {file} has {len(layers)} layers ({shown}); save the one that is meant as a file of its own."
        )


def _refuse_too_many(gdal: Any, source: Path, file: Path, layer: str | int | None, what: str) -> None:
    """Refuse more features than fit the memory, where the format counts them in its header."""
    if file.suffix.lower() not in _COUNTED:
        return
    n_features = gdal.read_info(source, layer=layer)["features"]
    if n_features > LARGEST_FEATURES:
        raise CapacityError(
            f"{what} {file} has {n_features:,} features; {LARGEST_FEATURES:,} can be read at once, cut or thin it."
        )


_DRIVERS = {
    ".gpkg": "GPKG", ".geojson": "GeoJSON", ".json": "GeoJSON", ".kml": "KML", ".gpx": "GPX",
    ".shp": "ESRI Shapefile",
}  # fmt: skip

_SHAPEFILE_NAME = 10
_GDAL_UTC = 100
# Shapefiles carry the day of their last change; a fixed one keeps equal content equal to the byte.
_DRIVER_OPTIONS = {"ESRI Shapefile": {"DBF_DATE_LAST_UPDATE": "2000-01-01"}}


class Layer(NamedTuple):
    """Features of one layer.

    `geometry`: shapes, one per feature. `attributes`: columns by name.
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
    """
    write_layers(path, {layer: Layer(geometry, attributes)}, crs, kind=kind, indexed=indexed)


def write_layers(
    path: str | Path, layers: Mapping[str, Layer], crs: CRS, *, kind: str | None = None, indexed: bool = True
) -> None:
    """Write layers of features to one file, or leave what was there; a GeoPackage alone holds several."""
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
            with _named_plainly(draft) as place:
                for number, (name, values) in enumerate(facts.items()):
                    gdal.raw.write(place, driver=driver, layer=name, append=number > 0, **values, **options)
        except pyogrio_errors() as error:
            raise unwritable(target, error) from error


@contextmanager
def _named_plainly(draft: Path) -> Iterator[Path]:
    """Yield where GDAL writes a draft: itself, or a folder whose files take its name, where its path has a `!`."""
    if "!" not in str(draft.absolute()):
        yield draft
        return
    with TemporaryDirectory(prefix="firnline-") as folder:
        yield Path(folder) / f"draft{draft.suffix}"
        for file in Path(folder).iterdir():
            shutil.move(file, draft.with_suffix(file.suffix))


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
