"""Reading of features: layers, geometries with their attributes, and the types of geometry."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line, warnings_logged
from survey.core.files.reading import existing_file
from survey.core.text import printable
from survey.io.degrees import SURVEY_CRS, in_survey_crs
from survey.io.file_kinds import check_vector_file
from survey.io.kmz import kml_document
from survey.io.vector.gdal import gdal_bindings, gdal_faults

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
    """Read all features of a layer.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose suffix is in `survey.io.file_kinds.VECTOR_SUFFIXES`.
    layer : str or int, optional
        Name or number of the layer; the only one by default.
    what : str
        What the file is, for the message.
    dates_as_text : bool
        Whether columns of dates become text, which has their offsets from UTC; as numbers they lose them.

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
    with _gdal_of(file, what) as gdal:
        if layer is None:
            _refuse_several_layers(gdal, file, what)
        _refuse_too_many(gdal, file, layer, what)
        meta, _, geometry, columns = gdal.raw.read(
            _source(file, what), layer=layer, datetime_as_string=dates_as_text
        )
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
    with _gdal_of(file, what) as gdal:
        return [str(name) for name, _ in gdal.list_layers(_source(file, what))]


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
    return set().union(*(_types_in(path, name, what) for name in layer_names(path, what=what)))


def polygon_layer(path: str | Path, *, what: str = "the vector file") -> str | None:
    """Return the name of the layer of a vector file that holds its polygons, such as a folder of KML.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose suffix is in `survey.io.file_kinds.VECTOR_SUFFIXES`.
    what : str
        What the file is, for the message.

    Returns
    -------
    str or None
        None where the file has one layer only, or where none or several hold polygons. The log states the choice.

    Raises
    ------
    InputError
        Missing, empty or damaged.
    """
    names = layer_names(path, what=what)
    if len(names) == 1:
        return None
    found = [name for name in names if "Polygon" in _types_in(path, name, what)]
    if len(found) != 1:
        return None
    logging.getLogger(__name__).warning(
        "%s %s has %d layers; the one with polygons, %s, is read.",
        what,
        path,
        len(names),
        printable(found[0]),
    )
    return found[0]


def _types_in(path: str | Path, layer: str, what: str) -> set[str]:
    """Return the types of geometry in a layer; empty for a table without geometries."""
    with _gdal_of(Path(path), what) as gdal:
        declared = gdal.read_info(_source(Path(path), what), layer=layer)["geometry_type"]
    if declared is None:
        return set()
    found = {declared}
    if declared.startswith(("Unknown", "GeometryCollection")):
        shapes = read_features(path, layer=layer, what=what).geometry
        found = {shape.geom_type for shape in shapes if shape is not None}
    return {name.split()[0].removeprefix("2.5D").removeprefix("Multi") for name in found}


@contextmanager
def _gdal_of(file: Path, what: str) -> Iterator[Any]:
    """Give GDAL's bindings; what they raise about the file becomes an `InputError`."""
    try:
        with gdal_bindings() as gdal, warnings_logged():
            yield gdal
    except InputError:
        raise
    except gdal_faults() as error:
        raise InputError(
            f"{what} {file} is damaged or no vector format that GDAL knows ({first_line(error)}); get it again."
        ) from error


def _source(file: Path, what: str) -> Path | bytes:
    """Return what GDAL opens: a file, or the document in an archive."""
    return kml_document(file, what) if file.suffix.lower() == ".kmz" else file.absolute()


def _refuse_several_layers(gdal: Any, file: Path, what: str) -> None:
    """Refuse a GeoPackage or KML file with several layers of geometries; any of them could be meant."""
    if file.suffix.lower() not in _LAYERED:
        return
    layers = [name for name, kind in gdal.list_layers(_source(file, what)) if kind is not None]
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
