"""Drives of several rovers in one mission: each in a folder of its own, with one map of all.

With one rover the files of a stage lie in the stage's folder itself; with several, those of each rover lie in
``rover-01``, ``rover-02`` … below it. When a rover is lost and the others are to share its swaths, they are driven
again along the new route, whose first part is the old one. Ties are places that the images of two rovers saw from
above; they join their paths in the joint map.
"""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

import survey
from planners.routes.replanning import Loss, cut_short, remaining_swaths, replanned
from planners.routes.shortest_paths import FreeGround
from sim.config.mission import MissionConfig
from sim.mission.drives import drivable_area, simulate_drive
from sim.mission.localization import localize_drive, seen_drive
from sim.mission.losses import account_of_losses, loss_on, with_drawn_losses, write_account
from sim.simulate.simulated_drive import DRIVE_FILE, Ending
from sim.world.site import World, build_world
from survey.core import read_json, write_json
from survey.core.executors import run_all
from survey.data.sensors.odometry import DriveTies
from survey.reconstruction.joint.drives import SeveralDrives
from vision_slam.places.loop_closures import detect_drive_ties

LOSS_FILE = "losses.json"
"""Rovers that were lost, and what it cost."""


def rover_folder(folder: Path, rover: int) -> Path:
    """Return the folder of a rover, counted from 0, in that of a stage of several rovers."""
    return folder / f"rover-{rover + 1:02d}"


def drive_folders(folder: Path) -> list[Path]:
    """Return the folders of the drives in that of a stage: of each rover, or the folder itself with one rover."""
    return sorted(folder.glob("rover-*")) or [folder]


def route_of(route: survey.Route, rover: int) -> survey.Route:
    """Return the route of one rover alone."""
    legs = tuple(_numbered(leg, 0) for leg in route.legs if leg.rover == rover)
    return replace(route, legs=legs, prediction={})


def _numbered(leg: survey.Leg, rover: int) -> survey.Leg:
    return replace(leg, rover=rover)


def drive_fleet(
    world: World, route: survey.Route, mission: MissionConfig, folder: Path, workers: int
) -> None:
    """Drive the routes of all rovers and write each drive, the driven route of all, and what losses cost."""
    planned, mission = route, with_drawn_losses(route, mission)
    losses: list[Loss] = []
    left_m: list[float] = []
    _drive_each(range(route.n_rovers), route, mission, folder, workers)
    while loss := _next_loss(folder, losses):
        before, ground = route, FreeGround(drivable_area(world, mission).free)
        known = {one.rover for one in losses}
        if mission.fleet.on_loss == "replan":
            route = replanned(route, loss, ground, rover=mission.rover, dem=world.prior, lost=known)
        else:
            route = cut_short(route, loss)
        losses.append(loss)
        left_m.append(sum(leg.length_m for leg in remaining_swaths(before, loss)))
        changed = [k for k in range(route.n_rovers) if k != loss.rover and _differs(before, route, k)]
        _drive_each(changed, route, mission, folder, workers)
    route.write(folder / "driven_route.geojson")
    if losses:
        write_json(folder / LOSS_FILE, account_of_losses(planned, route, losses, left_m, mission))


def drive_alone(
    world: World, route: survey.Route, mission: MissionConfig, folder: Path, workers: int
) -> None:
    """Drive the route of a single rover; state how the drive ended where the rover is lost."""
    alone = with_drawn_losses(route, mission).of_rover(0)
    simulate_drive(world, route, alone, folder, workers)
    if alone.fidelity != "vision" and loss_on(route, alone) is not None:
        write_account(world, route, alone, folder)


def localize_fleet(mission: MissionConfig, simulated: Path, folder: Path, workers: int) -> None:
    """Localize every rover by its own recording."""
    rovers = range(len(drive_folders(simulated)))
    _side_by_side(partial(_localize_one, mission, simulated, folder), rovers, workers)


