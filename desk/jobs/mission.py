"""Run of the mission of a plan: its stages, the latest image, and the map as it grows."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from desk.jobs.job import CancelledError, Job
from desk.runs import map_layers
from firnline.actions.runs import logged_to, summary
from firnline.actions.scoring import best_class
from sim.mission.fleet import drive_folders
from sim.mission.runs import open_run, read_mission
from sim.mission.stages import run_mission
from sim.world.site import SharedWorld
from survey import (
    GaussianProcessConfig,
    Grid,
    Route,
    SurfacePoints,
    SurveyArea,
    Trajectory,
    Truth,
    reconstruct,
)
from survey.core.arrays import IntArray
from survey.core.run_folder import STAGES, RunFolder
from survey.reconstruction.gp.kernels import Kernel

_MOST_PLACES = 1500


def mission_run(mission_file: Path, kernel: Kernel | None, job: Job) -> dict[str, Any]:
    """Run a mission and report its stages, images, paths, and the map as it grows."""
    mission = read_mission(mission_file)
    world = SharedWorld(mission)
    run = open_run(mission, mission_file.parent / "runs", world=world)

    @contextmanager
    def watch(stage: str) -> Iterator[None]:
        job.report("stage", stage=stage, done=STAGES.index(stage), total=len(STAGES))
        is_seen = stage == "simulate" and mission.fidelity == "vision"
        with watched_frames(run.path, lambda frame: _show(frame, job)) if is_seen else nullcontext():
            yield
        if stage == "localize":
            _report_drive(run, kernel, job)

    with logged_to(run.log_file, 0):
        run_mission(mission, run, watch=watch, workers=1, world=world)
    content = summary(run)
    job.files["report"] = run.folder("report")
    score = content["score"]
    return {
        "run": content["run"],
        "rmse_m": score["elevation"]["rmse_m"],
        "verdict": best_class(score),
        "report": f"/api/jobs/{job.name}/report/index.html",
        "project": str(run.folder("report") / "run.qgz"),
        "claims": content.get("own_claim", []),
    }


def _show(frame: Path, job: Job) -> None:
    """Report an image; a job that was given up takes none."""
    with suppress(CancelledError, OSError):
        job.files["frame"] = frame.read_bytes()
        job.report("frame", number=int(frame.stem))


def _report_drive(run: RunFolder, kernel: Kernel | None, job: Job) -> None:
    """Report true and estimated paths, and the map after some of the swaths."""
    area = SurveyArea.read(run.folder("plan") / "area.gpkg")
    true = [Truth.read(place / "truth").trajectory for place in drive_folders(run.folder("simulate"))]
    files = [place / "trajectory.csv" for place in drive_folders(run.folder("localize"))]
    estimated = [Trajectory.read(file, area.crs) for file in files]
    job.report("driven", estimated=_places(estimated), true=_places(true))
    for grown in growing_maps(run, kernel) if kernel is not None else ():
        job.report("grown", **grown)


def _places(paths: Sequence[Trajectory]) -> list[list[list[float]]]:
    """Return the places of paths, thinned for the map."""
    places = [path.position[:, :2] for path in paths]
    return [path[:: max(1, len(path) // _MOST_PLACES)].round(2).tolist() for path in places]


_MOST_MAPS = 12
_MOST_POINTS = 700
_NODES_ALONG = 36
_SAMPLE_STEP_M = 2.0


def growing_maps(run: RunFolder, kernel: Kernel) -> Iterator[dict[str, Any]]:
    """Map the landmarks of the first swaths, and of more swaths each time, on a coarse grid.

    Yields: ``swaths`` that were driven ``of`` all, and the pictures ``elevation`` and ``sigma``. The final
    map of the run is made from all landmarks and finer.
    """
    area = SurveyArea.read(run.folder("plan") / "area.gpkg")
    route = Route.read(run.folder("simulate") / "driven_route.geojson")
    places = drive_folders(run.folder("localize"))
    parts = [SurfacePoints.read(place / "surface_points.gpkg") for place in places]
    xyz, sigma = np.vstack([part.xyz for part in parts]), np.concatenate([part.sigma_z for part in parts])
    swath = _swath_of(route, xyz[:, :2])
    xmin, ymin, xmax, ymax = area.bounds
    grid = Grid.over(area.bounds, max(xmax - xmin, ymax - ymin) / _NODES_ALONG, area.crs)
    config = GaussianProcessConfig(fit=False, kernel=kernel)
    n_swaths = len(route.swaths)
    for n in np.unique(np.linspace(1, n_swaths, min(n_swaths, _MOST_MAPS)).round().astype(int)):
        chosen = np.flatnonzero(swath < n)
        chosen = chosen[:: max(1, -(-len(chosen) // _MOST_POINTS))]
        if len(chosen) < 3:
            continue
        points = SurfacePoints(xyz[chosen], sigma_m=sigma[chosen], crs=area.crs)
        map_ = reconstruct(points, grid, method="dense", config=config, area=area)
        yield {"swaths": int(n), "of": n_swaths, **map_layers(map_)}


def _swath_of(route: Route, xy: Any) -> IntArray:
    """Return for each place the number of the swath, in driving order, that passes it nearest."""
    samples, owner = [], []
    for k, leg in enumerate(route.swaths):
        along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(leg.xy, axis=0).T))]
        at = np.linspace(0.0, along[-1], max(2, int(along[-1] / _SAMPLE_STEP_M)))
        samples.append(np.column_stack([np.interp(at, along, leg.xy[:, axis]) for axis in (0, 1)]))
        owner.append(np.full(len(at), k))
    nearest = cKDTree(np.vstack(samples)).query(xy)[1]
    numbers: IntArray = np.concatenate(owner)[nearest]
    return numbers


_EVERY_S = 0.7


@contextmanager
def watched_frames(place: Path, report: Callable[[Path], None]) -> Iterator[None]:
    """Report new images below a folder while the body runs."""
    ended = Event()

    def follow() -> None:
        shown: Path | None = None
        while not ended.wait(_EVERY_S):
            frame = latest_frame(place)
            if frame is not None and frame != shown:
                shown = frame
                report(frame)

    thread = Thread(target=follow, name="desk-camera", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def latest_frame(place: Path) -> Path | None:
    """Return the last image but one below a folder, which is complete; None where there are fewer than two."""
    frames = sorted(place.glob("**/frames/*.png"))
    return frames[-2] if len(frames) > 1 else None
