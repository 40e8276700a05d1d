"""Stages of a mission from plan to report: each reads the files of those before it and writes its own.

area, prior ──plan──▶ route ──simulate──▶ recording ──localize──▶ trajectory, points
                                  └─ truth ─┐                          │
report ◀──report── score ◀──score───────────┴── reconstruction ◀── reconstruct
"""

import logging
import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits

import planners
import survey
from planners.routes.replanning import with_way_home
from sim.config.mission import MissionConfig
from sim.mission.derived_maps import map_hazards, map_payloads, score_payloads
from sim.mission.fleet import drive_alone, drive_fleet, drive_folders, find_ties, localize_fleet, tied_drives
from sim.mission.localization import localize_drive, mapped_points, path_scores, with_ice_motion
from sim.mission.runs import refuse_other_versions
from sim.world.moving_ice import in_ice_order, write_on_ice
from sim.world.site import SharedWorld
from survey.core import check_types, write_json
from survey.core.run_folder import STAGES, RunFolder
from survey.reconstruction.joint.drives import SeveralDrives
from survey.reconstruction.mapping import map_landmarks

logger = logging.getLogger(__name__)

Stage = Callable[[MissionConfig, RunFolder, Path], None]
"""Called with a mission, its run and the folder of the stage, into which it writes its files."""
StageContext = Callable[[str], AbstractContextManager[object]]
"""Called with a stage's name; gives the context in which the stage runs, to show or time it."""


@check_types
def run_mission(
    mission: MissionConfig,
    run: RunFolder,
    *,
    until: str = "report",
    watch: StageContext = nullcontext,
    workers: int | None = None,
    world: SharedWorld | None = None,
) -> None:
    """Run every stage that is not done yet, in order.

    Parameters
    ----------
    mission : MissionConfig
        Settings of all stages.
    run : RunFolder
        Its folder; finished stages are checked against their checksums and not run again.
    until : str
        The last stage.
    watch : callable
        Wraps each stage that is run.
    workers : int, optional
        Processes: rovers of a fleet drive side by side, and with one rover and images the onboard computer
        works beside the simulation, to the same bytes. As many as this process may use cores, unless given.
    world : SharedWorld, optional
        World of the mission, where it was built to open the run; it is released after the simulation.

    Raises
    ------
    InputError
        What a stage refuses, or a finished stage whose files were changed.
    """
    wanted = STAGES[: STAGES.index(until) + 1]
    _refuse_mixed_versions(run, wanted)
    n = len(os.sched_getaffinity(0)) if workers is None else workers
    shared = world or SharedWorld(mission)
    stages: dict[str, Stage] = {
        "plan": partial(_plan, world=shared),
        "simulate": partial(_simulate, world=shared, workers=n),
        "localize": partial(_localize, workers=n),
        "reconstruct": _reconstruct,
        "score": _score,
        "report": _report,
    }
    with threadpool_limits(limits=1):  # one order of sums keeps the bytes, and spinning threads are slower
        for name in wanted:
            if run.has(name):
                run.verify(name)
                continue
            with watch(name), run.stage(name) as folder:
                stages[name](mission, run, folder)
            if name == "simulate":
                shared.release()
            logger.info("finished the stage %s", name)


def _refuse_mixed_versions(run: RunFolder, wanted: Sequence[str]) -> None:
    """Refuse to add stages to those that other versions of the computing packages have made."""
    n_done = sum(run.has(name) for name in wanted)
    if 0 < n_done < len(wanted):
        remedy = "do all stages again with --fresh, or those from one stage on with --from STAGE"
        refuse_other_versions(run.manifest["versions"], f"the run {run.path}", remedy)


