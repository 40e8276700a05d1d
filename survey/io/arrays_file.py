"""NumPy ``.npz`` files with a checksum of their content, and CRC-32 checksums of arrays.

`write_npz` stores the CRC-32 of the names, types, shapes and values of the arrays; the reader compares it, and refuses
a file that claims more memory than it may take. `write_arrays` adds JSON facts and the version of the format. Other formats
(GeoTIFF, LAS, PLY, TUM) carry the same `checksum` of their values.
"""

import io
import json
import math
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from survey.core import (
    CapacityError,
    InputError,
    existing_file,
    first_line,
    parse_json,
    refusing_damage,
    write_bytes,
)

LARGEST_BYTES = 2**31
"""Largest arrays of one file: 2.1 GB in memory."""
_CRC = "crc32"


def write_npz(path: str | Path, arrays: Mapping[str, Any], *, compressed: bool = True) -> None:
    """Write arrays and the checksum of their names, types, shapes and values."""
    held = {name: np.asarray(values) for name, values in arrays.items()}
    held[_CRC] = np.frombuffer(_checksum(held).encode("ascii"), dtype=np.uint8)
    buffer = io.BytesIO()
    save = np.savez_compressed if compressed else np.savez
    save(buffer, allow_pickle=False, **held)
    write_bytes(path, buffer.getvalue())


def read_npz(path: str | Path, what: str, remedy: str) -> dict[str, Any]:
    """Read arrays that `write_npz` wrote, and check their checksum."""
    file = existing_file(path, what)
    arrays = load_npz(file, what, remedy)
    try:
        stated = arrays.pop(_CRC).tobytes().decode("ascii")
    except (KeyError, UnicodeError) as error:
        raise InputError(f"{file} is damaged or not {what} ({first_line(error)}); {remedy}.") from error
    found = _checksum(arrays)
    if stated != found:
        raise InputError(
            f"{file} is damaged: its arrays have the checksum {found} where it states {stated[:16]!r}; {remedy}."
        )
    return arrays


def load_npz(file: Path, what: str, remedy: str) -> dict[str, Any]:
    """Read the arrays of any ``.npz`` file; nothing is unpickled, and claims are checked before memory is taken."""
    with refusing_damage(str(file), what.removeprefix("the "), remedy):
        _check_claims(file, what)
        with np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}


def _check_claims(file: Path, what: str) -> None:
    """Refuse an archive whose arrays are larger than may be read, or than what is stored of them."""
    with zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        n_bytes = sum(member.file_size for member in members)
        if n_bytes > LARGEST_BYTES:
            raise CapacityError(
                f"{what} {file} holds {n_bytes:,} bytes of arrays; {LARGEST_BYTES:,} can be read, make a smaller one."
            )
        for member in members:
            with archive.open(member) as stream:
                claimed = _claimed_bytes(stream)
            if claimed > member.file_size:
                raise InputError(
                    f"{what} {file} is damaged: {member.filename[:80]!r} claims {claimed:,} bytes and holds {member.file_size:,}; get it again."
                )


def _claimed_bytes(stream: IO[bytes]) -> int:
    """Return the size that the header of an array states."""
    version = np.lib.format.read_magic(stream)
    read_header = (
        np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    )
    shape, _, dtype = read_header(stream)
    return math.prod(shape) * dtype.itemsize


def write_arrays(path: str | Path, kind: str, facts: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write arrays with JSON facts; equal content gives equal bytes."""
    text = json.dumps({"format": kind, **facts}, sort_keys=True)
    write_npz(path, {"facts": np.frombuffer(text.encode("utf-8"), dtype=np.uint8), **arrays})


def read_arrays(path: str | Path, kind: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the facts and arrays that `write_arrays` wrote."""
    arrays = read_npz(path, "the terrain model", "save it again")
    try:
        facts: dict[str, Any] = parse_json(arrays.pop("facts").tobytes(), "its text")
        found = facts.pop("format")
    except (ValueError, KeyError, AttributeError) as error:
        raise InputError(
            f"{path} is no terrain model ({first_line(error.__cause__ or error)}); save it again."
        ) from error
    if found != kind:
        raise InputError(f"{path} has the format {found!r}; {kind!r} was expected.")
    return facts, arrays


def _checksum(arrays: Mapping[str, Any]) -> str:
    """Return the checksum of arrays in the order of their names."""
    parts: list[Any] = []
    for name in sorted(arrays):
        parts += [f"{name} {arrays[name].dtype.str} {arrays[name].shape}\n", arrays[name]]
    return checksum(parts)


def checksum(parts: Iterable[Any]) -> str:
    """Return the CRC-32 of arrays and texts, one after the other, as eight hexadecimal digits.

    >>> checksum([np.zeros(3), "EGM96 height"])
    '1c43a30a'
    """
    crc = 0
    for part in parts:
        content = part.encode("utf-8") if isinstance(part, str) else np.ascontiguousarray(part).tobytes()
        crc = zlib.crc32(content, crc)
    return f"{crc:08x}"


def refuse_altered(path: Path, stated: str, parts: Iterable[Any], where: str) -> None:
    """Refuse values that are not those which the file's checksum was taken of."""
    found = checksum(parts)
    if stated != found:
        raise InputError(
            f"{path} is damaged: its values have the checksum {found} where {where} says {stated[:16]!r}; get it again "
            f"(or, if another tool changed its values on purpose, remove {where})."
        )
