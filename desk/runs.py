"""Simulated runs of a plan: those in the working folder, their scores, and their maps as layers."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from desk.terrain.shading import DEVIATION, ELEVATION, ERROR, SUPPORT, colour_limit
from desk.terrain.tiles import picture
from firnline.actions.scoring import best_class
from sim.mission.fleet import drive_folders
from survey import Dem, FirnlineError, InputError, Reconstruction, Route, Truth
from survey.core import length_text, read_json, same_crs
from survey.core.config import read_toml
from survey.core.run_folder import RunFolder
from survey.reconstruction.terrain_map import MEASURED, SUPPORT_NAMES

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


def run_layer(run: RunFolder, layer: str, crs: CRS) -> dict[str, Any]:
    """Return a map of a run as a picture.

    Returns: a `desk.terrain.tiles.picture` with a ``title`` and the texts of both ``ends``.
    """
    if layer not in _LAYERS:
        raise InputError(f"the layer {layer[:40]!r} is none of {', '.join(_LAYERS)}.")
    map_ = Reconstruction.read(run.folder("reconstruct"))
    same_crs(crs, map_.mean.crs, "the desk and the run")
    return _LAYERS[layer](run, map_)


def difference_layer(one: RunFolder, other: RunFolder, crs: CRS) -> dict[str, Any]:
    """Return the map of one run minus that of another one as a picture.

    Returns: as for `run_layer`, with the root mean square ``rms_m`` of the difference.
    """
    first, second = (Reconstruction.read(run.folder("reconstruct")).mean for run in (one, other))
    for map_ in (first, second):
        same_crs(crs, map_.crs, "the desk and the run")
    values = first.elevation - second.at(first.xy).reshape(first.shape)
    if not np.isfinite(values).any():
        raise InputError("the maps of the two runs have no ground in common; choose runs of one area.")
    rms_m = float(np.sqrt(np.nanmean(values**2)))
    return _signed(Dem.on(first.grid(), values), "Difference of the maps") | {"rms_m": rms_m}


def layers_of(mean: Dem, std: Dem, top_m: float | None = None) -> dict[str, dict[str, Any]]:
    """Return elevation and standard deviation as pictures.

    `mean`, `std`: heights and their standard deviations [m]. `top_m`: deviation at the end of the colours, by default
    one that few values exceed; maps of one survey that grows share it. Returns: ``elevation`` and ``sigma``, as for
    `run_layer`.
    """
    return {"elevation": _elevation(mean), "sigma": _sigma(std, top_m)}


def _elevation(mean: Dem) -> dict[str, Any]:
    low, high = (float(limit) for limit in np.nanpercentile(mean.elevation, [1.0, 99.0]))
    ends = [f"{low:.1f} m", f"{high:.1f} m"]
    return picture(mean, ELEVATION, low, high) | {"title": "Elevation of the map", "ends": ends}


def _sigma(std: Dem, top_m: float | None = None) -> dict[str, Any]:
    top = colour_limit(std.elevation) if top_m is None else top_m
    ends = ["0 m", f"{top:g} m or more"]
    return picture(std, DEVIATION, 0.0, top) | {"title": "Standard deviation of the map", "ends": ends}


def _support(map_: Reconstruction) -> dict[str, Any]:
    raster = Dem.on(map_.mean.grid(), np.asarray(map_.support, dtype=np.float64))
    ends = [SUPPORT_NAMES[0].lower(), SUPPORT_NAMES[MEASURED].lower()]
    return picture(raster, SUPPORT, 0.0, float(MEASURED)) | {"title": "Support of the map", "ends": ends}


def _error(run: RunFolder, map_: Reconstruction) -> dict[str, Any]:
    truth = Truth.read(drive_folders(run.folder("simulate"))[0] / "truth").dem
    values = map_.mean.elevation - truth.at(map_.mean.xy).reshape(map_.mean.shape)
    return _signed(Dem.on(map_.mean.grid(), values), "Error of the map")


def _signed(raster: Dem, title: str) -> dict[str, Any]:
    """Return a picture in colours about zero."""
    top = colour_limit(raster.elevation)
    ends = [f"−{top:g} m or less", f"+{top:g} m or more"]
    return picture(raster, ERROR, -top, top) | {"title": title, "ends": ends}


_LAYERS: dict[str, Callable[[RunFolder, Reconstruction], dict[str, Any]]] = {
    "error": _error,
    "sigma": lambda _, map_: _sigma(map_.std),
    "elevation": lambda _, map_: _elevation(map_.mean),
    "support": lambda _, map_: _support(map_),
}
