"""Runs that lie in the working folder, and what they reached."""

from datetime import datetime
from pathlib import Path
from typing import Any

from firnline.cli.mission_file import best_class
from survey.core.config import read_toml
from survey.core.documents import read_json
from survey.core.errors import FirnlineError, InputError
from survey.core.run_folder import RunFolder
from survey.core.text import length_text
from survey.data.route import Route

_PATTERNS = ("*_mission/runs/*/*/manifest.json", "runs/*/*/manifest.json", "results/runs/*/*/manifest.json")
_MOST_RUNS = 30


def found_runs(folder: Path, opened: Path | None = None) -> dict[str, RunFolder]:
    """Return the finished runs of a working folder, the latest first.

    Returns: by name, such as ``hills-3f2a90c1``.
    """
    places = [place for pattern in _PATTERNS for place in folder.glob(pattern)]
    if opened is not None:
        places += opened.parent.glob("*/manifest.json")
    runs = {place.parent.resolve() for place in places if not place.parent.is_symlink()}
    latest = sorted(runs, key=lambda run: (run / "manifest.json").stat().st_mtime, reverse=True)
    found = {f"{place.parent.name}-{place.name[:8]}": RunFolder(place) for place in latest[:_MOST_RUNS]}
    return {name: run for name, run in found.items() if run.has("score")}


def run_named(runs: dict[str, RunFolder], name: str) -> RunFolder:
    """Return a run by its name; refuse a name that is none."""
    if name not in runs:
        raise InputError(f"there is no run {name[:60]!r} in the working folder; reload the list of runs.")
    return runs[name]


def run_row(name: str, run: RunFolder) -> dict[str, Any]:
    """Return what the table of runs states of one, or why it cannot be read.

    Returns: ``name``, ``title``, ``facts`` by title, and ``folder``; or ``error``.
    """
    try:
        config = read_toml(run.path / "config.toml")
        return {
            "name": name,
            "title": _title(run, config),
            "facts": _facts(run, config),
            "folder": str(run.path),
            "has_report": run.has("report"),
        }
    except FirnlineError as error:
        return {"name": name, "title": name, "error": str(error), "facts": {}, "folder": str(run.path)}


def _title(run: RunFolder, config: dict[str, Any]) -> str:
    made = datetime.fromtimestamp((run.path / "manifest.json").stat().st_mtime).astimezone()
    planner = config["planner"]
    swaths = f", {planner['swaths']} swaths" if planner.get("swaths") else ""
    return f"{planner['pattern']}{swaths}, seed {config['seed']}, {made:%d %b %H:%M}"


def _facts(run: RunFolder, config: dict[str, Any]) -> dict[str, str]:
    score = read_json(run.folder("score") / "score.json", "the score")
    errors = score["elevation"]
    calibration = dict(zip(score["calibration"]["levels"], score["calibration"]["shares"], strict=True))
    return {
        "RMSE": f"{errors['rmse_m']:.3f} m",
        "Median": f"{errors['median_m']:+.3f} m",
        "NMAD": f"{errors['nmad_m']:.3f} m",
        "95 % below": f"{errors['p95_m']:.3f} m",
        "Largest": f"{errors['worst_m']:.2f} m",
        "Within the claimed 95 %": f"{calibration.get(0.95, float('nan')):.0%}",
        "Driven": length_text(Route.read(run.folder("simulate") / "driven_route.geojson").ground_length_m),
        "Depth": str(config["fidelity"]),
        "Class": best_class(score),
    }
