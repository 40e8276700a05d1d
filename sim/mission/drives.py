"""One drive of a mission: simulated along its route, localized, and its path judged.

The drives of several rovers are put together in `sim.mission.fleet`.
"""

from pathlib import Path
from typing import Any

import numpy as np
import shapely

import planners
import survey
import vision_slam
from planners.routes.replanning import Loss, cut_short
from planners.routes.rover import effort
from planners.steered_paths import WaypointSteering
from sim.config.mission import MissionConfig
from sim.config.sensors import faults_of
from sim.instruments.environment import record_payload
from sim.instruments.lidar import scans_along
from sim.simulate.simulated_drive import ONBOARD, Ending
from sim.simulate.simulation import sensed_attitude, simulate_ideal, simulate_statistical
from sim.world.moving_ice import assumed_motion, epoch_of
from sim.world.site import World
from survey.core.documents import write_json
from survey.core.streams import stream
from survey.data.ice_motion import ICE_MOTION, read_motion, write_motion
from survey.data.recording import Recording, table_file
from survey.data.truth import Truth
from survey.reconstruction.method import MappedTerrain
from survey.reconstruction.motion.epoch import in_fixed_frame, with_age
from survey.reconstruction.motion.refinement import refined_motion
from survey.reconstruction.registration.scan_points import BeamErrors, scan_points
from vision_slam.drive_estimate import Localization
from vision_slam.odometry.odometer import VisualOdometry

DRIVE_FILE = "drive.json"
"""How a drive ended, with its length, time and energy."""
LANDMARKS, SCAN_POINTS = "surface_points.gpkg", "scan_points.gpkg"
"""Points that a drive is localized with, and those of its LiDAR scans."""


def drive(world: World, route: survey.Route, mission: MissionConfig, folder: Path, workers: int = 1) -> None:
    """Drive a route of one rover over the real terrain and record what the rover senses.

    Parameters
    ----------
    world : World
        Real terrain, prior and area.
    route : Route
        Route of this rover alone.
    mission : MissionConfig
        Settings, with the seed and the faults of this rover.
    folder : pathlib.Path
        Existing folder of the drive.
    workers : int
        With two, the onboard computer of a drive with images has a process of its own.
    """
    if mission.fidelity == "vision":
        _drive_with_images(world, route, mission, folder, workers)
    else:
        _drive_by_error_models(world, route, mission, folder)
    if mission.payload:
        record_payload(Truth.read(folder / "truth"), mission, folder / "payload")


def _drive_by_error_models(world: World, route: survey.Route, mission: MissionConfig, folder: Path) -> None:
    """Follow a route exactly, up to where the rover is lost, draw what it senses, and write the drive."""
    route = steered(route, world, mission)
    loss = loss_on(route, mission)
    if loss is not None:
        route = cut_short(route, loss)
    route.write(folder / "driven_route.geojson")
    sensed = simulate_ideal if mission.fidelity == "ideal" else simulate_statistical
    recording, truth = sensed(world.terrain, route, mission)
    recording.write(folder / "recording")
    truth.write(folder / "truth")


def loss_on(route: survey.Route, mission: MissionConfig) -> Loss | None:
    """Return when and where a rover that follows its route exactly is stopped for good by a fault, if it is."""
    stops = [fault.from_s for fault in faults_of(mission.faults, "tracks") if fault.failure == "stopped"]
    length_m, speed_m_s = float(sum(leg.length_m for leg in route.legs)), mission.rover.speed_m_s
    first_s = min(stops, default=float("inf"))
    if first_s * speed_m_s >= length_m:
        return None
    if first_s < 2.0:
        raise survey.InputError(
            f"a rover stops after {first_s:g} s, before it has recorded anything; let the fault begin later."
        )
    return Loss(0, first_s, first_s * speed_m_s)


def write_account(world: World, planned: survey.Route, mission: MissionConfig, folder: Path) -> None:
    """Write how a drive without images ended; a drive with images has written it."""
    loss = loss_on(planned, mission)
    driven = planned if loss is None else cut_short(planned, loss)
    taken = effort(driven.path(), mission.rover, world.terrain)
    length_m = float(sum(leg.length_m for leg in planned.legs))
    account = {
        "ending": (Ending.ARRIVED if loss is None else Ending.STALLED).value,
        "progress_m": round(length_m if loss is None else loss.progress_m, 2),
        "route_m": round(length_m, 2),
        "duration_s": float(driven.length_m / mission.rover.speed_m_s),
        "energy_j": round(taken.energy_j, 1),
    }
    write_json(folder / DRIVE_FILE, account)


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
            steering=steering,
        )
    (route if steering is None else steering.driven()).write(folder / "driven_route.geojson")
    driven.write(folder)
    lidar = mission.sensors.lidar
    if lidar.beams:
        scans = scans_along(driven.truth.trajectory, driven.truth.dem, lidar, mission.seed)
        scans.write(folder / "recording" / table_file("lidar"))


