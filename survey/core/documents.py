"""JSON documents: written atomically, refused when damaged."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from survey.core.errors import InputError
from survey.core.files.library_messages import first_line
from survey.core.files.reading import existing_file, read_bytes
from survey.core.files.writing import replacing

LARGEST_BYTES = 256 * 2**20
"""Documents beyond this are not read: some 2 GB while they are parsed."""


def write_json(path: str | Path, content: Mapping[str, Any]) -> None:
    """Write a document in place of what stood there.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; its folder must exist.
    content : mapping
        Units stand in the keys. Unknown numbers are ``None``: NaN and infinity are refused.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with replacing(path) as draft:
        # Names of files may hold bytes that are no UTF-8.
        draft.write_text(text, encoding="utf-8", errors="backslashreplace")


def read_json(path: str | Path, what: str) -> dict[str, Any]:
    """Read a document.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    what : str
        What it is, for the message: "the manifest".

    Returns
    -------
    dict
        The document's outermost object.

    Raises
    ------
    InputError
        The file is missing, empty, damaged, nested too deep, or holds no object.
    CapacityError
        It is larger than `LARGEST_BYTES`.
    """
    file = existing_file(path, what)
    try:
        content = json.loads(read_bytes(file, what, LARGEST_BYTES).decode("utf-8"))
    except RecursionError as error:
        raise InputError(f"{what} {file} is nested too deep; make it again.") from error
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{what} {file} is damaged ({first_line(error)}); make it again.") from error
    if not isinstance(content, dict):
        raise InputError(f"{what} {file} holds a {type(content).__name__}; an object was expected.")
    return content
