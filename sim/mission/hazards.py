"""Hazards of a mission's map: steep ground for the next plan, and the risk of the route that was driven."""

from pathlib import Path

import survey
from sim.config.mission import MissionConfig
from survey.core.runs.store import RunFolder
from survey.reconstruction.hazards import BASE_M, hazard_grid, slope_hazard
from survey.reconstruction.method import MappedTerrain

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
