"""Outcomes of missions in files, one for each mission, so that a run that was broken off continues."""

from typing import Any

from benchmarks.honest_missions.earlier import earlier_map
from benchmarks.honest_missions.maps import outcomes_of
from benchmarks.honest_missions.missions import FOLDER, PATTERNS, SEEDS
from benchmarks.stored_parts import code_digest, stored

_SOURCES = (
    "survey/reconstruction",
    "survey/terrain",
    "vision_slam",
    "benchmarks/honest_missions/maps.py",
    "benchmarks/honest_missions/missions.py",
)


def outcomes(*, quick: bool) -> list[dict[str, Any]]:
    """Return the outcomes of all maps, and compute those that are not there yet for the present code."""
    folder = FOLDER / "maps" / code_digest(_SOURCES)
    found: list[dict[str, Any]] = []
    for seed in SEEDS[: 1 if quick else None]:
        for pattern in list(PATTERNS)[: 1 if quick else None]:
            found += stored(folder / f"{pattern}-{seed}.json", lambda p=pattern, s=seed: outcomes_of(p, s))
    return found


def earlier(found: list[dict[str, Any]]) -> dict[tuple[str, int], dict[str, float]]:
    """Return the earlier code's maps of the missions that were found; empty where it is not there."""
    missions = dict.fromkeys((one["pattern"], one["seed"]) for one in found)
    maps = {mission: earlier_map(*mission) for mission in missions}
    return {mission: facts for mission, facts in maps.items() if facts is not None}
