"""JSON documents: whole or not there, and named when damaged."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from survey.core.errors import InputError
from survey.core.files import existing_file, replacing


def write_json(path: str | Path, content: Mapping[str, Any]) -> None:
    """Write a document with units in its keys; NaN is refused, unknown is null."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def read_json(path: str | Path, what: str) -> dict[str, Any]:
    """Read a document.

    Raises
    ------
    InputError
        Missing, empty or damaged.
    """
    file = existing_file(path, what)
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{what} {file} is damaged ({error}); make it again.") from error
    if not isinstance(content, dict):
        raise InputError(f"{what} {file} holds a {type(content).__name__}; an object was expected.")
    return content