def _drive_each(
    rovers: Sequence[int], route: survey.Route, mission: MissionConfig, folder: Path, workers: int
) -> None:
    _side_by_side(partial(drive_rover, mission, route, folder), rovers, workers)


def _side_by_side(work: Callable[[int], None], rovers: Sequence[int], workers: int) -> None:
    """Do the work of every rover, in processes when there are several."""
    engine: Any = "processes" if workers > 1 and len(rovers) > 1 else "serial"
    for _ in run_all(work, rovers, engine=engine, workers=workers):
        pass


def drive_rover(mission: MissionConfig, route: survey.Route, folder: Path, rover: int) -> None:
    """Drive one rover's part of a route into its folder, which replaces that of an earlier drive."""
    place, alone, own = rover_folder(folder, rover), mission.of_rover(rover), route_of(route, rover)
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    world = build_world(mission)
    with threadpool_limits(limits=1):  # one order of sums, in this process and in others
        simulate_drive(world, own, alone, place)
        if mission.fidelity != "vision":
            write_account(world, own, alone, place)


def _localize_one(mission: MissionConfig, simulated: Path, folder: Path, rover: int) -> None:
    place = rover_folder(folder, rover)
    place.mkdir(parents=True)
    with threadpool_limits(limits=1):
        localize_drive(mission.of_rover(rover), rover_folder(simulated, rover), place)


def _next_loss(folder: Path, known: Sequence[Loss]) -> Loss | None:
    """Return the earliest loss that is not known yet, from the accounts of all drives."""
    done = {loss.rover for loss in known}
    losses = [
        Loss(rover, float(account["duration_s"]), float(account["progress_m"]))
        for rover, account in enumerate(accounts(folder))
        if account["ending"] != Ending.ARRIVED.value and rover not in done
    ]
    return min(losses, key=lambda loss: loss.time_s, default=None)


def accounts(folder: Path) -> list[dict[str, Any]]:
    """Return how the drive of each rover ended."""
    return [read_json(place / DRIVE_FILE, "the account of the drive") for place in drive_folders(folder)]


def endings(folder: Path) -> list[str]:
    """Return how the drives of a stage ended that have an account: all but those of a single rover that arrived."""
    files = [place / DRIVE_FILE for place in drive_folders(folder)]
    return [read_json(file, "the account of the drive")["ending"] for file in files if file.exists()]


def n_lost(folder: Path) -> int:
    """Return how many rovers of a stage did not arrive."""
    return sum(ending != Ending.ARRIVED.value for ending in endings(folder))


def _differs(before: survey.Route, after: survey.Route, rover: int) -> bool:
    return route_of(before, rover).legs != route_of(after, rover).legs


TIES_FILE = "ties.csv"
"""Places that rovers share, in the folder of their localization; there is none where they share none."""


def find_ties(simulated: Path, localized: Path) -> None:
    """Write the places that rovers with images share."""
    seen = [seen_drive(place, localized / place.relative_to(simulated)) for place in drive_folders(simulated)]
    drives = [drive for drive in seen if drive is not None]
    ties = detect_drive_ties(drives) if len(drives) == len(seen) > 1 else None
    if ties is not None:
        ties.write(localized / TIES_FILE)


def tied_drives(
    drives: SeveralDrives, paths: Sequence[survey.Trajectory], localized: Path, mission: MissionConfig
) -> SeveralDrives:
    """Return the landmarks of all rovers, corrected by the places that they share."""
    from vision_slam.fusion.pose_constraints import tie_drives

    file = localized / TIES_FILE
    if drives.path is None or not file.exists():
        return drives
    return tie_drives(drives, paths, DriveTies.read(file), mission.assumed)


def n_ties(localized: Path, n_rovers: int) -> list[int]:
    """Return how many places each rover shares with others."""
    file = localized / TIES_FILE
    if not file.exists():
        return [0] * n_rovers
    ties = DriveTies.read(file)
    return [int(((ties.first == k) | (ties.second == k)).sum()) for k in range(n_rovers)]
