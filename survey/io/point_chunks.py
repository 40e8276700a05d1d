"""Out-of-core reading of point files: LAS, LAZ, COPC, PLY and Parquet in chunks of points.

Number of points, bounds and CRS come from the header; the points follow in chunks of a million, with the number of
their strip (point source) where the file has it. PLY is mapped into memory, and Parquet is read by row groups.
"""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core import UNSTATED, Bounds, FloatArray, InputError, existing_file, printable, refusing_damage
from survey.io.ply import read_vertices

_AXES = (("x_m", "y_m", "z_m"), ("x", "y", "z"), ("X", "Y", "Z"))
_STRIP = ("point_source_id", "PointSourceId", "strip")
_CRS_KEY = b"crs"


class ColumnChunk(NamedTuple):
    """Coordinates (N, 3) [m] of some points, and the numbers (N,) of their strips where the file has them."""

    xyz: FloatArray
    strip: npt.NDArray[np.uint16] | None


def ply_facts(file: Path) -> tuple[int, Bounds, Any]:
    """Return number, bounds [m] and stated CRS of the vertices of a PLY file."""
    vertices, comments = _mapped_ply(file)
    axes = _axes(vertices.dtype.names or (), file, logs=True)
    if len(vertices) == 0:
        raise InputError(f"the point file {file} holds no points; leave it out or get it again.")
    low, high = ([float(f(vertices[a])) for a in axes[:2]] for f in (np.min, np.max))
    crs = next((text.split(" ", 1)[1] for text in comments if text.startswith("crs ")), None)
    return len(vertices), (low[0], low[1], high[0], high[1]), crs


def ply_chunks(file: Path, first: int, n: int, at_once: int) -> Iterator[ColumnChunk]:
    """Yield the vertices of a PLY file in chunks; the file is mapped and not read as one."""
    vertices, _ = _mapped_ply(file)
    names = vertices.dtype.names or ()
    axes = _axes(names, file)
    strip = next((name for name in _STRIP if name in names), None)
    for start in range(first, min(first + n, len(vertices)), at_once):
        part = vertices[start : min(start + at_once, first + n)]
        xyz = np.column_stack([part[axis].astype(np.float64) for axis in axes])
        yield ColumnChunk(xyz, None if strip is None else part[strip].astype(np.uint16))


def _mapped_ply(file: Path) -> tuple[Any, list[str]]:
    with refusing_damage(f"the point file {file}", "PLY"):
        return read_vertices(file)


def parquet_facts(file: Path) -> tuple[int, Bounds, Any]:
    """Return number, bounds [m] and stated CRS of the rows of a Parquet file.

    The CRS stands in the file's metadata under ``crs``; bounds come from the statistics of the row groups.
    """
    with _parquet(file) as table:
        return _facts_of(table, file)


def _facts_of(table: Any, file: Path) -> tuple[int, Bounds, Any]:
    axes = _axes(table.schema_arrow.names, file, logs=True)
    spans = [_span(table, file, axis) for axis in axes[:2]]
    stated = (table.schema_arrow.metadata or {}).get(_CRS_KEY)
    bounds = (spans[0][0], spans[1][0], spans[0][1], spans[1][1])
    return table.metadata.num_rows, bounds, None if stated is None else stated.decode()


def parquet_chunks(file: Path, first: int, n: int, at_once: int) -> Iterator[ColumnChunk]:
    """Yield the rows of a Parquet file in chunks."""
    with _parquet(file) as table:
        yield from _rows_of(table, file, first, n, at_once)


