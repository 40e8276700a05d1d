"""Outcomes of surveys in files, one for each survey, so that a run that was broken off continues."""

import os
from pathlib import Path
from typing import Any

from benchmarks.honesty.surveys import FIRST_SEED, survey_of
from benchmarks.honesty.terrains import KINDS
from benchmarks.stored_parts import ROOT, code_digest, stored

_FOLDER = Path(os.environ.get("FIRNLINE_HONESTY_PARTS", ROOT / "results" / "runs" / "honesty"))
_SOURCES = ("survey/reconstruction", "survey/terrain", "benchmarks/honesty")


def outcomes(seeds: range, kinds: tuple[str, ...] = KINDS) -> list[dict[str, Any]]:
    """Return the outcomes of all surveys, and compute those that are not there yet for the present code."""
    folder = _FOLDER / code_digest(_SOURCES, without=("figures.py", "__main__.py", "parts.py"))
    found = []
    for seed in seeds:
        for kind in kinds:
            file = folder / f"{kind.replace(' ', '_')}-{seed}.json"
            found += stored(file, lambda kind=kind, seed=seed: survey_of(kind, seed))
    return found


def judged_seeds(*, quick: bool) -> range:
    """Return the seeds of a run: as many as ``FIRNLINE_HONESTY_SEEDS`` states, 20 by default."""
    n = 1 if quick else int(os.environ.get("FIRNLINE_HONESTY_SEEDS", "20"))
    return range(FIRST_SEED, FIRST_SEED + n)
