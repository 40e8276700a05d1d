"""PLY point files."""

import logging
from pathlib import Path

import numpy as np
import numpy.typing as npt
import plyfile
from pyproj import CRS

from survey.core.checksum import checksum, refuse_altered
from survey.core.crs.checks import crs_text
from survey.core.crs.vertical_datum import UNSTATED
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing
from survey.io.las_header import check_claim
from survey.io.point_columns import PLACE
from survey.io.points.table import CRC, DATUM, PointTable, add_column, check_count, damaged

_PLY_HEAD = 65_536
_COARSE_M = 0.01


def read_ply(path: Path) -> PointTable:
    """Read a PLY file, and check its checksum where firnline wrote it."""
    file = existing_file(path, "the point file")
    _check_ply_claim(file)
    try:
        ply = plyfile.PlyData.read(str(file))
        vertices = ply["vertex"].data
    except (
        plyfile.PlyParseError,
        KeyError,
        ValueError,
        MemoryError,
        OverflowError,
        TypeError,
        IndexError,
    ) as error:
        raise damaged(file, "PLY", error) from error
    missing = {"x", "y", "z"} - set(vertices.dtype.names)
    if missing:
        raise InputError(
            f"the point file {file} has vertices without {', '.join(sorted(missing))}; get it again."
        )
    columns = dict(zip(PLACE, (vertices[axis].astype(np.float64) for axis in "xyz"), strict=True))
    _say_rounded(file, vertices)
    for name in vertices.dtype.names:
        if name not in "xyz" and np.issubdtype(vertices.dtype[name], np.number):
            add_column(columns, name, vertices[name], file)
    stated = dict(comment.split(" ", 1) for comment in ply.comments if " " in comment)
    if CRC in stated:
        refuse_altered(file, stated[CRC], [vertices], f"its comment {CRC}")
    return PointTable(columns, stated.get("crs"), stated.get(DATUM, UNSTATED))


def write_ply(path: Path, table: PointTable) -> None:
    """Write a binary PLY file with a checksum."""
    names = {**dict(zip(PLACE, "xyz", strict=True))}
    fields = [(names.get(name, name), "<f8") for name in table.columns]
    vertices = np.empty(len(table.columns["x_m"]), dtype=fields)
    for name, column in table.columns.items():
        vertices[names.get(name, name)] = column
    crs: CRS = table.crs
    comments = [f"crs {crs_text(crs)}", f"{CRC} {checksum([vertices])}"]
    if table.vertical_datum:
        comments.append(f"{DATUM} {table.vertical_datum}")
    element = plyfile.PlyElement.describe(vertices, "vertex")
    with replacing(path) as draft:
        plyfile.PlyData([element], text=False, byte_order="<", comments=comments).write(str(draft))


def _say_rounded(file: Path, vertices: npt.NDArray[np.void]) -> None:
    """Log how far coordinates are rounded, where numbers of 32 bits are too short for them."""
    axes = [vertices[axis] for axis in "xyz" if vertices.dtype[axis] == np.float32]
    step_m = max((float(np.spacing(np.abs(axis).max(initial=0.0))) for axis in axes), default=0.0)
    if step_m > _COARSE_M:
        logging.getLogger(__name__).warning(
            "the point file %s stores coordinates in 32 bits, which rounds them to %.3g m; export it with properties of the "
            "type double.",
            file,
            step_m,
        )


def _check_ply_claim(file: Path) -> None:
    """Refuse a header of more rows than the file has bytes."""
    with file.open("rb") as stream:
        head = stream.read(_PLY_HEAD).split(b"end_header")[0]
    for line in head.splitlines():
        words = line.split()
        if words[:1] == [b"element"] and len(words) == 3 and words[2].isdigit():
            check_claim(file, int(words[2]), 1)
            check_count(file, int(words[2]))
