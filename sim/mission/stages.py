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

import shapely
from threadpoolctl import threadpool_limits

import planners
import survey
import vision_slam
from planners.steering.waypoints import WaypointSteering
from sim.config.mission import MissionConfig
from sim.mission.versions import refuse_other_versions
from sim.simulate.aiding import with_way_home
from sim.simulate.ideal import simulate_ideal
from sim.simulate.sensed_attitude import sensed_attitude
from sim.simulate.simulated_drive import ONBOARD
from sim.simulate.statistical import simulate_statistical
from sim.world.site import World, build_world
from survey.core.arguments import check_types
from survey.core.documents import write_json
from survey.core.runs.store import STAGES, RunFolder
from survey.core.streams import stream
from survey.data.recording import Recording
from survey.data.truth import Truth
from survey.reconstruction.policy import map_landmarks

logger = logging.getLogger(__name__)

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
        Processes of a drive with images: with two the onboard computer works beside the
        simulation, to the same bytes. As many as this process may use cores, unless given.

    Raises
    ------
    InputError
        What a stage refuses, or a finished stage whose files were changed.
    """
    wanted = STAGES[: STAGES.index(until) + 1]
    _refuse_mixed_versions(run, wanted)
    n = len(os.sched_getaffinity(0)) if workers is None else workers
    stages = _STAGES | {"simulate": partial(simulate, workers=n)}
    with threadpool_limits(limits=1):  # one order of sums keeps the bytes, and spinning threads are slower
        for name in wanted:
            if run.has(name):
                run.verify(name)
                continue
            with watch(name), run.stage(name) as folder:
                stages[name](mission, run, folder)
            logger.info("finished the stage %s", name)


def _refuse_mixed_versions(run: RunFolder, wanted: Sequence[str]) -> None:
    """Refuse to add stages to those that other versions of the computing packages have made."""
    n_done = sum(run.has(name) for name in wanted)
    if 0 < n_done < len(wanted):
        remedy = "do all stages again with --fresh, or those from one stage on with --from STAGE"
        refuse_other_versions(run.manifest["versions"], f"the run {run.path}", remedy)


def plan(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Plan the route from the area and the prior alone."""
    world = build_world(mission)
    world.area.write(folder / "area.gpkg")
    world.prior.write(folder / "prior.tif")
    route = planners.plan(world.area, world.prior, mission.planner, rover=mission.rover, fleet=mission.fleet)
    if mission.aids.way_home:
        route = with_way_home(route, world.area)
    route.write(folder / "route.geojson")


def simulate(mission: MissionConfig, run: RunFolder, folder: Path, *, workers: int = 1) -> None:
    """Drive the route over the real terrain and record what the rover senses."""
    if mission.fleet.rovers > 1:
        raise survey.ConfigError(
            f"the simulation drives one rover, but fleet.rovers is {mission.fleet.rovers}; set it to 1, or end with firnline plan."
        )
    world = build_world(mission)
    route = survey.Route.read(run.folder("plan") / "route.geojson")
    if mission.fidelity == "vision":
        _drive_with_images(world, route, mission, folder, workers)
        return
    route = steered(route, world, mission)
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
    from sim.simulate.onboard.navigator_process import navigating
    from sim.simulate.vision import EDGE_M, simulate_vision

    steering = _steering_on_the_way(route, world, mission, EDGE_M)
    with navigating(mission, workers) as navigate:
        drive = simulate_vision(
            world.terrain,
            route,
            mission,
            folder / "recording",
            navigate,
            steers=mission.physics.steer_by == "estimate",
            steering=steering,
        )
    (route if steering is None else steering.driven()).write(folder / "driven_route.geojson")
    drive.write(folder)


def _steering_on_the_way(
    route: survey.Route, world: World, mission: MissionConfig, edge_m: float
) -> WaypointSteering | None:
    """Return what chooses the path while the rover drives, off the terrain's edge; None for patterns that are fixed before."""
    steering = planners.steering_of(mission.planner)
    if steering is None:
        return None
    ground = _drivable(world, mission).free.intersection(shapely.box(*world.terrain.bounds).buffer(-edge_m))
    return WaypointSteering(route, steering, ground, stream(mission.seed, "steering"))


