"""PLY files: vertices as rows of numbers, in ASCII and in both binary orders.

The lines of the header name the format, the elements with their numbers of rows, and the properties of each row: a number
of one type, or a list, which begins with its length (G. Turk, "The PLY Polygon File Format", 1994). `read_vertices` returns
the properties of the vertices that are single numbers; lists are passed over. Rows without lists are mapped into memory
and not read at once. The rows of all elements are counted, so that a file that was cut off is refused wherever it ends.
"""

import io
import re
import warnings
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TextIO

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[np.void]

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8",
}  # fmt: skip
# The other names of the types: with their sizes, as NumPy writes them out (int8) and abbreviates them (i1).
_KINDS = {
    **_TYPES,
    **{np.dtype(kind).name: kind for kind in _TYPES.values()},
    **{k: k for k in _TYPES.values()},
}
_TYPE_NAMES = {np.dtype(kind): name for name, kind in _TYPES.items()}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_VERSION = "1.0"
_HEAD_BYTES, _LONGEST_HEAD_BYTES = 2**16, 2**24
# Rows of text that are converted at once, and rows with lists that are compared at once.
_TEXT_ROWS, _LIST_ROWS = 2**16, 2**16


class PlyError(ValueError):
    """A file that is no complete PLY; the text says where it ends or departs from the format."""


class Property(NamedTuple):
    """Name and NumPy type of a property, and the type of its length where it is a list."""

    name: str
    kind: str
    length_kind: str | None = None


class Element(NamedTuple):
    """Name, number of rows and properties of an element."""

    name: str
    n_rows: int
    properties: list[Property]

    def scalars(self) -> list[Property]:
        """Return the properties that are single numbers."""
        return [prop for prop in self.properties if prop.length_kind is None]

    def at(self, row: int, prop: Property | None = None) -> str:
        """Return the place of a fault, as the beginning of a sentence."""
        return f"element {self.name!r}: row {row}: " + (f"property {prop.name!r}: " if prop else "")


class PlyHeader(NamedTuple):
    """Header of a file: byte order (empty for ASCII), elements, comments before the first element, and its length."""

    order: str
    elements: list[Element]
    comments: list[str]
    n_bytes: int


def read_vertices(file: Path) -> tuple[Rows, list[str]]:
    """Read the single numbers of the vertices (N,), and the comments before the first element.

    Where the file is binary and vertices have no lists, the rows are mapped into memory.
    """
    header = read_header(file)
    if all(element.name != "vertex" for element in header.elements):
        raise PlyError("it has no element 'vertex'")
    if header.order:
        rows = _binary_rows(file, header)
    else:
        with file.open("rb") as stream:
            stream.seek(header.n_bytes)
            with io.TextIOWrapper(stream, "ascii", "replace") as text:
                rows = _text_rows(text, header, file.stat().st_size)
    return rows, header.comments


def read_header(file: Path) -> PlyHeader:
    """Read the header; `PlyError` where it departs from the format."""
    with file.open("rb") as stream:
        lines, n_bytes = _header_lines(stream)
    comments: list[str] = []
    elements: list[Element] = []
    order = _ORDERS[_format(lines)]
    for number, line in enumerate(lines[2:], start=3):
        keyword, _, rest = line.partition(" ")
        if keyword == "element":
            elements.append(_element(rest.split(), number))
        elif keyword == "property" and elements:
            elements[-1].properties.append(_property(rest.split(), number))
        elif keyword == "comment" and not elements:
            comments.append(rest)
        elif keyword not in ("comment", "obj_info"):
            raise PlyError(f"line {number}: expected one of element, property, comment, obj_info, end_header")
    _refuse_repeated([element.name for element in elements], "elements")
    for element in elements:
        _refuse_repeated([prop.name for prop in element.properties], "properties")
    return PlyHeader(order, elements, comments, n_bytes)


def _header_lines(stream: BinaryIO) -> tuple[list[str], int]:
    """Return the lines before ``end_header``, and the number of bytes with it; the first line shows how lines end."""
    head = stream.read(_HEAD_BYTES)
    first = re.match(rb"ply(\r\n|\n|\r)", head)
    if first is None:
        raise PlyError("line 1: expected 'ply'")
    last = re.compile(first[1] + rb"end_header[ \t]*" + first[1])
    while (end := last.search(head)) is None:
        more = stream.read(_HEAD_BYTES) if len(head) < _LONGEST_HEAD_BYTES else b""
        if not more:
            raise PlyError(f"line {head.count(first[1]) + 1}: early end-of-file")
        head += more
    try:
        lines = head[: end.start()].decode("ascii").split(first[1].decode())
    except UnicodeDecodeError as error:
        raise PlyError(str(error)) from error
    return [line.rstrip() for line in lines], end.end()


