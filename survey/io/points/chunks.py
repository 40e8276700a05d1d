"""Out-of-core reading of point files: LAS, LAZ, COPC, PLY and Parquet in chunks of points."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core.arrays import Bounds, FloatArray
from survey.core.crs.vertical_datum import UNSTATED
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.io.points.columnar import parquet_chunks, parquet_facts, ply_chunks, ply_facts

CHUNK_POINTS = 1_000_000
"""Points that are in memory at once."""
CHUNKED_SUFFIXES = (".las", ".laz", ".ply", ".parquet")
"""Endings of the files that are read in chunks; ``.copc.laz`` is one of LAZ."""


class PointFileFacts(NamedTuple):
    """Number of points of a file, their bounds [m], and the CRS and vertical datum that the file states, if any."""

    n_points: int
    bounds: Bounds
    crs: Any
    vertical_datum: str = UNSTATED


class PointChunk(NamedTuple):
    """Some points of a file.

    Parameters
    ----------
    xyz : (N, 3) ndarray
        Easting, northing and elevation [m], in the file's CRS.
    strip : (N,) ndarray of uint16
        Number of the flight line (the point source of LAS); 0 where the file states none.
    classes : (N,) ndarray of uint8
        Classes of LAS, withheld points as noise; 0 where the file states none.
    """

    xyz: FloatArray
    strip: npt.NDArray[np.uint16]
    classes: npt.NDArray[np.uint8]


def chunked_files(sources: list[Path]) -> list[Path]:
    """Return the point files among paths, folders opened and sorted by name.

    Parameters
    ----------
    sources : list of pathlib.Path
        Files and folders.

    Returns
    -------
    list of pathlib.Path
        Files whose endings are in `CHUNKED_SUFFIXES`, each once.

    Raises
    ------
    InputError
        A path that does not exist, another ending, or no file at all.
    """
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


def point_file_facts(path: str | Path) -> PointFileFacts:
    """Return number, bounds and CRS of the points of a file; LAS and Parquet state them in the header.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose ending is in `CHUNKED_SUFFIXES`.

    Returns
    -------
    PointFileFacts
        Number of points, bounds and CRS.

    Raises
    ------
    InputError
        The file is missing, empty, damaged, or lacks coordinates.
    """
    file = existing_file(path, "the point file")
    if file.suffix.lower() == ".ply":
        facts = PointFileFacts(*ply_facts(file))
    elif file.suffix.lower() == ".parquet":
        facts = PointFileFacts(*parquet_facts(file))
    else:
        facts = _las_facts(file)
    if facts.n_points == 0:
        raise InputError(f"the point file {file} holds no points; leave it out or get it again.")
    if not np.isfinite(facts.bounds).all():
        raise InputError(f"the point file {file} has bounds that are no numbers; get it again.")
    return facts


def read_chunks(path: str | Path, first: int, n: int) -> Iterator[PointChunk]:
    """Read points in chunks of at most `CHUNK_POINTS`.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose ending is in `CHUNKED_SUFFIXES`.
    first : int
        Number of the first point, counted from 0.
    n : int
        Number of points to read.

    Yields
    ------
    PointChunk
        Points in the order of the file.

    Raises
    ------
    InputError
        The file is damaged, cut off, or holds coordinates that are no numbers.
    """
    file = existing_file(path, "the point file")
    n_read = 0
    for chunk in _chunks(file, first, n):
        if not np.isfinite(chunk.xyz).all():
            raise InputError(
                f"the point file {file} holds coordinates that are NaN or infinite; remove those points."
            )
        n_read += len(chunk.xyz)
        yield chunk
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
        yield PointChunk(part.xyz, strip, np.zeros(len(part.xyz), np.uint8))


def _las_facts(file: Path) -> PointFileFacts:
    from survey.io.points.las import datum_of_header, opened_las  # here: laspy imports a client of the web

    with opened_las(file) as reader:
        header = reader.header
        low, high = header.mins, header.maxs
        bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        crs = header.parse_crs()
        return PointFileFacts(header.point_count, bounds, crs, datum_of_header(header, crs))


def _las_chunks(file: Path, first: int, n: int) -> Iterator[PointChunk]:
    import laspy

    from survey.io.points.las import classes_of, opened_las

    wanted = (
        laspy.DecompressionSelection.FLAGS
        | laspy.DecompressionSelection.base()
        | laspy.DecompressionSelection.Z
    )
    wanted |= laspy.DecompressionSelection.CLASSIFICATION | laspy.DecompressionSelection.POINT_SOURCE_ID
    with opened_las(file, decompression_selection=wanted) as reader:
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