def _rows_of(table: Any, file: Path, first: int, n: int, at_once: int) -> Iterator[ColumnChunk]:
    names = table.schema_arrow.names
    axes = _axes(names, file)
    strip = [name for name in _STRIP if name in names][:1]
    begin = 0
    for batch in table.iter_batches(at_once, columns=[*axes, *strip], use_threads=False):
        rows = slice(max(first - begin, 0), max(min(first + n - begin, len(batch)), 0))
        begin += len(batch)
        if rows.stop > rows.start:
            columns = [np.asarray(batch[name])[rows] for name in (*axes, *strip)]
            xyz = np.column_stack([column.astype(np.float64) for column in columns[:3]])
            yield ColumnChunk(xyz, columns[3].astype(np.uint16) if strip else None)
        if begin >= first + n:
            return


@contextmanager
def _parquet(file: Path) -> Iterator[Any]:
    """Open a Parquet file, and refuse a damaged one in one sentence."""
    from pyarrow import parquet

    with refusing_damage(f"the point file {file}", "Parquet"), parquet.ParquetFile(file) as table:
        yield table


def _span(table: Any, file: Path, axis: str) -> tuple[float, float]:
    """Return least and greatest value of a column, by the statistics of the row groups or by reading it."""
    index = table.metadata.schema.names.index(axis)
    groups = [table.metadata.row_group(k).column(index) for k in range(table.metadata.num_row_groups)]
    known = [g.statistics for g in groups if g.is_stats_set and g.statistics.has_min_max]
    if known and len(known) == len(groups):
        return float(min(s.min for s in known)), float(max(s.max for s in known))
    values = np.asarray(table.read([axis])[axis], dtype=np.float64)
    if len(values) == 0:
        raise InputError(f"the point file {file} holds no points; leave it out or get it again.")
    return float(values.min()), float(values.max())


def _axes(names: Any, file: Path, *, logs: bool = False) -> tuple[str, str, str]:
    """Return the columns of the coordinates; the log may state which others are not read."""
    found = next((axes for axes in _AXES if set(axes) <= set(names)), None)
    if found is None:
        raise InputError(
            f"the point file {file} has no columns x, y and z (found: {', '.join(map(str, names)) or 'none'}); rename them."
        )
    unused = [name for name in map(str, names) if name not in (*found, *_STRIP)]
    if logs and unused:
        logging.getLogger(__name__).warning("%s: not used: %s", file, printable(", ".join(unused)))
    return found


CHUNK_POINTS = 1_000_000
"""Points that are in memory at once."""
CHUNKED_SUFFIXES = (".las", ".laz", ".ply", ".parquet")
"""Endings of the files that are read in chunks; ``.copc.laz`` is one of LAZ."""


class PointFileFacts(NamedTuple):
    """Number of points of a file, their bounds as stored, and what the file states: CRS, vertical datum, units.

    `lengths`: metres in a unit of a column, where the file states it (`survey.io.point_table.PointTable`). `heights` (2,):
    lowest and highest, as stored, where the header states them.
    """

    n_points: int
    bounds: Bounds
    crs: Any
    vertical_datum: str = UNSTATED
    lengths: Mapping[str, float] = {}
    heights: tuple[float, float] | None = None


class PointChunk(NamedTuple):
    """Some points of a file.

    `xyz` (N, 3): easting, northing and elevation [m], in the file's CRS. `strip` (N,): number of the flight
    line (the point source of LAS); 0 where the file states none. `classes` (N,): classes of LAS with the codes of
    `survey.io.point_classes`; 0 where the file states none.
    """

    xyz: FloatArray
    strip: npt.NDArray[np.uint16]
    classes: npt.NDArray[np.uint16]


def chunked_files(sources: list[Path]) -> list[Path]:
    """Return the point files among paths, folders opened and sorted by name."""
    files: list[Path] = []
    for source in sources:
        if source.is_dir():
            files += sorted(f for f in source.iterdir() if f.suffix.lower() in CHUNKED_SUFFIXES)
        elif source.suffix.lower() in CHUNKED_SUFFIXES:
            files.append(existing_file(source, "the point file"))
        else:
            raise InputError(
                f"{source} cannot be read in chunks; a folder or one of {', '.join(CHUNKED_SUFFIXES)} was expected."
            )
    if not files:
        raise InputError(
            f"there is no point file in {', '.join(map(str, sources))}; {', '.join(CHUNKED_SUFFIXES)} are read."
        )
    return list(dict.fromkeys(files))


