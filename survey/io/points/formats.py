"""Point files: text tables, vector files, LAS/LAZ and PLY, as named columns of numbers."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.io.point_columns import PLACE
from survey.io.points.ply import read_ply, write_ply
from survey.io.points.table import PointTable
from survey.io.points.text import read_csv, write_csv
from survey.io.points.vector import VECTOR_ENDINGS, read_vector, write_vector
from survey.io.raster.unmarked_cells import HIGHEST_M, LOWEST_M
from survey.io.raster.values import MARKS, MARKS_IN_METRES
from survey.io.text_tables.spellings import ColumnNames, metres_factor, one_column, say_columns

# No coordinate, covariance or temperature is larger; what is comes of flipped bits.
_LARGEST = 1e15
_SIGMA = "sigma_z_m"
# Heights beside those of 0 that show these for missing ones, and the least distance between both [m].
_N_OTHERS, _LEAST_GAP_M = 5, 20.0
_TEXT_TABLES = (".csv", ".txt", ".tsv", ".xyz")
TABLES = (*_TEXT_TABLES, *VECTOR_ENDINGS)
"""Endings of files with one row for each point, whose columns can be chosen."""


def read_point_table(path: str | Path, columns: Mapping[str, str] | None = None) -> PointTable:
    """Read the format that the file's ending names.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    columns : mapping of str to str, optional
        Column of a table by own name, such as ``{"z_m": "Ellipsoidal height"}``; others are found by their names.

    Returns
    -------
    PointTable
        Columns of numbers, with CRS and vertical datum where the file names them.

    Raises
    ------
    InputError
        Another ending; a file that is missing, empty or damaged; a column that is missing
        or holds something that is no number or stands for a missing one; columns named for a file that is no table.
    """
    table = _read(Path(path), columns)
    for name, column in table.columns.items():
        if (np.abs(column) > _LARGEST).any():
            raise InputError(
                f"the point file {path} holds {np.abs(column).max():.3g} in {name}; it is damaged, get it again."
            )
    refuse_marks(table, path)
    return table


def _read(path: Path, columns: Mapping[str, str] | None) -> PointTable:
    """Read a table with the columns that were named, or a cloud with its own."""
    suffix = _ending(path, READ_ENDINGS)
    if suffix in _TEXT_TABLES:
        return read_csv(path, columns)
    if suffix in VECTOR_ENDINGS:
        return read_vector(path, columns)
    if columns:
        raise InputError(
            f"{path} is no table, whose columns can be chosen; leave the mapping of columns out, or export it as CSV."
        )
    return _with_usual_sigma(_CLOUDS[suffix](path), path)


def _with_usual_sigma(table: PointTable, path: Path) -> PointTable:
    """Give the standard deviation of heights its own name, where the file has a usual one."""
    name = one_column("sigma_z", list(table.columns), f"the point file {path}")
    if name is None or name == _SIGMA:
        return table
    columns = {key: column for key, column in table.columns.items() if key != name}
    say_columns(f"the point file {path}", ColumnNames({_SIGMA: name}))
    return table._replace(columns={**columns, _SIGMA: metres_factor(name) * table.columns[name]})


def refuse_marks(table: PointTable, path: str | Path) -> None:
    """Refuse numbers that stand for a missing one in a column of heights or of sampled values.

    Parameters
    ----------
    table : PointTable
        The points.
    path : str or pathlib.Path
        Their file, for the message.

    Raises
    ------
    InputError
        A number such as -9999 or -32768, a height of 9999 m, or heights of 0 far from all others.
    """
    _refuse_zeros(table.columns[PLACE[2]], path)
    _refuse_impossible(table.columns[PLACE[2]], path)
    for name, column in table.columns.items():
        marks = () if name in PLACE[:2] else MARKS + (MARKS_IN_METRES if name == PLACE[2] else ())
        found = next((mark for mark in marks if (column == mark).any()), None)
        if found is not None:
            raise InputError(
                f"the point file {path} holds {found:g} in {name}, first at point {int(np.argmax(column == found)) + 1}, which stands for a missing "
                "number; remove those rows."
            )


def _refuse_zeros(height_m: FloatArray, path: str | Path) -> None:
    """Refuse heights of exactly 0 that lie farther from the others than those lie apart."""
    is_zero = height_m == 0.0
    others = height_m[~is_zero & np.isfinite(height_m)]
    if not is_zero.any() or len(others) < max(_N_OTHERS, int(is_zero.sum())):
        return
    gap_m = float(np.abs(others).min())
    if gap_m > max(float(np.ptp(others)), _LEAST_GAP_M):
        raise InputError(
            f"the point file {path} holds heights of 0 in {int(is_zero.sum())} rows, first at point {int(np.argmax(is_zero)) + 1}, and all "
            f"others lie between {others.min():g} and {others.max():g} m; remove those rows, where 0 stands for a missing number."
        )


def _refuse_impossible(height_m: FloatArray, path: str | Path) -> None:
    """Refuse heights that are all beyond any ground on Earth, as eastings in the column of heights or millimetres are."""
    known = height_m[np.isfinite(height_m)]
    if known.size and (known.min() > HIGHEST_M or known.max() < LOWEST_M):
        raise InputError(
            f"the point file {path} holds heights between {known.min():g} and {known.max():g} m, beyond all ground on Earth; "
            "check which column holds the heights, and that they are in metres."
        )


def write_point_table(path: str | Path, table: PointTable) -> None:
    """Write the format that the file's ending names, or leave what was there; equal tables give equal bytes.

    CSV carries no CRS. LAS and LAZ round coordinates to 0.1 mm; the others are exact.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; its suffix names the format.
    table : PointTable
        The points; LAS, PLY and vector formats need a CRS.
    """
    WRITERS[_ending(path, WRITERS)](Path(path), table)


def _ending(path: str | Path, known: Collection[str]) -> str:
    """Return the ending of a file, which has to be one of those that are known."""
    suffix = Path(path).suffix.lower()
    if suffix not in known:
        raise InputError(
            f"{Path(path).name} ends in {suffix!r}; one of {', '.join(sorted(known))} was expected."
        )
    return suffix


def _read_las(path: Path) -> PointTable:
    from survey.io.points.las import read_las  # here: laspy imports a client of the web

    return read_las(path)


def _write_las(path: Path, table: PointTable) -> None:
    from survey.io.points.las import write_las

    write_las(path, table)


_CLOUDS: Mapping[str, Callable[[Path], PointTable]] = {
    ".las": _read_las,
    ".laz": _read_las,
    ".ply": read_ply,
}
WRITERS: Mapping[str, Callable[[Path, PointTable], None]] = {
    ".csv": write_csv,
    ".gpkg": write_vector,
    ".geojson": write_vector,
    ".las": _write_las,
    ".laz": _write_las,
    ".ply": write_ply,
}
"""Writer for each ending of a point file."""
READ_ENDINGS = (*TABLES, *_CLOUDS)
"""Endings of point files that are read."""