def _plan(mission: MissionConfig, run: RunFolder, folder: Path, *, world: SharedWorld) -> None:
    """Plan the route from the area and the prior alone."""
    site = world.get()
    site.area.write(folder / "area.gpkg")
    site.prior.write(folder / "prior.tif")
    route = planners.plan(site.area, site.prior, mission.planner, rover=mission.rover, fleet=mission.fleet)
    route = in_ice_order(route, mission, site)
    if mission.aids.way_home:
        route = with_way_home(route, site.area)
    route.write(folder / "route.geojson")
    if mission.ice is not None:
        write_on_ice(route, mission, folder)


def _simulate(
    mission: MissionConfig, run: RunFolder, folder: Path, *, world: SharedWorld, workers: int
) -> None:
    """Drive the route of each rover over the real terrain and record what it senses."""
    route = survey.Route.read(run.folder("plan") / "route.geojson")
    if route.n_rovers > 1:
        drive_fleet(world.get(), route, mission, folder, _processes(mission, workers))
    else:
        drive_alone(world.get(), route, mission, folder, workers)


def _localize(mission: MissionConfig, run: RunFolder, folder: Path, *, workers: int) -> None:
    """Localize each rover, and the landmarks that it saw, by its recording and by nothing else."""
    simulated = run.folder("simulate")
    if drive_folders(simulated) == [simulated]:
        localize_drive(mission, simulated, folder)
    else:
        localize_fleet(mission, simulated, folder, _processes(mission, workers))
        find_ties(simulated, folder)


def _processes(mission: MissionConfig, workers: int) -> int:
    """Return the number of processes for the rovers of a fleet: drives without images are shorter than a process's start."""
    return workers if mission.fidelity == "vision" else 1


def _reconstruct(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Map the terrain from the landmarks of all rovers and the prior; a joint map corrects the paths too."""
    config, localized = mission.reconstruction, run.folder("localize")
    area = survey.SurveyArea.read(run.folder("plan") / "area.gpkg")
    places = drive_folders(localized)
    points = [mapped_points(place) for place in places]
    paths = [survey.Trajectory.read(place / "trajectory.csv", area.crs) for place in places]
    drives = SeveralDrives.of([(seen, path.error) for seen, path in zip(points, paths, strict=True)])
    drives = tied_drives(drives, paths, localized, mission)
    prior = survey.Dem.read(run.folder("plan") / "prior.tif") if config.use_prior else None
    grid = survey.Grid.over(area.bounds, config.grid_step_m, area.crs)
    mapped = map_landmarks(drives.points, grid, config, prior=prior, path=drives.path, area=area)
    if len(places) == 1:
        mapped = with_ice_motion(places[0], mapped, folder)
    mapped.reconstruction.write(folder)
    if mapped.correction is not None:
        for place, path, part in zip(places, paths, drives.corrections(mapped.correction), strict=True):
            below = folder / place.relative_to(localized)
            below.mkdir(exist_ok=True)
            part.applied(path).write(below / "corrected_trajectory.csv")
    map_hazards(mission, run, folder, mapped)
    map_payloads(mission, run, folder, mapped.reconstruction)


def _score(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Judge the map and the path of each rover against the truth."""
    simulated, localized = run.folder("simulate"), run.folder("localize")
    places = drive_folders(simulated)
    judged = survey.score(
        survey.Reconstruction.read(run.folder("reconstruct")),
        truth=survey.Truth.read(places[0] / "truth").dem,
        route=survey.Route.read(simulated / "driven_route.geojson"),
        area=survey.SurveyArea.read(run.folder("plan") / "area.gpkg"),
        sample_step_m=mission.score.sample_step_m,
    )
    write_json(folder / "score.json", judged.to_dict())
    for place in places:
        part = place.relative_to(simulated)
        (folder / part).mkdir(exist_ok=True)
        scores = path_scores(place, localized / part, run.folder("reconstruct") / part)
        write_json(folder / part / "localization.json", scores)
    score_payloads(mission, run, folder)


def _report(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Write the report page of plan, drive, map and scores."""
    from sim.mission.report import write_mission_report  # here, because matplotlib takes a second to import

    write_mission_report(folder, run)