def _steering_on_the_way(
    route: survey.Route, world: World, mission: MissionConfig, edge_m: float
) -> WaypointSteering | None:
    """Return what chooses the path while the rover drives, off the terrain's edge; None for patterns that are fixed before."""
    steering = planners.steering_of(mission.planner)
    if steering is None:
        return None
    ground = drivable_area(world, mission).free.intersection(
        shapely.box(*world.terrain.bounds).buffer(-edge_m)
    )
    return WaypointSteering(route, steering, ground, stream(mission.seed, "steering"))


def drivable_area(world: World, mission: MissionConfig) -> survey.SurveyArea:
    """Return the ground that the rover may drive on, by the prior."""
    return planners.drivable(world.area, mission.rover, world.prior).within(world.area)


def steered(route: survey.Route, world: World, mission: MissionConfig) -> survey.Route:
    """Return the route as driven without images: steered patterns follow the attitude that the rover senses."""
    steering = planners.steering_of(mission.planner)
    if steering is None:
        return route
    sense = planners.attitude_sensor(world.terrain)
    if mission.fidelity == "statistical":
        sense = sensed_attitude(sense, mission)
    area = drivable_area(world, mission)
    return planners.rollout(area, route, steering, sense, [stream(mission.seed, "steering")])[0]


def estimate_drive(mission: MissionConfig, simulated: Path, folder: Path) -> None:
    """Estimate path and landmarks from a recording, and from nothing else; write the causal path too.

    Images that the onboard computer has looked at are not looked at again.
    """
    from vision_slam.odometry.onboard import read_visual_odometry

    recording = Recording.read(simulated / "recording")
    seen = simulated / "recording" / ONBOARD
    visual = read_visual_odometry(seen) if seen.exists() else None
    result = localized(recording, mission, visual)
    if result.ice_motion is not None:
        write_motion(result.ice_motion, folder / ICE_MOTION)
        in_fixed_frame(result.trajectory, result.ice_motion).write(folder / "trajectory_fixed.csv")
    if result.online_trajectory is not None:
        result.online_trajectory.write(folder / "online_trajectory.csv")
    result.trajectory.write(folder / "trajectory.tum")
    result.trajectory.write(folder / "trajectory.csv")
    result.points.write(folder / LANDMARKS)
    if recording.lidar is not None:
        register_scans(recording, result.trajectory, mission).write(folder / SCAN_POINTS)


def localized(
    recording: Recording, mission: MissionConfig, visual: VisualOdometry | None = None
) -> Localization:
    """Localize a recording, with the motion of the ice where the mission has moving ice."""
    if mission.ice is None:
        return vision_slam.localize(recording, mission.assumed, visual=visual)
    places = np.vstack([recording.start, recording.gps.position])[:, :2]
    prior = assumed_motion(
        mission.ice.assumed, epoch_of(recording, mission), places, recording.crs, path_of=mission.path
    )
    return vision_slam.localize_on_ice(recording, prior, mission.assumed, visual=visual)


def with_ice_motion(localized: Path, mapped: MappedTerrain, folder: Path) -> MappedTerrain:
    """Write the motion of the ice after the map of one drive, and return the map with its age; as it is on ice at rest."""
    if not (localized / ICE_MOTION).exists() or mapped.solution is None:
        return mapped
    motion = refined_motion(read_motion(localized / ICE_MOTION), mapped.solution)
    write_motion(motion, folder / ICE_MOTION)
    return mapped._replace(reconstruction=with_age(mapped.reconstruction, motion))


def register_scans(
    recording: Recording, path: survey.Trajectory, mission: MissionConfig
) -> survey.SurfacePoints:
    """Return the points that the scans of a recording become by the estimated path."""
    lidar = recording.lidar
    if lidar is None:
        raise survey.InputError(
            "the recording has no LiDAR scans; set sensors.lidar.beams and simulate again."
        )
    errors = BeamErrors.of(lidar.scanner)
    config = mission.reconstruction.scans
    return scan_points(lidar, path, errors, config=config, vertical_datum=recording.vertical_datum)


def mapped_points(localized: Path) -> survey.SurfacePoints:
    """Return the points of a drive that are mapped: those of its scans, or its landmarks where it has none."""
    scans = localized / SCAN_POINTS
    return survey.SurfacePoints.read(scans if scans.exists() else localized / LANDMARKS)


def path_scores(simulated: Path, localized: Path, mapped: Path) -> dict[str, Any]:
    """Judge the path of one drive against the truth: as localized, after the map's correction, and as known on the way."""
    truth = Truth.read(simulated / "truth")
    files = {
        "": localized / "trajectory.csv",
        "after_mapping_": mapped / "corrected_trajectory.csv",
        "online_": localized / "online_trajectory.csv",
    }
    scores: dict[str, Any] = {}
    for prefix, file in files.items():
        if file.exists():
            path = survey.Trajectory.read(file, truth.dem.crs)
            if (localized / ICE_MOTION).exists():
                path = in_fixed_frame(path, read_motion(localized / ICE_MOTION))
            found = vision_slam.trajectory_error(path, truth.trajectory).to_dict()
            scores |= {f"{prefix}{name}": value for name, value in found.items()}
    return scores
