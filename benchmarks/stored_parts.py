"""Parts of long benchmarks, stored as they finish, and a digest of the code that made them."""

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.report import Row
from benchmarks.writer import current_run
from papers.provenance import used_cpu_s

ROOT = Path(__file__).parents[1]
_PRODUCT = ("survey", "planners", "vision_slam", "sim")


def stored(file: Path, make: Callable[[], Any]) -> Any:
    """Return the facts of a part, computed where they are not stored yet; its code and CPU time are stored beside it."""
    run, beside = current_run(), file.with_suffix(".provenance")
    is_earlier = file.exists()
    if not is_earlier:
        file.parent.mkdir(parents=True, exist_ok=True)
        draft = file.with_suffix(".part")
        began_s = used_cpu_s()
        draft.write_text(json.dumps(make()), encoding="utf-8")
        if run is not None:
            made = {"code": run.began.state.code, "cpu_s": round(used_cpu_s() - began_s, 1)}
            beside.write_text(json.dumps(made), encoding="utf-8")
        draft.replace(file)
    if run is not None:
        facts = json.loads(beside.read_text(encoding="utf-8")) if beside.exists() else {}
        run.part(file, facts, is_earlier=is_earlier)
    return json.loads(file.read_text(encoding="utf-8"))


def stored_rows(file: Path, make: Callable[[], Iterable[Row]]) -> list[Row]:
    """Return the rows of a part, computed where they are not stored yet."""
    return [Row(**row) for row in stored(file, lambda: [asdict(row) for row in make()])]


def parts_folder(name: str, *sources: str) -> Path:
    """Return the folder of a benchmark's parts, another one for other code of the localization or of the sources."""
    return Path(tempfile.gettempdir()) / f"firnline-{name}" / code_digest(("vision_slam", *sources))


def simulated_folder(name: str) -> Path:
    """Return the folder of drives and missions that benchmarks simulate once, another one for other code or example missions."""
    missions = [str(file.relative_to(ROOT)) for file in sorted((ROOT / "examples").glob("*.toml"))]
    return Path(tempfile.gettempdir()) / f"firnline-{name}" / code_digest((*_PRODUCT, *missions))


def code_digest(sources: Sequence[str], without: Sequence[str] = ()) -> str:
    """Return a digest of the files and of the folders' Python files, named from the root, without files of some names."""
    digest = hashlib.sha256()
    for source in sources:
        place = ROOT / source
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            if file.name not in without:
                digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
