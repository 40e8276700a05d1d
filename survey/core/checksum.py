"""Checksums (CRC-32) that files carry of their own values, and their verification."""

import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.errors import InputError


def checksum(parts: Iterable[Any]) -> str:
    """Return the CRC-32 of arrays and texts, one after the other, as eight hexadecimal digits.

    Parameters
    ----------
    parts : iterable of array_like or str
        What the checksum is taken of, in order.

    Returns
    -------
    str
        Eight hexadecimal digits.

    Examples
    --------
    >>> checksum([np.zeros(3), "EGM96 height"])
    '1c43a30a'
    """
    crc = 0
    for part in parts:
        content = part.encode("utf-8") if isinstance(part, str) else np.ascontiguousarray(part).tobytes()
        crc = zlib.crc32(content, crc)
    return f"{crc:08x}"


def refuse_altered(path: Path, stated: str, parts: Iterable[Any], where: str) -> None:
    """Refuse values that are not those which the file's checksum was taken of.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    stated : str
        The checksum that it states.
    parts : iterable of array_like or str
        What was read from it.
    where : str
        Where the checksum stands in the file, for the message.

    Raises
    ------
    InputError
        The values have another checksum; the message names the place of the stated one.
    """
    found = checksum(parts)
    if stated != found:
        raise InputError(
            f"{path} is damaged: its values have the checksum {found} where {where} says {stated[:16]!r}; get it again "
            f"(or, if another tool changed its values on purpose, remove {where})."
        )
