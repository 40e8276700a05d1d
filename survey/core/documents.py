"""JSON documents, run manifests and run logs.

Documents are written atomically and refused when damaged. A manifest has a fixed shape and carries the SHA-256 of its
own content, of its inputs and of its files. A log has one JSON object a line, each with the SHA-256 of its own content;
a last line without a line break was cut off by a kill.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from survey.core.errors import InputError
from survey.core.files import existing_file, first_line, read_bytes, replacing

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


MANIFEST_VERSION = 2
RECORD = "made.json"
"""Name of the record of a folder's files, see `write_record`."""
_RECORD_SHA256 = "record_sha256"
_MANIFEST_SHA256 = "manifest_sha256"
_Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Shape(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)


class _StageShape(_Shape):
    wall_s: float | None
    files_sha256: dict[str, _Sha256]


class _ManifestShape(_Shape):
    manifest_version: Literal[2]
    manifest_sha256: _Sha256
    config_sha256: _Sha256
    inputs_sha256: dict[str, _Sha256]
    files_sha256: dict[str, _Sha256]
    stages: dict[str, _StageShape]


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits.

    Parameters
    ----------
    path : pathlib.Path
        A readable file.

    Returns
    -------
    str
        64 digits.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_sha256(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a JSON document, whatever the order of its keys and its white space.

    Parameters
    ----------
    content : mapping of str to Any
        What JSON can hold.

    Returns
    -------
    str
        64 hexadecimal digits.

    Examples
    --------
    >>> content_sha256({"a": 1, "b": 2}) == content_sha256({"b": 2, "a": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8", errors="surrogatepass")).hexdigest()


def with_checksum(content: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return a document with the checksum of all its other keys under `key`.

    Parameters
    ----------
    content : mapping of str to Any
        The document; an old checksum in it is replaced.
    key : str
        Name of the checksum's entry.

    Returns
    -------
    dict
        The document with its checksum last.
    """
    rest = {name: value for name, value in content.items() if name != key}
    return {**rest, key: content_sha256(rest)}


def is_intact(content: Mapping[str, Any], key: str) -> bool:
    """Return whether a document has the checksum that `with_checksum` put under `key`.

    Parameters
    ----------
    content : mapping of str to Any
        The document as it was read.
    key : str
        Name of the checksum's entry.

    Returns
    -------
    bool
        False when the checksum is missing or another one.
    """
    return content.get(key) == content_sha256({k: v for k, v in content.items() if k != key})


def write_manifest(path: Path, content: Mapping[str, Any]) -> None:
    """Write a manifest with its version and its checksum.

    Parameters
    ----------
    path : pathlib.Path
        Its file; replaced in one step.
    content : mapping of str to Any
        ``config_sha256``, ``inputs_sha256``, ``files_sha256``, ``stages`` and any facts.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    write_json(path, with_checksum({**content, "manifest_version": MANIFEST_VERSION}, _MANIFEST_SHA256))


def read_manifest(path: Path) -> dict[str, Any]:
    """Read a manifest and check its shape, its version and its checksum.

    Parameters
    ----------
    path : pathlib.Path
        Its file.

    Returns
    -------
    dict
        The content that `write_manifest` was given, with version and checksum.

    Raises
    ------
    InputError
        The file is missing, is no JSON, was changed, or was written by another version.
    """
    try:
        content = json.loads(path.read_bytes())
        version = content["manifest_version"] if isinstance(content, dict) else None
        if version == MANIFEST_VERSION:
            _ManifestShape.model_validate(content)
    except (OSError, ValueError, KeyError, RecursionError) as error:
        raise _damaged_document(path, _reason(error)) from error
    if version != MANIFEST_VERSION:
        raise InputError(
            f"the manifest {path} has the version {version!r}, and {MANIFEST_VERSION} was expected; "
            "run again with --fresh."
        )
    if not is_intact(content, _MANIFEST_SHA256):
        raise _damaged_document(path, "its content has another checksum than it states")
    return dict(content)


def write_record(folder: Path, files: Iterable[Path], facts: Mapping[str, Any]) -> None:
    """Write the checksums of files of a folder to ``made.json``.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    files : iterable of pathlib.Path
        Files in it, or in folders below it.
    facts : mapping of str to Any
        How they were made.

    Raises
    ------
    InputError
        When the record cannot be written.
    """
    checksums = {str(file.relative_to(folder)): file_sha256(file) for file in sorted(files)}
    write_json(folder / RECORD, with_checksum({**facts, "files_sha256": checksums}, _RECORD_SHA256))


def read_record(folder: Path) -> dict[str, Any]:
    """Read ``made.json`` and check the files that it lists.

    Parameters
    ----------
    folder : pathlib.Path
        The folder that `write_record` was given. Files beside those that are listed do not matter.

    Returns
    -------
    dict
        The facts, ``files_sha256`` and the record's own checksum.

    Raises
    ------
    InputError
        The record or a listed file is missing or was changed.
    """
    record = read_json(folder / RECORD, "the record of the folder")
    if not is_intact(record, _RECORD_SHA256):
        raise InputError(f"the record {folder / RECORD} was changed; make the folder {folder} again.")
    for name, digest in record["files_sha256"].items():
        if not (folder / name).is_file() or file_sha256(folder / name) != digest:
            raise InputError(f"{folder / name} is missing or was changed; make the folder {folder} again.")
    return record


def _reason(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    if isinstance(error, KeyError):
        return f"it has no {error.args[0]}"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    return str(error)


def _damaged_document(path: Path, reason: str) -> InputError:
    return InputError(f"the manifest {path} is damaged ({reason}); run again with --fresh.")


_LINE_SHA256 = "line_sha256"


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
    return json.dumps(with_checksum(entry, _LINE_SHA256), ensure_ascii=False)


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
        raise _damaged_line(file, len(lines) + 1)
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
        raise _damaged_line(file, number) from error
    if not (isinstance(entry, dict) and is_intact(entry, _LINE_SHA256)):
        raise _damaged_line(file, number)
    return entry


def _damaged_line(file: Path, number: int) -> InputError:
    return InputError(
        f"line {number} of the log {file} was changed or is not complete; remove the file to go on without it."
    )
