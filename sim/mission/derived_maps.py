"""Maps derived from the map of a mission: steep ground, and the quantities of the science payload.

`map_hazards` writes the probability of ground beyond the rover's largest slope, for the next plan, and the risk of the
driven route. `map_payloads` maps every quantity from the logs of all drives, and `score_payloads` judges these maps
against the simulated fields.
"""

from pathlib import Path
from typing import Any

import numpy as np

import survey
from sim.config.mission import MissionConfig
from sim.instruments.environment import PayloadField
from sim.mission.fleet import drive_folders
from survey import Truth
from survey.core import write_json
from survey.core.run_folder import RunFolder
from survey.data.sensors.payload import PayloadLog, Quantity
from survey.reconstruction.hazards import BASE_M, hazard_grid, slope_hazard
from survey.reconstruction.method import MappedTerrain
from survey.reconstruction.payload import map_payload, payload_grid, write_payload
from survey.reconstruction.terrain_map import SIGMAS_95
from survey.scoring.coverage import SampleCells, science_coverage

HAZARDS = "hazards"
"""Folder of the hazards below that of the map."""


def map_hazards(mission: MissionConfig, run: RunFolder, folder: Path, mapped: MappedTerrain) -> None:
    """Write the probability of ground beyond the rover's largest slope or step, if it has one and the map is a joint one."""
    limit_deg = mission.rover.hazard_slope_deg(BASE_M)
    if limit_deg is None or mapped.solution is None:
        return
    area = survey.SurveyArea.read(run.folder("plan") / "area.gpkg")
    route = survey.Route.read(run.folder("simulate") / "driven_route.geojson")
    place = folder / HAZARDS
    place.mkdir()
    grid = hazard_grid(mapped.reconstruction.mean.grid())
    slope_hazard(mapped.solution, grid, limit_deg).write(place, area, route)


PAYLOAD = "payload"
"""Folder of the logs of a drive, and of the maps of a run; file of their scores."""


def map_payloads(
    mission: MissionConfig, run: RunFolder, folder: Path, terrain: survey.Reconstruction
) -> None:
    """Map every quantity of the payload by the paths as the map of the terrain has corrected them."""
    if not mission.payload:
        return
    paths = [_best_path(run, folder, place, terrain) for place in drive_folders(run.folder("localize"))]
    grid = payload_grid(terrain.mean.grid())
    (folder / PAYLOAD).mkdir()
    for quantity in mission.payload:
        logs = logs_of(run, quantity)
        place = folder / PAYLOAD / quantity.name
        place.mkdir()
        mapped = map_payload(logs, paths, terrain.mean, grid, terrain_std=terrain.std)
        write_payload(mapped, logs[0], place)


def logs_of(run: RunFolder, quantity: Quantity) -> list[PayloadLog]:
    """Return the logs of a quantity on all drives of a run."""
    places = drive_folders(run.folder("simulate"))
    return [PayloadLog.read(place / PAYLOAD / f"{quantity.name}.csv", quantity) for place in places]


def _best_path(
    run: RunFolder, folder: Path, place: Path, terrain: survey.Reconstruction
) -> survey.Trajectory:
    corrected = folder / place.relative_to(run.folder("localize")) / "corrected_trajectory.csv"
    file = corrected if corrected.exists() else place / "trajectory.csv"
    return survey.Trajectory.read(file, terrain.mean.crs)


def score_payloads(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Judge the map of every quantity against the simulated field, and how much of the area its readings reached."""
    if not mission.payload:
        return
    area = survey.SurveyArea.read(run.folder("plan") / "area.gpkg")
    truths = [Truth.read(place / "truth") for place in drive_folders(run.folder("simulate"))]
    cells = SampleCells(area, mission.score.sample_step_m)
    scores = {}
    for quantity in mission.payload:
        mapped = survey.Reconstruction.read(run.folder("reconstruct") / PAYLOAD / quantity.name)
        field = PayloadField(quantity, truths[0].dem, mission.site_seed)
        logs = zip(logs_of(run, quantity), truths, strict=True)
        places = [log.placed(truth.trajectory).xy for log, truth in logs]
        visited = cells.visited(np.vstack([xy for xy in places if xy is not None]))
        reached = science_coverage(visited, cells.centres, area.reference)
        scores[quantity.name] = {**_payload_score(mapped, field, area), "scc": reached, "unit": quantity.unit}
    write_json(folder / f"{PAYLOAD}.json", scores)


def _payload_score(
    mapped: survey.Reconstruction, field: PayloadField, area: survey.SurveyArea
) -> dict[str, Any]:
    """Return the error of a map of a quantity inside the area, and the coverage of its 95 % interval."""
    xy, mean, std = mapped.mean.xy, mapped.mean.elevation.ravel(), mapped.std.elevation.ravel()
    error = mean - field.at(xy)
    inside = np.isfinite(error) & area.contains(xy)
    error, std = error[inside], std[inside]
    return {
        "rmse": float(np.sqrt(np.mean(error**2))),
        "coverage_95": float(np.mean(np.abs(error) <= SIGMAS_95 * std)),
        "claimed_rms": float(np.sqrt(np.mean(std**2))),
    }
