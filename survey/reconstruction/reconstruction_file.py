"""Description file of a terrain map: its method, hyperparameters and diagnostics, with a checksum."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.core.runs.manifest import is_intact

FACTS_SHA256 = "facts_sha256"


def plain_facts(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return a copy of numbers, texts and lists as JSON has them."""
    try:
        text = json.dumps(dict(values), default=_number, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the {name} hold what JSON cannot ({error}); give numbers, texts and lists."
        ) from error
    result: dict[str, Any] = json.loads(text)
    return result


def _number(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__}")


def read_facts(path: Path) -> dict[str, Any]:
    """Read the description file, and refuse a damaged one."""
    file = existing_file(path, "the reconstruction's description")
    try:
        facts: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        missing = {"method", "quantity", "hyperparameters", "diagnostics"} - set(facts)
    except (ValueError, TypeError) as error:
        raise InputError(f"{file} is damaged ({error}); reconstruct again.") from error
    if missing:
        raise InputError(f"{file} lacks {', '.join(sorted(missing))}; reconstruct again.")
    if not is_intact(facts, FACTS_SHA256):
        raise InputError(f"{file} was changed, or was written by an older version; reconstruct again.")
    return facts
