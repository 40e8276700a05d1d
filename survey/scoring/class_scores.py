"""Error statistics by class of ground: slope, land cover, or any classes of the nodes or checkpoints.

`class_scores` computes statistics for each class from errors, standard deviations and the names of their
classes. `slope_classes` names the classes of slopes. `land_cover_at` reads the class at places from a raster of
codes, or from polygons with a column of classes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from pyproj import CRS

from survey.core import FloatArray, InputError, printable
from survey.core.transformation import transformed
from survey.io.file_kinds import VECTOR_SUFFIXES
from survey.io.raster.writing import read_codes
from survey.io.vector import Features, read_features
from survey.scoring.accuracy import Calibration, ErrorStatistics

SLOPE_EDGES_DEG = (0.0, 5.0, 10.0, 20.0, 30.0, 90.0)
"""Limits of the classes of slope [deg]."""
NO_CLASS = "no class"
"""Name of the errors that lie in none of the classes."""


@dataclass(frozen=True)
class ClassScore:
    """Error statistics of one class.

    `name`: name of the class. `n`: number of errors in it. `rmse_m`, `nmad_m`, `bias_m`: root mean square,
    normalized median absolute deviation and mean of the errors [m]. `coverage_95`: share of the errors within
    ±1.96 stated standard deviations; NaN where none is stated.
    """

    name: str
    n: int
    rmse_m: float
    nmad_m: float
    bias_m: float
    coverage_95: float


def class_scores(errors: Any, std: Any, classes: Any) -> tuple[ClassScore, ...]:
    """Compute error statistics for each class.

    `errors` (N,): map minus reference [m]. `std` (N,): stated standard deviations [m]; NaN where none is
    stated. `classes` (N,) str: name of the class of each error.

    >>> rows = class_scores([0.1, -0.1, 0.4], [0.1, 0.1, 0.1], ["ice", "ice", "rock"])
    >>> [(row.name, row.n, round(row.rmse_m, 2), row.coverage_95) for row in rows]
    [('ice', 2, 0.1, 1.0), ('rock', 1, 0.4, 0.0)]
    """
    e, s, c = np.asarray(errors, dtype=np.float64), np.asarray(std, dtype=np.float64), np.asarray(classes)
    if not (e.shape == s.shape == c.shape) or e.ndim != 1 or not len(e):
        raise InputError(
            f"there are {e.size} errors, {s.size} standard deviations and {c.size} classes; one of each was expected."
        )
    names = sorted(set(c.tolist()), key=_order)
    return tuple(_class_score(name, e[c == name], s[c == name]) for name in names)


def slope_classes(
    slope_deg: FloatArray, edges_deg: Sequence[float] = SLOPE_EDGES_DEG
) -> npt.NDArray[np.str_]:
    """Return the name of the class of each slope (N,) [deg].

    `slope_deg` (N,): slopes [deg]; NaN belongs to no class. `edges_deg`: limits of the classes, ascending
    [deg]; a limit belongs to the steeper class. Returns (N,) str: such as ``"5 to 10°"``.

    >>> slope_classes(np.array([0.0, 5.0, 40.0, np.nan])).tolist()
    ['0 to 5°', '5 to 10°', '30 to 90°', 'no class']
    """
    names = np.array([f"{low:g} to {high:g}°" for low, high in pairwise(edges_deg)] + [NO_CLASS])
    index = np.searchsorted(edges_deg, slope_deg, side="right") - 1
    known = np.isfinite(slope_deg) & (index >= 0) & (index < len(edges_deg) - 1)
    found: npt.NDArray[np.str_] = names[np.where(known, index, len(edges_deg) - 1)]
    return found


def _class_score(name: str, errors: FloatArray, std: FloatArray) -> ClassScore:
    found = ErrorStatistics.of(errors)
    coverage = Calibration.of(errors, std).coverage_95
    return ClassScore(name, found.n, found.rmse_m, found.nmad_m, found.bias_m, coverage)


def _order(name: str) -> tuple[bool, float, str]:
    """Sort names that begin with a number by it, the others by their letters, and no class last."""
    head = name.split(" ", maxsplit=1)[0]
    number = float(head) if head.replace(".", "", 1).isdigit() else np.inf
    return name == NO_CLASS, number, name


# Columns that are taken for the class, the first one present.
_COLUMNS = ("class", "landcover", "land_cover", "cover", "lc", "type", "name")


def land_cover_at(path: str | Path, xy: FloatArray, crs: CRS, column: str | None = None) -> npt.NDArray[Any]:
    """Return the name of the class at each place.

    `xy` (N, 2): easting and northing [m]. Returns (N,) str: classes of polygons by name, codes of a raster as
    ``"3"``; ``"no class"`` beyond them. Of polygons that overlap the first in the file counts.
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
