"""Arrays and facts in one ``.npz`` file: what fitted models are kept in."""

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.errors import InputError
from survey.core.files import existing_file, replacing


def write_arrays(path: str | Path, kind: str, facts: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write arrays with JSON facts; equal content gives equal bytes.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    text = json.dumps({"format": kind, **facts}, sort_keys=True)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, allow_pickle=False, facts=np.frombuffer(text.encode("utf-8"), dtype=np.uint8), **arrays
    )
    with replacing(path) as draft:
        draft.write_bytes(buffer.getvalue())


def read_arrays(path: str | Path, kind: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the facts and arrays that `write_arrays` wrote.

    Raises
    ------
    InputError
        When the file is missing, damaged or holds something else.
    """
    file = existing_file(path, "the terrain model")
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        facts: dict[str, Any] = json.loads(arrays.pop("facts").tobytes().decode("utf-8"))
        found = facts.pop("format")
    except (OSError, ValueError, KeyError, AttributeError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{file} is damaged or no terrain model ({error}); save it again.") from error
    if found != kind:
        raise InputError(f"{file} has the format {found!r}; {kind!r} was expected.")
    return facts, arrays
