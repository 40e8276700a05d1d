"""One drive of a mission: simulated along its route, by error models or with images, and written.

It is localized in `sim.mission.localization`; the drives of several rovers are put together in `sim.mission.fleet`.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

import survey
from planners.registry import steering_of
from planners.routes.replanning import cut_short
from planners.routes.traversability import drivable
from planners.steered_paths import WaypointSteering
from sim.config.mission import MissionConfig
from sim.instruments.environment import record_payload
from sim.instruments.lidar import record_scans
from sim.mission.losses import loss_on
from sim.simulate.simulation import simulate_ideal, simulate_statistical
from sim.simulate.steering import AttitudeErrors, SteeredPath, drive_steered
from sim.world.site import World
from survey.core import stream

if TYPE_CHECKING:
    from sim.simulate.vision import DriveOperator


def simulate_drive(
    world: World,
    route: survey.Route,
    mission: MissionConfig,
    folder: Path,
    workers: int = 1,
    *,
    operator: "DriveOperator | None" = None,
) -> None:
    """Drive a route of one rover, or from its start as an operator commands, and record what the rover senses."""
    if operator is not None:
        _drive_by_commands(world, route, mission, folder, operator)
    elif mission.fidelity == "vision":
        _drive_with_images(world, route, mission, folder, workers)
    else:
        _drive_by_error_models(world, route, mission, folder)
    if mission.payload:
        record_payload(survey.Truth.read(folder / "truth"), mission, folder / "payload")


def _drive_by_error_models(world: World, route: survey.Route, mission: MissionConfig, folder: Path) -> None:
    """Follow a route exactly, up to where the rover is lost, draw what it senses, and write the drive."""
    route = steer_route(route, world, mission)
    loss = loss_on(route, mission)
    if loss is not None:
        route = cut_short(route, loss)
    route.write(folder / "driven_route.geojson")
    sensed = simulate_ideal if mission.fidelity == "ideal" else simulate_statistical
    recording, truth = sensed(world.terrain, route, mission)
    recording.write(folder / "recording")
    truth.write(folder / "truth")


def _drive_with_images(
    world: World, route: survey.Route, mission: MissionConfig, folder: Path, workers: int
) -> None:
    """Drive with rendered images, steered by the estimate or by the real pose, and write the drive."""
    # Here: physics and compiled rendering take a second to import.
    from sim.simulate.navigator import navigating
    from sim.simulate.vision import EDGE_M, simulate_vision

    steering = _steering_on_the_way(route, world, mission, EDGE_M)
    with navigating(mission.assumed, mission.rover.antenna_height_m, mission.seed, workers) as navigate:
        driven = simulate_vision(
            world.terrain,
            route,
            mission,
            folder / "recording",
            navigate,
            steers=mission.physics.steer_by == "estimate",
            steered=None if steering is None else SteeredPath(steering),
        )
    (route if steering is None else steering.driven()).write(folder / "driven_route.geojson")
    driven.write(folder)
    record_scans(driven.truth, mission, folder / "recording")


def _drive_by_commands(
    world: World, route: survey.Route, mission: MissionConfig, folder: Path, operator: "DriveOperator"
) -> None:
    """Drive with rendered images as an operator commands, and write the drive; its route is where the rover was."""
    from sim.simulate.vision import drive_by_commands

    driven = drive_by_commands(world.terrain, route, mission, folder / "recording", operator)
    path = driven.truth.trajectory.position[:, :2]
    along_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T))]
    each_metre = np.searchsorted(along_m, np.arange(0.0, along_m[-1], 1.0))
    leg = survey.Leg("swath", path[[*each_metre, len(path) - 1]])
    survey.Route((leg,), route.crs, "commands").write(folder / "driven_route.geojson")
    driven.write(folder)
    record_scans(driven.truth, mission, folder / "recording")


def _steering_on_the_way(
    route: survey.Route, world: World, mission: MissionConfig, edge_m: float
) -> WaypointSteering | None:
    """Return what chooses the path while the rover drives, off the terrain's edge; None for patterns that are fixed before."""
    steering = steering_of(mission.planner)
    if steering is None:
        return None
    ground = drivable_area(world, mission).free.intersection(
        shapely.box(*world.terrain.bounds).buffer(-edge_m)
    )
    return WaypointSteering(route, steering, ground, stream(mission.seed, "steering"))


def drivable_area(world: World, mission: MissionConfig) -> survey.SurveyArea:
    """Return the ground that the rover may drive on, by the prior."""
    return drivable(world.area, mission.rover, world.prior).within(world.area)


def steer_route(route: survey.Route, world: World, mission: MissionConfig) -> survey.Route:
    """Return the route as driven without images: steered patterns follow the attitude that the rover senses."""
    steering = steering_of(mission.planner)
    if steering is None:
        return route
    errors = None
    if mission.fidelity == "statistical":
        sensed = [stream(mission.seed, "steering", "sensed")]
        errors = AttitudeErrors(mission.sensors, mission.rover.speed_m_s, sensed)
    rngs = [stream(mission.seed, "steering")]
    return drive_steered(
        drivable_area(world, mission), route, steering, world.terrain, rngs=rngs, errors=errors
    )[0]
