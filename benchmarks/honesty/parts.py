"""Outcomes of surveys in files, one for each survey, so that a run that was broken off continues."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from benchmarks.honesty.surveys import FIRST_SEED, survey_of
from benchmarks.honesty.terrains import KINDS

_ROOT = Path(__file__).parents[2]
_FOLDER = Path(os.environ.get("FIRNLINE_HONESTY_PARTS", _ROOT / "results" / "runs" / "honesty"))
_SOURCES = ("survey/reconstruction", "survey/terrain", "benchmarks/honesty")


def outcomes(seeds: range, kinds: tuple[str, ...] = KINDS) -> list[dict[str, Any]]:
    """Return the outcomes of all surveys, and compute those that are not there yet for the present code."""
    folder = _FOLDER / _code()
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for seed in seeds:
        for kind in kinds:
            file = folder / f"{kind.replace(' ', '_')}-{seed}.json"
            if not file.exists():
                draft = file.with_suffix(".part")
                draft.write_text(json.dumps(survey_of(kind, seed)), encoding="utf-8")
                draft.replace(file)
            found += json.loads(file.read_text(encoding="utf-8"))
    return found


def judged_seeds(*, quick: bool) -> range:
    """Return the seeds of a run: as many as ``FIRNLINE_HONESTY_SEEDS`` says, 10 by default."""
    n = 1 if quick else int(os.environ.get("FIRNLINE_HONESTY_SEEDS", "10"))
    return range(FIRST_SEED, FIRST_SEED + n)


def _code() -> str:
    """Return a digest of the code that makes the outcomes."""
    digest = hashlib.sha256()
    for source in _SOURCES:
        for file in sorted((_ROOT / source).rglob("*.py")):
            if file.name not in ("figures.py", "__main__.py", "parts.py"):
                digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
