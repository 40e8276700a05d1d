"""Parts of long benchmarks, stored as they finish, and a digest of the code that made them."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def stored(file: Path, make: Callable[[], Any]) -> Any:
    """Return the facts of a part, computed where they are not stored yet."""
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        draft = file.with_suffix(".part")
        draft.write_text(json.dumps(make()), encoding="utf-8")
        draft.replace(file)
    return json.loads(file.read_text(encoding="utf-8"))


def code_digest(sources: Sequence[str], without: Sequence[str] = ()) -> str:
    """Return a digest of the files and of the folders' Python files, named from the root, without files of some names."""
    digest = hashlib.sha256()
    for source in sources:
        place = ROOT / source
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            if file.name not in without:
                digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
