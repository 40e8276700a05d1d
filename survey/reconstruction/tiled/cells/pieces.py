"""Pieces of point files that are sorted together, and the keys of their strips."""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from survey.io.points.chunks import read_chunks

_PIECE_POINTS = 2_500_000
_FILE_BITS = 16
_CLASSES_FROM = 3_000_000


class Piece(NamedTuple):
    """Points of a file that are sorted together.

    Parameters
    ----------
    file : str
        Path of the file.
    number : int
        Number of the file among the sources.
    first, n : int
        First point and number of points.
    ground_class : int or None
        Class of the points to use; all but noise where None.
    """

    file: str
    number: int
    first: int
    n: int
    ground_class: int | None

    @property
    def name(self) -> str:
        """Name of the folder of its sorted points."""
        return f"f{self.number:05d}_p{self.first:012d}"


def pieces_of(file: Path, number: int, n_points: int, ground_class: int | None) -> list[Piece]:
    """Return the pieces of a file: equal parts of at most 2.5 million points.

    Examples
    --------
    >>> [piece.n for piece in pieces_of(Path("a.laz"), 0, 6_500_000, None)]
    [2166667, 2166667, 2166666]
    """
    n_parts = -(-n_points // _PIECE_POINTS)
    ends = [-(-k * n_points // n_parts) for k in range(n_parts + 1)]
    return [Piece(str(file), number, first, end - first, ground_class) for first, end in pairwise(ends)]


def holds_class(file: Path, n_points: int, wanted: int) -> bool:
    """Return whether a file holds points of a class among its first three million."""
    n = min(n_points, _CLASSES_FROM)
    return any((chunk.classes == wanted).any() for chunk in read_chunks(file, 0, n))


def strip_keys(strip: npt.NDArray[np.uint16], file_number: int) -> npt.NDArray[np.uint32]:
    """Return keys of strips: the flight line's number, or the file where a point states none.

    Parameters
    ----------
    strip : (N,) ndarray of uint16
        Number of the flight line; 0 for none.
    file_number : int
        Number of the file among the sources.

    Returns
    -------
    (N,) ndarray of uint32
        Equal keys for equal strips, over all files.
    """
    own = strip.astype(np.uint32)
    return np.where(own > 0, own, np.uint32((file_number + 1) << _FILE_BITS)).astype(np.uint32)


def strip_name(key: int) -> str:
    """Return the name of a strip: the number of its flight line, or that of its file counted from 1.

    Examples
    --------
    >>> strip_name(8705), strip_name(2 << 16)
    ('8705', 'file 2')
    """
    return str(key) if key < 1 << _FILE_BITS else f"file {key >> _FILE_BITS}"
