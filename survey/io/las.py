"""LAS and LAZ point files."""

import datetime
import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
import numpy.typing as npt
from pyproj.exceptions import CRSError

from survey.core.arrays import BoolArray
from survey.core.crs import UNSTATED, vertical_datum_of
from survey.core.errors import InputError
from survey.core.files import existing_file, replacing
from survey.io.arrays_file import checksum, refuse_altered
from survey.io.las_header import check_las_points, check_las_records
from survey.io.point_table import CRC, DATUM, PLACE, PointTable, add_column, check_count, damaged

GROUND, NOISE = 2, (7, 18)
"""Classes of LAS."""
# LAS stores coordinates as whole numbers of this many metres.
_LAS_STEP_M = 1e-4
_COARSE_STEP_M = 0.05
_LAS_OWNER, _LAS_DATUM, _LAS_CRC = "firnline", 1, 2
_LAS_FAULTS = (
    laspy.errors.LaspyException,
    lazrs.LazrsError,
    CRSError,
    ValueError,
    RuntimeError,
    struct.error,
    OSError,
    MemoryError,
    ArithmeticError,
    KeyError,
    IndexError,
    TypeError,
)


@contextmanager
def opened_las(file: Path, **options: Any) -> Iterator[Any]:
    """Open an existing LAS or LAZ file whose header has been checked, and refuse a damaged one in one sentence.

    Parameters
    ----------
    file : pathlib.Path
        The file.
    **options
        Of `laspy.open`.

    Yields
    ------
    laspy.LasReader
        Reads with one thread: the same work in the same order.

    Raises
    ------
    InputError
        The file is damaged or no LAS.
    """
    try:
        check_las_records(file)
        with laspy.open(file, laz_backend=laspy.LazBackend.Lazrs, **options) as reader:
            check_las_points(file, reader.header)
            yield reader
    except InputError:
        raise
    except _LAS_FAULTS as error:
        raise damaged(file, "LAS", error) from error
    except BaseException as error:
        # The decompressor's Rust panics derive from no Exception and have no name to import.
        if type(error).__name__ != "PanicException":
            raise
        raise damaged(file, "LAS", error) from error


def read_las(path: Path) -> PointTable:
    """Read a LAS or LAZ file, and check its checksum where firnline wrote it."""
    file = existing_file(path, "the point file")
    with opened_las(file) as reader:
        check_count(file, reader.header.point_count)
        las = reader.read()
        crs = las.header.parse_crs()
    if len(las.points) == 0:
        raise InputError(f"the point file {file} holds no points; get it again.")
    if len(las.points) != las.header.point_count:
        raise InputError(
            f"the point file {file} holds {len(las.points)} of {las.header.point_count} points; it was cut off."
        )
    columns = dict(
        zip(PLACE, (np.asarray(axis, dtype=np.float64) for axis in (las.x, las.y, las.z)), strict=True)
    )
    for name in las.point_format.extra_dimension_names:
        column = np.asarray(las[name])
        if column.ndim == 1:
            add_column(columns, name, column, file)
    _say_steps(las.header, file)
    datum = datum_of_header(las.header, crs)
    for record in las.header.vlrs:
        if record.user_id == _LAS_OWNER and record.record_id == _LAS_CRC:
            crc = record.record_data.decode("utf-8", "replace")
            refuse_altered(file, crc, columns.values(), f"its record {_LAS_OWNER} {_LAS_CRC}")
            return PointTable(columns, crs, datum)  # without classes
    return PointTable(columns, crs, datum, _is_ground(las))


def _say_steps(header: Any, file: Path) -> None:
    """Log the steps of heights that are stored as coarse numbers: a map would take them for exact."""
    step = float(header.scales[2])
    if step >= _COARSE_STEP_M:
        logging.getLogger(__name__).warning(
            "the point file %s stores heights in steps of %g, which rounds them by up to half of that; export it with finer scales.",
            file,
            step,
        )


def datum_of_header(header: Any, crs: Any) -> str:
    """Return the vertical datum that a header states: in its own record, or in its CRS."""
    for record in header.vlrs:
        if record.user_id == _LAS_OWNER and record.record_id == _LAS_DATUM:
            return str(record.record_data.decode("utf-8", "replace"))
    return UNSTATED if crs is None else vertical_datum_of(crs)


def _is_ground(las: Any) -> BoolArray | None:
    """Return which points are of the ground where it is classified, else which are no noise; None for all."""
    classes = classes_of(las)
    found: BoolArray = ~np.isin(classes, NOISE)
    if (classes == GROUND).any():
        found = classes == GROUND
    return None if found.all() else found


def classes_of(points: Any) -> npt.NDArray[np.uint8]:
    """Return the classes (N,) of points of laspy; withheld points count as noise.

    Parameters
    ----------
    points : laspy.LasData or laspy.ScaleAwarePointRecord
        Points with their flags.

    Returns
    -------
    (N,) ndarray of uint8
        As LAS numbers them.
    """
    classes: npt.NDArray[np.uint8] = np.array(points.classification, dtype=np.uint8)
    classes[np.asarray(points.withheld, dtype=np.bool_)] = NOISE[0]
    return classes


def write_las(path: Path, table: PointTable) -> None:
    """Write a LAS or LAZ file with a checksum."""
    xyz = np.column_stack([table.columns[name] for name in PLACE])
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets = np.floor(xyz.min(axis=0))
    header.scales = np.full(3, _LAS_STEP_M)
    header.generating_software = _LAS_OWNER
    # A fixed day, so that equal points give equal bytes.
    header.creation_date = datetime.date(2000, 1, 1)
    header.add_crs(table.crs)
    extra = {name: column for name, column in table.columns.items() if name not in PLACE}
    header.add_extra_dims([laspy.ExtraBytesParams(name=name, type=np.float64) for name in extra])
    if table.vertical_datum:
        header.vlrs.append(laspy.VLR(_LAS_OWNER, _LAS_DATUM, DATUM, table.vertical_datum.encode("utf-8")))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    for name, column in extra.items():
        las[name] = column
    stored = [*(np.asarray(axis, dtype=np.float64) for axis in (las.x, las.y, las.z)), *extra.values()]
    las.vlrs.append(laspy.VLR(_LAS_OWNER, _LAS_CRC, CRC, checksum(stored).encode("utf-8")))
    with replacing(path) as draft:
        las.write(str(draft))
