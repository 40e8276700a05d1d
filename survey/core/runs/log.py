"""Log of a run: lines of JSON, each with the checksum of its own content."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from survey.core.errors import InputError
from survey.core.files.reading import existing_file, read_bytes
from survey.core.runs.manifest import is_intact, with_checksum

_SELF = "line_sha256"


def log_line(entry: Mapping[str, Any]) -> str:
    """Return a log record as one line of JSON with its checksum, without the line's end.

    Parameters
    ----------
    entry : mapping of str to Any
        What JSON can hold.

    Returns
    -------
    str
        The line; `read_log` checks it.

    Examples
    --------
    >>> log_line({"level": "info"})[:36]
    '{"level": "info", "line_sha256": "fd'
    """
    return json.dumps(with_checksum(entry, _SELF), ensure_ascii=False)


def read_log(path: str | Path) -> list[dict[str, Any]]:
    """Read the log of a run and check every line.

    Parameters
    ----------
    path : str or pathlib.Path
        The file ``log.jsonl``.

    Returns
    -------
    list of dict
        The log records with their checksums; none of an empty file.

    Raises
    ------
    InputError
        The file is missing, or a line was changed or is not complete.
    """
    if Path(path).is_file() and not Path(path).stat().st_size:
        return []
    file = existing_file(path, "the log")
    *lines, rest = read_bytes(file, "the log").split(b"\n")
    if rest:
        raise _damaged(file, len(lines) + 1)
    return [_checked(line, file, number) for number, line in enumerate(lines, start=1)]


def cut_incomplete_line(path: Path) -> None:
    """Cut off the last line of a log where a killed process has not completed it.

    Parameters
    ----------
    path : pathlib.Path
        The log, existing or not.
    """
    if not path.exists():
        return
    with path.open("rb+") as file:
        file.truncate(file.read().rfind(b"\n") + 1)


def _checked(line: bytes, file: Path, number: int) -> dict[str, Any]:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise _damaged(file, number) from error
    if not (isinstance(entry, dict) and is_intact(entry, _SELF)):
        raise _damaged(file, number)
    return entry


def _damaged(file: Path, number: int) -> InputError:
    return InputError(
        f"line {number} of the log {file} was changed or is not complete; remove the file to go on without it."
    )
