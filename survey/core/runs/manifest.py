"""Run manifests: JSON documents of a fixed shape that carry a checksum of their own content."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from survey.core.documents import read_json, write_json
from survey.core.errors import InputError

MANIFEST_VERSION = 2
RECORD = "made.json"
"""Name of the record of a folder's files, see `write_record`."""
_RECORD_SHA256 = "record_sha256"
_SELF = "manifest_sha256"
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
    write_json(path, with_checksum({**content, "manifest_version": MANIFEST_VERSION}, _SELF))


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
        raise _damaged(path, _reason(error)) from error
    if version != MANIFEST_VERSION:
        raise InputError(
            f"the manifest {path} has the version {version!r}, and {MANIFEST_VERSION} was expected; "
            "run again with --fresh."
        )
    if not is_intact(content, _SELF):
        raise _damaged(path, "its content has another checksum than it states")
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


def _damaged(path: Path, reason: str) -> InputError:
    return InputError(f"the manifest {path} is damaged ({reason}); run again with --fresh.")