def _format(lines: Sequence[str]) -> str:
    """Return the format that the second line names."""
    words = lines[1].split() if len(lines) > 1 else []
    if len(words) != 3 or words[0] != "format":
        raise PlyError('line 2: expected "format {format} 1.0"')
    if words[1] not in _ORDERS:
        raise PlyError(f"line 2: don't understand format {words[1]!r}")
    if words[2] != _VERSION:
        raise PlyError(f"line 2: expected version {_VERSION!r}")
    return words[1]


def _element(words: list[str], line: int) -> Element:
    if len(words) != 2:
        raise PlyError(f'line {line}: expected "element {{name}} {{count}}"')
    if not words[1].isdigit():
        raise PlyError(f"line {line}: expected integer count")
    return Element(words[0], int(words[1]), [])


def _property(words: list[str], line: int) -> Property:
    is_list = words[:1] == ["list"]
    kinds = words[1:-1] if is_list else words[:-1]
    if len(kinds) != (2 if is_list else 1):
        raise PlyError(f'line {line}: expected "property [list {{len_type}}] {{type}} {{name}}"')
    unknown = [kind for kind in kinds if kind not in _KINDS]
    if unknown:
        raise PlyError(f"line {line}: field type {unknown[0]!r} not in {list(_KINDS)}")
    return Property(words[-1], _KINDS[kinds[-1]], _KINDS[kinds[0]] if is_list else None)


def _refuse_repeated(names: list[str], what: str) -> None:
    if len(set(names)) < len(names):
        raise PlyError(f"two {what} with same name")


def _dtype(element: Element, order: str = "") -> np.dtype[np.void]:
    """Return the type of a row's single numbers, in memory without gaps."""
    return np.dtype([(prop.name, order + prop.kind) for prop in element.scalars()])


def _binary_rows(file: Path, header: PlyHeader) -> Rows:
    """Return the rows of the vertices of a binary file, and check that the other elements are complete."""
    place = header.n_bytes
    content = np.memmap(file, np.uint8, "r")
    for element in header.elements:
        if len(element.scalars()) == len(element.properties):
            rows, n_bytes = _fixed_rows(content[place:], element, header.order)
        else:
            rows, n_bytes = _list_rows(content[place:], element, header.order)
        place += n_bytes
        if element.name == "vertex":
            vertices = rows
    return vertices


def _fixed_rows(content: npt.NDArray[np.uint8], element: Element, order: str) -> tuple[Rows, int]:
    """Return the rows of an element without lists, as a view of the file, and their bytes."""
    kind = _dtype(element, order)
    n_bytes = element.n_rows * kind.itemsize
    if n_bytes > len(content):
        raise PlyError(f"{element.at(len(content) // kind.itemsize)}early end-of-file")
    if n_bytes == 0:
        return np.zeros(element.n_rows, kind), 0
    return content[:n_bytes].view(kind), n_bytes


