"""Tables of points: names of the coordinate columns, and checks common to all formats.

A `PointTable` has the columns ``x_m``, ``y_m`` and ``z_m``, others of equal length, and the CRS and vertical datum where
the file names them. Coordinates under names that other programs write are found by families of columns: own names,
easting and northing, then longitude and latitude.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pyproj import CRS

from survey.core import UNSTATED, BoolArray, CapacityError, FloatArray, InputError, IntArray
from survey.core.lengths import FOOT_M, length_name, log_converted, named_units, same_length
from survey.core.transformation import WGS84, MetricCrs, metric_crs
from survey.io.column_names import (
    SPELLINGS,
    datum_of_column,
    metres_first,
    normalize,
    stated_length,
    without_length,
)

SIGMA = "sigma_z_m"
PLACE = ("x_m", "y_m", "z_m")


class _Family(NamedTuple):
    """Names of the horizontal columns, and the name of a height that belongs to them."""

    first: tuple[str, ...]
    second: tuple[str, ...]
    height: str
    is_geographic: bool = False


# Metres before degrees: a table that has both is read in metres.
_FAMILIES = (
    _Family(SPELLINGS["x"], SPELLINGS["y"], "z"),
    _Family(SPELLINGS["easting"], SPELLINGS["northing"], "h"),
    _Family(SPELLINGS["longitude"], SPELLINGS["latitude"], "height", is_geographic=True),
)


class PlaceColumns(NamedTuple):
    """Names of the columns of easting (or longitude), northing (or latitude) and height in a table."""

    names: tuple[str, str, str]
    is_geographic: bool


def place_columns(header: Sequence[str], where: str) -> PlaceColumns:
    """Return the columns that hold the place of each point; case and marks between words do not matter.

    Returns: own names (``x_m``, ``y_m``, ``z_m``) first, then ``x, y, z``, ``easting, northing, elevation``,
    ``E, N, H``, and in degrees ``lon, lat, height`` or ``longitude, latitude, elevation``; `SPELLINGS` lists
    all names.

    >>> place_columns(["id", "E", "N", "H"], "points.csv")
    PlaceColumns(names=('E', 'N', 'H'), is_geographic=False)
    >>> place_columns(["lon", "lat", "height"], "points.csv").is_geographic
    True
    """
    if all(name in header for name in PLACE):
        return PlaceColumns(PLACE, is_geographic=False)
    found = {normalize(name): name for name in header}
    if len(found) < len(header):
        raise InputError(
            f"{where} has columns whose names differ in the case of letters or in marks alone; rename or remove them."
        )
    for name in metres_first(header) + list(header):
        found.setdefault(without_length(name), name)
    families = [f for f in _FAMILIES if _named(f.first, found) and _named(f.second, found)]
    metric = [family for family in families if not family.is_geographic]
    chosen = (metric or families)[:1]
    if not chosen or len(metric) > 1:
        raise InputError(
            f"{where} has {'several' if chosen else 'no'} columns of places (found {', '.join(header) or 'nothing'}); "
            "name them x_m, y_m, z_m or x, y, z or easting, northing, elevation or lon, lat, height, or choose them with --columns "
            "x=3,y=2,z=4 or, without a header, --format pnezd."
        )
    family = chosen[0]
    first, second = _one(family.first, found, where), _one(family.second, found, where)
    return PlaceColumns((first, second, _height(family, found, where)), family.is_geographic)


def in_own_columns(
    columns: dict[str, FloatArray], where: str, header: Mapping[str, str] | None = None
) -> "PointTable":
    """Rename the columns of the place to ``x_m``, ``y_m`` and ``z_m``, first in the table.

    `header`: name in the file of columns that have another one here. Returns: in WGS 84 for degrees, else without CRS.
    """
    names, is_geographic = place_columns(list(columns), where)
    in_file = {**dict(zip(columns, columns, strict=True)), **(header or {})}
    in_file |= {own: in_file[name] for own, name in zip(PLACE, names, strict=True)}
    datum, lengths = datum_of_column(in_file[PLACE[2]]), stated_lengths(in_file)
    places = {own: columns[name] for own, name in zip(PLACE, names, strict=True)}
    others = {name: column for name, column in columns.items() if name not in names}
    if not is_geographic:
        return PointTable({**places, **others}, None, datum, lengths=lengths)
    for name, limit in (("x_m", 360.0), ("y_m", 90.0)):
        largest = float(np.abs(places[name]).max())
        if largest > limit:
            source = names[PLACE.index(name)]
            raise InputError(
                f"{where} holds {largest:g} in the column {source}, which is no angle in degrees; "
                "rename the columns to easting and northing if they are metres."
            )
    return PointTable({**places, **others}, WGS84, datum, lengths=lengths)


def log_projection(where: str, crs: CRS) -> None:
    """Log in one sentence that degrees were projected."""
    logging.getLogger(__name__).warning(
        "%s is in degrees (WGS 84); its points are projected to %s.", where, crs.name
    )


def _named(names: tuple[str, ...], found: dict[str, str]) -> bool:
    return any(name in found for name in names)


def _present(names: tuple[str, ...], found: dict[str, str]) -> list[str]:
    """Return the columns that have one of several names, each once; those in feet where there is no other."""
    return metres_first(list(dict.fromkeys(found[name] for name in names if name in found)))


def _one(names: tuple[str, ...], found: dict[str, str], where: str) -> str:
    """Return the only one of several names that a table has."""
    present = _present(names, found)
    if len(present) > 1:
        raise InputError(
            f"{where} has the columns {' and '.join(present)}, which mean the same; remove one of them."
        )
    return present[0]


def _height(family: _Family, found: dict[str, str], where: str) -> str:
    """Return the column of heights: the only one, or the one that belongs to the horizontal columns."""
    present = _present(SPELLINGS["height"], found)
    if len(present) == 1 or PLACE[2] in found:
        return present[0]
    if family.height in found:
        return found[family.height]
    if not present:
        raise InputError(
            f"{where} has no column of heights (found {', '.join(dict.fromkeys(found.values()))}); name it z_m, z, elevation or height, or choose it with --columns z=NAME."
        )
    raise InputError(
        f"{where} has the columns {' and '.join(present)}, and either could be the height; name the one that is meant z_m, or choose it with --columns z=NAME where the command has that option."
    )


LARGEST_POINTS = 30_000_000
"""Most points that are read at once: some 3 GB from LAS with its attributes."""
DATUM = "vertical_datum"
CRC = "crc32"
# Coordinates that stand in a file twice may be rounded once.
_SAME_PLACE_M = 0.01


class PointTable(NamedTuple):
    """Columns of equal length, ``x_m``, ``y_m`` and ``z_m`` among them; CRS and datum where the file names them.

    ``classes`` (N,): of LAS, with the codes of `survey.io.point_classes`; None where the file has none.
    ``lengths``: metres in a unit of a column, where the file states it; `table_in_metres` converts by them.
    """

    columns: dict[str, FloatArray]
    crs: Any = None
    vertical_datum: str = UNSTATED
    classes: npt.NDArray[np.uint16] | None = None
    lengths: Mapping[str, float] = {}

    @property
    def n(self) -> int:
        """Number of points."""
        return len(self.columns[PLACE[0]])

    def select(self, kept: BoolArray | IntArray) -> "PointTable":
        """Return the points at which `kept` is true, or whose numbers it holds."""
        columns = {name: column[kept] for name, column in self.columns.items()}
        return self._replace(columns=columns, classes=None if self.classes is None else self.classes[kept])


# Columns that count in the unit of the eastings and northings, and in that of the heights, where nothing else is stated.
_LIKE_PLACES = (*PLACE[:2], "map_x_m", "map_y_m", "sigma_xy_m")
_LIKE_HEIGHTS = (PLACE[2], SIGMA)


def stated_lengths(names: Mapping[str, str]) -> dict[str, float]:
    """Return the metres in a unit of columns by own name, where the names (by own name) that the file gives them state it."""
    stated = {own: stated_length(name) for own, name in names.items() if own in _LIKE_PLACES + _LIKE_HEIGHTS}
    return {own: metres for own, metres in stated.items() if metres is not None}


def table_in_metres(table: PointTable, named: Any, units: str | None, where: str) -> PointTable:
    """Return a table in metres, in the twin of its CRS in metres, and log what was converted.

    The unit of a place is that of its column or CRS, that of a height of its column, header or vertical CRS, else `units`.

    `named`: CRS of a file that states none. `units`: unit of heights that state none.
    """
    own = MetricCrs(WGS84) if table.crs is None else metric_crs(table.crs, where)
    asked = MetricCrs(WGS84) if named is None else metric_crs(named, where)
    lengths = units_of_table(
        table.lengths, own if table.crs is not None else asked, asked.height_m, units, where
    )
    columns = {
        name: lengths[name] * column if lengths.get(name, 1.0) != 1.0 else column
        for name, column in table.columns.items()
    }
    return table._replace(columns=columns, crs=None if table.crs is None else own.crs, lengths={})


def units_of_table(
    stated: Mapping[str, float],
    system: MetricCrs,
    named_height_m: float | None,
    units: str | None,
    where: str,
) -> dict[str, float]:
    """Return the metres in a unit of each column of places and heights, and log which are no metres.

    `stated`: by column, as the file states it. `system`: CRS of the places. `named_height_m`: unit of heights of the CRS
    that was named for the file.
    """
    place_m = _unit_of_places(stated, system.place_m, units, where)
    height_m = _agreed_unit(stated.get(PLACE[2]), system.height_m or named_height_m, "heights", where)
    if height_m is None and units is None and place_m != 1.0:
        raise InputError(
            f"{where} has its places in {length_name(place_m)} and does not state the unit of its heights; name it with --units m, ft or us-ft."
        )
    asked_m = None if units is None else named_units(units)
    if height_m is not None and asked_m is not None and not same_length(height_m, asked_m):
        logging.getLogger(__name__).warning(
            "%s states its heights in %s; --units %s is for files that state none, and is not used.",
            where,
            length_name(height_m),
            units,
        )
    height_m = height_m or asked_m or 1.0
    log_converted(where, (("places", place_m), ("heights", height_m)))
    return {**dict.fromkeys(_LIKE_PLACES, place_m), **dict.fromkeys(_LIKE_HEIGHTS, height_m)} | {
        name: metres for name, metres in stated.items() if name not in PLACE
    }


def _unit_of_places(stated: Mapping[str, float], of_crs: float, units: str | None, where: str) -> float:
    """Return the metres in a unit of the places, by their columns or by the CRS."""
    x, y = (stated.get(name) for name in PLACE[:2])
    if (x or 1.0) != (y or 1.0):
        raise InputError(
            f"{where} has one of its places in {length_name(x or 1.0)} and the other in {length_name(y or 1.0)}; write both columns in one unit."
        )
    if x == FOOT_M and of_crs == 1.0:  # the two feet differ by decimetres at usual eastings
        if units in (None, "m"):
            raise InputError(
                f"{where} has its places in feet, and its CRS counts in metres; name the foot with --units ft or us-ft, or its CRS with --crs."
            )
        return named_units(units)
    return _agreed_unit(x, of_crs, "places", where) or 1.0


def _agreed_unit(stated: float | None, of_crs: float | None, what: str, where: str) -> float | None:
    """Return the unit of columns or header where the CRS states none, of the CRS where both are feet; refuse metres beside feet."""
    if stated is None or of_crs is None:
        return of_crs if stated is None else stated
    if same_length(stated, of_crs) or (stated == FOOT_M and abs(of_crs - stated) < 1e-5):
        return of_crs
    if what == "places" and of_crs == 1.0:
        return stated
    raise InputError(
        f"{where} states its {what} in {length_name(stated)}, and its CRS counts in {length_name(of_crs)}; rename the column, or name the CRS "
        "that is meant with --crs."
    )


# Odd numbers without a pattern: equal sums of other rows are as rare as chance makes them.
_SCRAMBLE = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


def once_each(table: PointTable, where: str) -> PointTable:
    """Return a table in which rows that repeat another in every column count once, and log how many are left out.

    A point that is stored twice is one measurement: as two it would halve the variance that the map states there.
    """
    x, y, z = (table.columns[name] for name in PLACE)
    alike = _may_repeat(x, y, z)
    if not len(alike):
        return table
    order = alike[np.lexsort((z[alike], y[alike], x[alike]))]
    repeats = np.zeros(len(order), dtype=np.bool_)
    repeats[1:] = np.logical_and.reduce(
        [_equal_neighbours(np.asarray(column)[order]) for column in table.columns.values()]
    )
    if not repeats.any():
        return table
    logging.getLogger(__name__).warning(
        "%s: %d of %d points repeat another one exactly and are left out.",
        where,
        int(repeats.sum()),
        len(x),
    )
    kept = np.setdiff1d(np.arange(len(x)), order[repeats])
    return table.select(kept)


def _may_repeat(*columns: FloatArray) -> IntArray:
    """Return the rows (K,) whose sum of scrambled bits stands in another row too: among them are all that repeat another."""
    total = np.zeros(len(columns[0]), dtype=np.uint64)
    for column, factor in zip(columns, _SCRAMBLE, strict=True):
        bits = (np.asarray(column, dtype=np.float64) + 0.0).view(np.uint64)  # -0.0 is 0.0
        total += (bits ^ (bits >> np.uint64(29))) * factor
    ordered = np.sort(total)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    rows: IntArray = np.flatnonzero(np.isin(total, twice)) if len(twice) else np.empty(0, dtype=np.int64)
    return rows


def _equal_neighbours(column: FloatArray) -> BoolArray:
    """Return whether each value but the first equals the one before; NaN equals NaN."""
    equal: BoolArray = (column[1:] == column[:-1]) | (np.isnan(column[1:]) & np.isnan(column[:-1]))
    return equal


def add_column(columns: dict[str, FloatArray], name: str, values: Any, path: Path) -> None:
    """Add a column; one that is named like a coordinate and says something else is refused."""
    numbers: FloatArray = np.asarray(values).astype(np.float64)
    if name not in columns:
        columns[name] = numbers
    elif not np.allclose(numbers, columns[name], rtol=0.0, atol=_SAME_PLACE_M):
        raise InputError(
            f"the point file {path} has a column {name} that differs from the points' own coordinates; rename or remove it."
        )


def check_count(file: Path, n_points: int) -> None:
    """Refuse a file of more points than can be read at once."""
    if n_points > LARGEST_POINTS:
        raise CapacityError(
            f"the point file {file} has {n_points:,} points; {LARGEST_POINTS:,} can be read at once, cut it into tiles or thin it."
        )


def check_claim(file: Path, n_points: int, point_bytes: int, ratio: int = 1) -> None:
    """Refuse a header that claims more points than the file can hold."""
    if n_points * max(point_bytes, 1) > file.stat().st_size * ratio:
        raise InputError(
            f"the point file {file} claims {n_points:,} points of {point_bytes} bytes but has {file.stat().st_size:,} bytes; it was cut off."
        )