def _drivable(world: World, mission: MissionConfig) -> survey.SurveyArea:
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
    area = _drivable(world, mission)
    return planners.rollout(area, route, steering, sense, [stream(mission.seed, "steering")])[0]


def estimate(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Estimate path and landmarks from the recording, and from nothing else; write the causal path too.

    Images that the onboard computer has looked at are not looked at again.
    """
    from vision_slam.odometry.onboard import read_visual_odometry

    recording = Recording.read(run.folder("simulate") / "recording")
    seen = run.folder("simulate") / "recording" / ONBOARD
    visual = read_visual_odometry(seen) if seen.exists() else None
    result = vision_slam.localize(recording, mission.assumed, visual=visual)
    if result.online_trajectory is not None:
        result.online_trajectory.write(folder / "online_trajectory.csv")
    result.trajectory.write(folder / "trajectory.tum")
    result.trajectory.write(folder / "trajectory.csv")
    result.points.write(folder / "surface_points.gpkg")


def reconstruct(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Map the terrain from the surface points and the prior; a joint map corrects the path too."""
    config = mission.reconstruction
    area = survey.SurveyArea.read(run.folder("plan") / "area.gpkg")
    points = survey.SurfacePoints.read(run.folder("localize") / "surface_points.gpkg")
    prior = survey.Dem.read(run.folder("plan") / "prior.tif") if config.use_prior else None
    grid = survey.Grid.over(area.bounds, config.grid_step_m, area.crs)
    path = survey.Trajectory.read(run.folder("localize") / "trajectory.csv", area.crs)
    mapped = map_landmarks(points, grid, config, prior=prior, path=path.error, area=area)
    mapped.reconstruction.write(folder)
    if mapped.correction is not None:
        mapped.correction.applied(path).write(folder / "corrected_trajectory.csv")


def score(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Judge the map and the path against the truth."""
    truth = Truth.read(run.folder("simulate") / "truth")
    judged = survey.score(
        survey.Reconstruction.read(run.folder("reconstruct")),
        truth=truth.dem,
        route=survey.Route.read(run.folder("simulate") / "driven_route.geojson"),
        area=survey.SurveyArea.read(run.folder("plan") / "area.gpkg"),
        sample_step_m=mission.score.sample_step_m,
    )
    write_json(folder / "score.json", judged.to_dict())
    trajectory = survey.Trajectory.read(run.folder("localize") / "trajectory.csv", truth.dem.crs)
    judged_path = vision_slam.trajectory_error(trajectory, truth.trajectory).to_dict()
    corrected = run.folder("reconstruct") / "corrected_trajectory.csv"
    if corrected.exists():
        after = vision_slam.trajectory_error(
            survey.Trajectory.read(corrected, truth.dem.crs), truth.trajectory
        )
        judged_path |= {f"after_mapping_{name}": value for name, value in after.to_dict().items()}
    online = run.folder("localize") / "online_trajectory.csv"
    if online.exists():
        known_then = vision_slam.trajectory_error(
            survey.Trajectory.read(online, truth.dem.crs), truth.trajectory
        )
        judged_path |= {f"online_{name}": value for name, value in known_then.to_dict().items()}
    write_json(folder / "localization.json", judged_path)


def report(mission: MissionConfig, run: RunFolder, folder: Path) -> None:
    """Put everything on one page."""
    from sim.mission.report import write_mission_report  # here, because matplotlib takes a second to import

    write_mission_report(folder, run)


_STAGES: dict[str, Callable[[MissionConfig, RunFolder, Path], None]] = {
    "plan": plan,
    "simulate": simulate,
    "localize": estimate,
    "reconstruct": reconstruct,
    "score": score,
    "report": report,
}
