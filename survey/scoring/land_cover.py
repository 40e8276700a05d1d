"""Class of the ground at places: from a raster of codes, or from polygons with a column of classes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.core.text import printable
from survey.io.file_kinds import VECTOR_SUFFIXES
from survey.io.raster.categories import read_codes
from survey.io.vector import Features, read_features
from survey.scoring.class_scores import NO_CLASS

# Columns that are taken for the class, the first one present.
_COLUMNS = ("class", "landcover", "land_cover", "cover", "lc", "type", "name")


def land_cover_at(path: str | Path, xy: FloatArray, crs: CRS, column: str | None = None) -> npt.NDArray[Any]:
    """Return the name of the class at each place.

    Parameters
    ----------
    path : str or pathlib.Path
        Raster of whole numbers, or polygons, in any CRS.
    xy : (N, 2) ndarray
        Easting and northing [m].
    crs : pyproj.CRS
        CRS of the places.
    column : str, optional
        Column of polygons that names the class; by default one of class, landcover, cover, type, name, or the only
        one.

    Returns
    -------
    (N,) ndarray of str
        Classes of polygons by name, codes of a raster as ``"3"``; ``"no class"`` beyond them. Of polygons that
        overlap the first in the file counts.

    Raises
    ------
    InputError
        A file that is damaged or has no CRS, decimals in a raster, or no column that could be the class.
    """
    if Path(path).suffix.lower() in VECTOR_SUFFIXES:
        return _by_polygons(Path(path), xy, crs, column)
    return _by_codes(Path(path), xy, crs)


def _by_codes(path: Path, xy: FloatArray, crs: CRS) -> npt.NDArray[Any]:
    """Take the code of the cell that holds each place."""
    codes = read_codes(path)
    there = transformed(xy, crs, codes.crs, str(path))
    columns, rows = _cells(codes.transform, there)
    height, width = codes.values.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    names = np.full(len(xy), NO_CLASS, dtype=object)
    found = codes.values[rows[inside], columns[inside]]
    names[inside] = [NO_CLASS if code == codes.unknown else str(code) for code in found.tolist()]
    return names.astype(str)


def _cells(transform: Any, xy: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return column and row of the cell that holds each place."""
    inverse = ~transform
    x, y = xy[:, 0], xy[:, 1]
    columns = np.floor(inverse.a * x + inverse.b * y + inverse.c)
    rows = np.floor(inverse.d * x + inverse.e * y + inverse.f)
    return columns.astype(np.int64), rows.astype(np.int64)


def _by_polygons(path: Path, xy: FloatArray, crs: CRS, column: str | None) -> npt.NDArray[Any]:
    """Take the class of the first polygon that holds each place."""
    features = read_features(path, what="the file of classes")
    if features.crs is None:
        raise InputError(
            f"the file of classes {path} carries no coordinate reference system; save it with one."
        )
    labels = _labels(features, column, path)
    there = transformed(xy, crs, features.crs, str(path))
    names = np.full(len(xy), NO_CLASS, dtype=object)
    places = shapely.points(there)
    tree = shapely.STRtree(features.geometry)
    place, polygon = tree.query(places, predicate="intersects")
    for k in np.lexsort((-polygon, place)):  # the first polygon last, so that it stays
        names[place[k]] = labels[polygon[k]]
    return names.astype(str)


def _labels(features: Features, column: str | None, path: Path) -> list[str]:
    attributes = features.attributes
    chosen = column if column is not None else _class_column(attributes, path)
    if chosen not in attributes:
        raise InputError(
            f"the file of classes {path} has no column {chosen!r} (found {', '.join(attributes) or 'none'}); name one of those."
        )
    return [NO_CLASS if value is None else printable(str(value)) for value in attributes[chosen]]


def _class_column(attributes: Mapping[str, Any], path: Path) -> str:
    """Return the column that holds the class."""
    by_name = {name.lower(): name for name in attributes}
    found = next((by_name[name] for name in _COLUMNS if name in by_name), None)
    if found is None and len(attributes) == 1:
        found = next(iter(attributes))
    if found is None:
        raise InputError(
            f"the file of classes {path} has the columns {', '.join(attributes) or 'none'}, and none is named class; choose one with --class-column."
        )
    return found
