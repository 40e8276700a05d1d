"""Points as a table: places, other columns, CRS, vertical datum; checks common to all formats."""

import logging
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.core.crs.vertical_datum import UNSTATED
from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line
from survey.io.point_columns import PLACE

LARGEST_POINTS = 30_000_000
"""Most points that are read at once: some 3 GB from LAS with its attributes."""
DATUM = "vertical_datum"
CRC = "crc32"
# Coordinates that stand in a file twice may be rounded once.
_SAME_PLACE_M = 0.01


class PointTable(NamedTuple):
    """Columns of equal length, ``x_m``, ``y_m`` and ``z_m`` among them; CRS and datum where the file names them.

    ``is_ground`` (N,) is true for points of the ground, by their classes; None where all are of the ground.
    """

    columns: dict[str, FloatArray]
    crs: Any = None
    vertical_datum: str = UNSTATED
    is_ground: BoolArray | None = None


def ground_of(table: PointTable, where: str) -> PointTable:
    """Return the points of the ground alone, and log how many others are left out."""
    if table.is_ground is None:
        return table
    kept = table.is_ground
    if not kept.any():
        raise InputError(f"{where} holds noise and withheld points alone; no ground can be mapped from it.")
    logging.getLogger(__name__).warning(
        "%s: %d of %d points are used: those of the ground (class 2), or where it is not classified all but noise "
        "(classes 7 and 18) and withheld ones.",
        where,
        int(kept.sum()),
        len(kept),
    )
    columns = {name: column[kept] for name, column in table.columns.items()}
    return table._replace(columns=columns, is_ground=None)


def once_each(table: PointTable, where: str) -> PointTable:
    """Return a table in which rows that repeat another in every column count once, and log how many are left out.

    A point that is stored twice is one measurement: as two it would halve the variance that the map states there.
    """
    x, y, z = (table.columns[name] for name in PLACE)
    order = np.lexsort((z, y, x))
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
        len(order),
    )
    kept = np.sort(order[~repeats])
    columns = {name: column[kept] for name, column in table.columns.items()}
    return table._replace(
        columns=columns, is_ground=None if table.is_ground is None else table.is_ground[kept]
    )


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


def damaged(file: Path, kind: str, error: BaseException) -> InputError:
    """Return the refusal of a file that a library could not read."""
    return InputError(f"the point file {file} is damaged or no {kind} ({first_line(error)}); get it again.")