def point_file_facts(path: str | Path, crs: Any = None) -> PointFileFacts:
    """Return number, bounds and CRS (`crs` where none is stated) of the points of a file, mostly by its header."""
    file = existing_file(path, "the point file")
    if file.suffix.lower() == ".ply":
        facts = PointFileFacts(*ply_facts(file))
    elif file.suffix.lower() == ".parquet":
        facts = PointFileFacts(*parquet_facts(file))
    else:
        facts = _las_facts(file, crs)
    if facts.n_points == 0:
        raise InputError(f"the point file {file} holds no points; leave it out or get it again.")
    if not np.isfinite(facts.bounds).all():
        raise InputError(f"the point file {file} has bounds that are no numbers; get it again.")
    return facts


def read_chunks(
    path: str | Path, first: int, n: int, metres: tuple[float, float] = (1.0, 1.0)
) -> Iterator[PointChunk]:
    """Read points in chunks of at most `CHUNK_POINTS`.

    `metres`: in a unit of the places and of the heights of the file.
    """
    file = existing_file(path, "the point file")
    n_read = 0
    for chunk in _chunks(file, first, n):
        if not np.isfinite(chunk.xyz).all():
            raise InputError(
                f"the point file {file} holds coordinates that are NaN or infinite; remove those points."
            )
        n_read += len(chunk.xyz)
        yield (
            chunk
            if metres == (1.0, 1.0)
            else chunk._replace(xyz=chunk.xyz * [metres[0], metres[0], metres[1]])
        )
    if n_read != n:
        raise InputError(
            f"the point file {file} holds {n_read} points behind point {first}, and {n} were expected; it was cut off."
        )


def _chunks(file: Path, first: int, n: int) -> Iterator[PointChunk]:
    if file.suffix.lower() in (".las", ".laz"):
        yield from _las_chunks(file, first, n)
        return
    columns = ply_chunks if file.suffix.lower() == ".ply" else parquet_chunks
    for part in columns(file, first, n, CHUNK_POINTS):
        zero = np.zeros(len(part.xyz), np.uint16)
        strip = zero if part.strip is None else part.strip
        yield PointChunk(part.xyz, strip, np.zeros(len(part.xyz), np.uint16))


def _las_facts(file: Path, named: Any) -> PointFileFacts:
    # here: laspy imports a client of the web
    from survey.io.las import crs_of_header, datum_of_header, lengths_of_header, open_las

    with open_las(file) as reader:
        header = reader.header
        low, high = header.mins, header.maxs
        bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        crs = crs_of_header(header, file, named)
        stated = datum_of_header(header, crs), lengths_of_header(header, file)
        return PointFileFacts(header.point_count, bounds, crs, *stated, (float(low[2]), float(high[2])))


def _las_chunks(file: Path, first: int, n: int) -> Iterator[PointChunk]:
    import laspy

    from survey.io.las import classes_of, open_las

    wanted = (
        laspy.DecompressionSelection.FLAGS
        | laspy.DecompressionSelection.base()
        | laspy.DecompressionSelection.Z
    )
    wanted |= laspy.DecompressionSelection.CLASSIFICATION | laspy.DecompressionSelection.POINT_SOURCE_ID
    with open_las(file, decompression_selection=wanted) as reader:
        reader.seek(first)
        left = n
        while left > 0:
            points = reader.read_points(min(CHUNK_POINTS, left))
            if len(points) == 0:
                return
            left -= len(points)
            yield PointChunk(
                np.column_stack([np.asarray(axis, np.float64) for axis in (points.x, points.y, points.z)]),
                np.asarray(points.point_source_id, np.uint16),
                classes_of(points),
            )
