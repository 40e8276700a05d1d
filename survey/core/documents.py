"""JSON documents, run manifests and run logs.

Documents are written atomically and refused when damaged. A
manifest has a fixed shape and carries the SHA-256 of its own content, of its inputs and of its files. A log has one JSON
object a line, each with the SHA-256 of its own content; a last line without a line break was cut off by a kill.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from survey.core.errors import InputError
from survey.core.files import existing_file, first_line, read_bytes, replacing
from survey.core.foreign import parse_json

LARGEST_BYTES = 256 * 2**20
"""Documents beyond this are not read: some 2 GB while they are parsed."""


def write_json(path: str | Path, content: Mapping[str, Any]) -> None:
    """Write a document in place of what stood there."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with replacing(path) as draft:
        # Names of files may hold bytes that are no UTF-8.
        draft.write_text(text, encoding="utf-8", errors="backslashreplace")


def read_json(path: str | Path, what: str) -> dict[str, Any]:
    """Read a document."""
    file = existing_file(path, what)
    content = parse_json(read_bytes(file, what, LARGEST_BYTES), f"{what} {file}", "make it again")
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
    """Return the SHA-256 of a file as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_sha256(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a JSON document, whatever the order of its keys and its white space.

    >>> content_sha256({"a": 1, "b": 2}) == content_sha256({"b": 2, "a": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8", errors="surrogatepass")).hexdigest()


def with_checksum(content: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return a document with the checksum of all its other keys under `key`."""
    rest = {name: value for name, value in content.items() if name != key}
    return {**rest, key: content_sha256(rest)}


def is_intact(content: Mapping[str, Any], key: str) -> bool:
    """Return whether a document has the checksum that `with_checksum` put under `key`."""
    return content.get(key) == content_sha256({k: v for k, v in content.items() if k != key})


def write_manifest(path: Path, content: Mapping[str, Any]) -> None:
    """Write a manifest with its version and its checksum."""
    write_json(path, with_checksum({**content, "manifest_version": MANIFEST_VERSION}, _MANIFEST_SHA256))


def read_manifest(path: Path) -> dict[str, Any]:
    """Read a manifest and check its shape, its version and its checksum."""
    try:
        content = parse_json(path.read_bytes(), "its text")
        version = content["manifest_version"] if isinstance(content, dict) else None
        if version == MANIFEST_VERSION:
            _ManifestShape.model_validate(content)
    except (OSError, ValueError, KeyError) as error:
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
    """Write the checksums of files of a folder to ``made.json``."""
    checksums = {str(file.relative_to(folder)): file_sha256(file) for file in sorted(files)}
    write_json(folder / RECORD, with_checksum({**facts, "files_sha256": checksums}, _RECORD_SHA256))


def read_record(folder: Path) -> dict[str, Any]:
    """Read ``made.json`` and check the files that it lists.

    Returns: the facts, ``files_sha256`` and the record's own checksum.
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
    return first_line(error.__cause__ or error)


def _damaged_document(path: Path, reason: str) -> InputError:
    return InputError(f"the manifest {path} is damaged ({reason}); run again with --fresh.")


_LINE_SHA256 = "line_sha256"


def log_line(entry: Mapping[str, Any]) -> str:
    """Return a log record as one line of JSON with its checksum, without the line's end.

    >>> log_line({"level": "info"})[:36]
    '{"level": "info", "line_sha256": "fd'
    """
    return json.dumps(with_checksum(entry, _LINE_SHA256), ensure_ascii=False)


def read_log(path: str | Path) -> list[dict[str, Any]]:
    """Read the log of a run and check every line.

    Returns: the log records with their checksums; none of an empty file.
    """
    if Path(path).is_file() and not Path(path).stat().st_size:
        return []
    file = existing_file(path, "the log")
    *lines, rest = read_bytes(file, "the log").split(b"\n")
    if rest:
        raise _damaged_line(file, len(lines) + 1)
    return [_checked(line, file, number) for number, line in enumerate(lines, start=1)]


def cut_incomplete_line(path: Path) -> None:
    """Cut off the last line of a log where a killed process has not completed it."""
    if not path.exists():
        return
    with path.open("rb+") as file:
        file.truncate(file.read().rfind(b"\n") + 1)


def _checked(line: bytes, file: Path, number: int) -> dict[str, Any]:
    try:
        entry = parse_json(line, "it")
    except InputError as error:
        raise _damaged_line(file, number) from error
    if not (isinstance(entry, dict) and is_intact(entry, _LINE_SHA256)):
        raise _damaged_line(file, number)
    return entry


def _damaged_line(file: Path, number: int) -> InputError:
    return InputError(
        f"line {number} of the log {file} was changed or is not complete; remove the file to go on without it."
    )
