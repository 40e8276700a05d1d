"""Outcomes of surveys in files, one for each survey, so that a run that was broken off continues."""

import os
from pathlib import Path
from typing import Any

from benchmarks.honesty.earlier import earlier_maps
from benchmarks.honesty.surveys import FIRST_SEED, survey_of
from benchmarks.honesty.terrains import KINDS
from benchmarks.stored_parts import ROOT, code_digest, stored

_FOLDER = Path(os.environ.get("FIRNLINE_HONESTY_PARTS", ROOT / "results" / "runs" / "honesty"))
_NO_OUTCOMES = ("figures.py", "__main__.py", "parts.py", "earlier.py")
_SOURCES = ("survey/reconstruction", "survey/terrain", "benchmarks/honesty")


def outcomes(seeds: range, kinds: tuple[str, ...] = KINDS) -> list[dict[str, Any]]:
    """Return the outcomes of all surveys, and compute those that are not there yet for the present code."""
    folder = _FOLDER / code_digest(_SOURCES, without=_NO_OUTCOMES)
    found = []
    for seed in seeds:
        for kind in kinds:
            file = folder / f"{kind.replace(' ', '_')}-{seed}.json"
            found += stored(file, lambda kind=kind, seed=seed: survey_of(kind, seed))
    return found


def earlier_outcomes(seeds: range) -> list[dict[str, Any]]:
    """Return the maps of some of the surveys by the code of commit e7dc4dd, those that are stored or can be made."""
    return earlier_maps(_FOLDER / "earlier", seeds)


def judged_seeds(*, quick: bool) -> range:
    """Return the seeds of a run: as many as ``FIRNLINE_HONESTY_SEEDS`` states, 20 by default."""
    n = 1 if quick else int(os.environ.get("FIRNLINE_HONESTY_SEEDS", "20"))
    return range(FIRST_SEED, FIRST_SEED + n)