def _list_rows(content: npt.NDArray[np.uint8], element: Element, order: str) -> tuple[Rows, int]:
    """Return the single numbers of an element with lists, and the bytes of its rows.

    The length of a row is only known from its lists. Rows whose lists are as long as those of the row before, such as
    the triangles of a mesh, are taken together.
    """
    parts: list[Rows] = [np.zeros(0, _dtype(element, order))]
    place, n_read, at_once = 0, 0, 1
    while n_read < element.n_rows:
        kind, lengths = _row_kind(content[place:], element, order, n_read)
        n = min(at_once, element.n_rows - n_read, (len(content) - place) // kind.itemsize)
        rows = content[place : place + n * kind.itemsize].view(kind)
        is_alike = np.logical_and.reduce([rows[name] == length for name, length in lengths.items()])
        n_alike = n if is_alike.all() else int(is_alike.argmin())
        alike = np.empty(n_alike, parts[0].dtype)
        for prop in element.scalars():
            alike[prop.name] = rows[prop.name][:n_alike]
        parts.append(alike)
        place, n_read = place + n_alike * kind.itemsize, n_read + n_alike
        at_once = min(2 * at_once, _LIST_ROWS) if n_alike == n else 1
    return np.concatenate(parts), place


def _row_kind(
    content: npt.NDArray[np.uint8], element: Element, order: str, row: int
) -> tuple[np.dtype[np.void], dict[str, int]]:
    """Return the type of the next row, and the lengths of its lists by the names that the type gives them."""
    fields: list[tuple[Any, ...]] = []
    lengths: dict[str, int] = {}
    place = 0
    for prop in element.properties:
        length = 1
        if prop.length_kind is not None:
            kind = np.dtype(order + prop.length_kind)
            stated = content[place : place + kind.itemsize]
            if len(stated) < kind.itemsize:
                raise PlyError(f"{element.at(row, prop)}early end-of-file")
            # A name of a property has no blank, so that these are no names of others.
            name, length = f"length {prop.name}", int(stated.view(kind)[0])
            fields.append((name, kind))
            lengths[name] = length
            place += kind.itemsize
        n_bytes = length * np.dtype(prop.kind).itemsize
        if not 0 <= n_bytes <= len(content) - place:
            raise PlyError(f"{element.at(row, prop)}early end-of-file")
        shape = () if prop.length_kind is None else ((length,),)
        fields.append((prop.name, order + prop.kind, *shape))
        place += n_bytes
    return np.dtype(fields), lengths


def _text_rows(stream: TextIO, header: PlyHeader, n_bytes: int) -> Rows:
    """Return the rows of the vertices of an ASCII file, one in a line, and check that the other elements are complete."""
    for element in header.elements:
        # A line holds a digit and an end for each property: memory is taken for rows that the file has room for.
        most = n_bytes // (2 * max(len(element.properties), 1)) + 1
        rows = np.empty(min(element.n_rows, most), _dtype(element))
        for first in range(0, element.n_rows, _TEXT_ROWS):
            n_due = min(_TEXT_ROWS, element.n_rows - first)
            lines = list(islice(stream, n_due))
            part = _converted(lines, element, first)
            rows[first : first + len(lines)] = part
            if len(lines) < n_due:
                raise PlyError(f"{element.at(first + len(lines))}early end-of-file")
        if element.name == "vertex":
            vertices = rows
    return vertices


def _converted(lines: list[str], element: Element, first: int) -> Rows:
    """Return the rows (n,) of lines; line by line where a row has lists or not all lines have the form of a row."""
    kind = _dtype(element)
    if lines and len(element.scalars()) == len(element.properties) > 0:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # NumPy only warns of 1.0 where a whole number is due
                rows: Rows = np.loadtxt(lines, kind, comments=None, ndmin=1)
            if len(rows) == len(lines):
                return rows
        except (ValueError, Warning):
            pass
    return np.array([_text_row(line.split(), element, k) for k, line in enumerate(lines, start=first)], kind)


def _text_row(words: list[str], element: Element, row: int) -> tuple[Any, ...]:
    """Return the single numbers of a row."""
    rest, found = iter(words), []
    for prop in element.properties:
        if prop.length_kind is None:
            found.append(_number(rest, prop.kind, element.at(row, prop)))
            continue
        for _ in range(int(_number(rest, prop.length_kind, element.at(row, prop)))):
            _number(rest, prop.kind, element.at(row, prop))
    if next(rest, None) is not None:
        raise PlyError(f"{element.at(row)}expected end-of-line")
    return tuple(found)


def _number(words: Iterator[str], kind: str, where: str) -> Any:
    word = next(words, None)
    if word is None:
        raise PlyError(f"{where}early end-of-line")
    try:
        return np.dtype(kind).type(word)
    except (ValueError, OverflowError) as error:
        raise PlyError(f"{where}malformed input") from error


def write_vertices(file: Path, vertices: Rows, comments: Sequence[str]) -> None:
    """Write vertices (N,) as binary little-endian rows of one element; `PlyError` for texts that no header can hold."""
    names = vertices.dtype.names or ()
    unfit = next((name for name in names if not name.isascii() or name.split() != [name]), None)
    if unfit is not None:
        raise PlyError(f"the name {unfit!r} is not of ASCII letters without blanks")
    if not all(comment.isascii() and len(comment.splitlines()) <= 1 for comment in comments):
        raise PlyError("a comment is not one line of ASCII letters")
    kinds = [_TYPE_NAMES[vertices.dtype[name].newbyteorder("=")] for name in names]
    lines = [
        "ply",
        f"format binary_little_endian {_VERSION}",
        *(f"comment {comment}" for comment in comments),
        f"element vertex {len(vertices)}",
        *(f"property {kind} {name}" for kind, name in zip(kinds, names, strict=True)),
        "end_header",
    ]
    rows = vertices.astype(vertices.dtype.newbyteorder("<"), copy=False)
    with file.open("wb") as stream:
        stream.write("".join(f"{line}\n" for line in lines).encode("ascii"))
        stream.write(rows.tobytes())
