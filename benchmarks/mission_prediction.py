"""Predicted errors of missions beside those of their drives: what ``firnline plan MISSION --require`` states.

``python -m benchmarks.mission_prediction [--quick] [--json FILE]``

Two windows of each landscape of `benchmarks.promise_on_real_ground`, and random terrain, are surveyed by drives of the
statistical fidelity along 4 and 8 swaths with the default sensors, localized, and mapped with the prior, as missions are. The
prediction drives over the prior, with other random numbers. Settings of the prediction were chosen on eleven landscapes by
surveys without errors of position; the landslide slope and random terrain are fresh. Parts are stored; 30 drives take about
15 minutes of CPU. FIRNLINE_PREDICTED_RANDOM is the number of random terrains, 6 when left out.
"""

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.mission_settings import stated_mission
from benchmarks.prediction import Bars, Case, Judged, chance_rows, median_of, ratio_rows
from benchmarks.promise_on_real_ground.windows import (
    FOLDER,
    LANDSCAPES,
    SEED,
    filled,
    fine_dem,
    landscape_of,
    site_of,
    windows,
)
from benchmarks.report import Row, main
from benchmarks.stored_parts import code_digest, stored
from sim.config.mission import MissionConfig
from sim.mission.drive_prediction import error_model_of, planned_mission, predicted_drive
from sim.mission.localization import localize_recording
from sim.simulate.simulation import simulate_statistical
from sim.world.site import World, build_world
from survey import Grid
from survey.core.streams import stream
from survey.reconstruction.mapping import map_landmarks

_SWATHS = (4, 8)
_FAMILIES = (
    "fractional_brownian",
    "matern-3/2",
    "matern-5/2",
    "squared-exponential",
    "gaussian_hills",
    "diamond_square",
)
_N_RANDOM = int(os.environ.get("FIRNLINE_PREDICTED_RANDOM", len(_FAMILIES)))
_RANDOM = {"source": "random", "size_m": 240.0, "length_scale_m": 60.0, "micro_relief_sd_m": 0.1}
_REAL, _FRESH, _MADE = "real ground", "landslide slope", "random terrain"
_VIEW_M, _N_NODES = 30.0, 60
"""Ground about the area that the camera sees [m], and nodes of a map along one side."""


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of real ground, of the fresh landscape, of random terrain, and of all drives."""
    if not FOLDER.is_dir():
        sys.exit(f"the folder of real data {FOLDER} is not here; set FIRNLINE_DATA.")
    cases = [case for turn, case in enumerate(_cases()) if not quick or turn % 9 == 0]
    found = [_judged(case) for case in cases]
    for one in found:
        name = f"{one.case.landscape} {one.case.window}, {one.case.lines}"
        yield Row(f"{name}: predicted over driven error ({one.actual_m:.2f} m)", one.ratio, "x")
    for kind in (_REAL, _FRESH, _MADE):
        mine = [one for one in found if _kind(one.case) == kind]
        if mine:
            yield from _group(kind, mine, Bars(is_judged=False))
    yield from _group("all drives", found, Bars(is_judged=True))


def _group(name: str, found: list[Judged], row: Bars) -> Iterator[Row]:
    """Yield the figures of some drives."""
    title = f"{name}: predicted over driven error"
    yield Row(f"{name}: drives", len(found), "")
    yield from ratio_rows(title, found, row)
    yield row.of(f"{title}, median", median_of(found), "x", (">=", 0.95))
    yield row.of(f"{title}, median, not too large", median_of(found), "x", ("<=", 1.1))
    yield from chance_rows(name, found, row)


def _cases() -> Iterator[Case]:
    """Yield the drives: first and last window of each landscape, and one random terrain of each family."""
    real = [one.name for one in LANDSCAPES if one.half != "shifted"]
    for turn, name in enumerate(real):
        for k, window in enumerate((0, len(windows(name)) - 1)):
            yield Case(name, window, f"{_SWATHS[(turn + k) % 2]} swaths", "product")
    for turn, family in enumerate(_FAMILIES[:_N_RANDOM]):
        k = (turn + 1) % 2
        yield Case(family, k, f"{_SWATHS[k]} swaths", "product")


def _kind(case: Case) -> str:
    if case.landscape in _FAMILIES:
        return _MADE
    return _FRESH if case.landscape == _FRESH else _REAL


def _judged(case: Case) -> Judged:
    """Predict a mission before it is driven, and judge the prediction by the map of a drive."""
    mission = _mission(case)
    world = _world(case, mission)
    found, _ = predicted_drive(mission, world, error_model_of(mission, world))
    driven = mission.model_copy(update={"seed": mission.seed + 1})
    actual_m = stored(_file(case), lambda: _driven_m(driven, world))
    return Judged.of(case, found, actual_m)


def _mission(case: Case) -> MissionConfig:
    """Return the mission of a drive, which knows the white error of its prior's cells."""
    sections: dict[str, Any] = {"terrain": _RANDOM | {"family": case.landscape}}
    sections["satellite"] = {"cell_m": 30.0, "product": "unknown"}
    if _kind(case) != _MADE:
        sigma_m = landscape_of(case.landscape).prior_sigma_m
        sections = {
            "terrain": {"source": "random"},
            "reconstruction": {"joint": {"satellite": {"sigma_m": sigma_m}}},
        }
    sections["planner"] = {"pattern": "lawnmower", "swaths": int(case.lines.split()[0])}
    seed = int(stream(SEED, "drive", case.landscape, case.window).integers(2**31))
    return stated_mission("predicted", seed, sections)


def _world(case: Case, mission: MissionConfig) -> World:
    """Return the ground of a drive with what the camera sees about it, its prior, and the area."""
    if _kind(case) == _MADE:
        return build_world(mission)
    site = site_of(case.landscape, case.window)
    west, south, east, north = windows(case.landscape)[case.window]
    near = fine_dem(case.landscape).window((west - _VIEW_M, south - _VIEW_M, east + _VIEW_M, north + _VIEW_M))
    return World(filled(near), site.prior, site.area)


def _driven_m(mission: MissionConfig, world: World) -> float:
    """Drive, localize and map as a mission does; return the root mean square error of the map [m]."""
    recording, _ = simulate_statistical(world.terrain, planned_mission(mission, world), mission)
    found = localize_recording(recording, mission)
    bounds = world.area.bounds
    grid = Grid(bounds, (bounds[2] - bounds[0]) / _N_NODES, world.area.crs)
    mapped = map_landmarks(
        found.points,
        grid,
        mission.reconstruction,
        prior=world.prior,
        path=found.trajectory.error,
        area=world.area,
    )
    error_m = mapped.reconstruction.mean.elevation.ravel() - world.terrain.at(grid.xy)
    return float(np.sqrt(np.nanmean(np.square(error_m))))


def _file(case: Case) -> Path:
    name = "-".join(map(str, case)).replace(" ", "_").replace("/", "_")
    code = code_digest(("survey", "sim", "vision_slam"))
    return Path(tempfile.gettempdir()) / "firnline-mission-prediction" / code / f"{name}.json"


if __name__ == "__main__":
    main("Predicted errors of missions", measure)
