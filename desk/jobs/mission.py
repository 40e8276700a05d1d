"""Run of the mission of a plan: its stages, the latest image, and the drive with its map as it grows."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from desk.jobs.job import CancelledError, Job
from desk.runs import layers_of
from firnline.actions.runs import logged_to, summary
from firnline.actions.scoring import best_class
from planners import prior_model
from sim.mission.fleet import drive_folders
from sim.mission.runs import open_run, read_mission
from sim.mission.stages import run_mission
from sim.world.site import SharedWorld
from survey import (
    Dem,
    GaussianProcessConfig,
    Grid,
    Route,
    SurfacePoints,
    SurveyArea,
    Trajectory,
    Truth,
    reconstruct,
)
from survey.core.arrays import FloatArray, IntArray
from survey.core.run_folder import STAGES, RunFolder
from survey.data.frames import Frames
from survey.reconstruction.gp.kernels import Kernel

_MOST_PLACES, _MOST_IMAGES = 1500, 400


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
            report_drive(run, kernel, job)

    is_driven = run.has("localize")
    with logged_to(run.log_file, 0):
        run_mission(mission, run, watch=watch, workers=1, world=world)
    if is_driven:
        report_drive(run, kernel, job)
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


def replayed_run(run: RunFolder, job: Job) -> dict[str, Any]:
    """Report the drive of a finished run, with the map as it grew.

    The covariance is fitted to the prior of the run, as for a plan. Returns: nothing.
    """
    job.report("stage", stage="fitting the covariance to the prior", done=0, total=2)
    place = run.folder("plan")
    model = prior_model(Dem.read(place / "prior.tif"), SurveyArea.read(place / "area.gpkg"))
    report_drive(run, None if model is None else model.posterior.likeliest.kernel, job)
    return {}


def report_drive(run: RunFolder, kernel: Kernel | None, job: Job) -> None:
    """Report true and estimated paths, when images were taken, and the map after some of the swaths."""
    area = SurveyArea.read(run.folder("plan") / "area.gpkg")
    simulated, localized = drive_folders(run.folder("simulate")), drive_folders(run.folder("localize"))
    paths = [Trajectory.read(place / "trajectory.csv", area.crs) for place in localized]
    job.files["images"] = [place / "recording" / "frames" for place in simulated]
    rovers = [
        _driven(path, Truth.read(place / "truth").trajectory) | {"images": _images(images)}
        for path, place, images in zip(paths, simulated, job.files["images"], strict=True)
    ]
    job.report("driven", rovers=rovers)
    for grown in growing_maps(run, paths, kernel) if kernel is not None else ():
        job.report("grown", **grown)


def _driven(path: Trajectory, true: Trajectory) -> dict[str, Any]:
    """Return times [s], estimated and true places [m], and the ellipse of 95 % of each: half axes [m] and the angle of the first [rad].

    The ellipse holds the share P of a normal distribution where its squared distance is −2 ln(1 − P).
    """
    kept = _spread(len(path), _MOST_PLACES)
    time_s = path.time_s[kept]
    real = [np.interp(time_s, true.time_s, true.position[:, axis]) for axis in (0, 1)]
    variances, axes = np.linalg.eigh(path.covariance[kept, :2, :2])
    half_m = np.sqrt(-2.0 * np.log(0.05) * variances.clip(0.0))
    ellipses = np.column_stack([half_m[:, ::-1], np.arctan2(axes[:, 1, 1], axes[:, 0, 1])])
    return {
        "time_s": time_s.round(2).tolist(),
        "places": path.position[kept, :2].round(2).tolist(),
        "true": np.column_stack(real).round(2).tolist(),
        "ellipses": ellipses.round(4).tolist(),
    }


def _spread(n: int, most: int) -> IntArray:
    """Return the numbers of at most so many of n items, the first and the last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def _images(folder: Path) -> list[list[float]]:
    """Return times [s] and numbers of images of a drive, thinned; none of a drive without images."""
    if not (folder / "frames.csv").exists():
        return []
    time_s = Frames.read(folder).time_s
    return [[round(float(time_s[k]), 2), int(k)] for k in _spread(len(time_s), _MOST_IMAGES)]


_MOST_MAPS = 12
_MOST_POINTS = 700
_NODES_ALONG = 36
_SAMPLE_STEP_M = 2.0


def growing_maps(run: RunFolder, paths: Sequence[Trajectory], kernel: Kernel) -> Iterator[dict[str, Any]]:
    """Map the landmarks of the first swaths, and of more swaths each time, on a coarse grid.

    `paths`: of each rover. Yields: ``swaths`` that were driven ``of`` all until ``time_s``, the expected ``rmse_m``, and the
    pictures ``elevation`` and ``sigma`` in the colours of the first one. The final map of the run is made from all
    landmarks and finer.
    """
    area = SurveyArea.read(run.folder("plan") / "area.gpkg")
    route = Route.read(run.folder("simulate") / "driven_route.geojson")
    places = drive_folders(run.folder("localize"))
    parts = [SurfacePoints.read(place / "surface_points.gpkg") for place in places]
    xyz, sigma = np.vstack([part.xyz for part in parts]), np.concatenate([part.sigma_z for part in parts])
    ended_s = np.array([_ended_s(paths[leg.rover], leg.xy[-1]) for leg in route.swaths])
    rank, ended_s = np.argsort(np.argsort(ended_s, kind="stable")), np.sort(ended_s)
    swath = rank[_swath_of(route, xyz[:, :2])]
    xmin, ymin, xmax, ymax = area.bounds
    grid = Grid.over(area.bounds, max(xmax - xmin, ymax - ymin) / _NODES_ALONG, area.crs)
    config = GaussianProcessConfig(fit=False, kernel=kernel)
    n_swaths, top_m = len(route.swaths), None
    for n in 1 + _spread(n_swaths, _MOST_MAPS):
        chosen = np.flatnonzero(swath < n)
        chosen = chosen[:: max(1, -(-len(chosen) // _MOST_POINTS))]
        if len(chosen) < 3:
            continue
        points = SurfacePoints(xyz[chosen], sigma_m=sigma[chosen], crs=area.crs)
        map_ = reconstruct(points, grid, method="dense", config=config, area=area)
        layers = layers_of(map_.mean, map_.std, top_m)
        top_m = layers["sigma"]["limits"][1]
        inside = map_.std.elevation.ravel()[area.contains(grid.xy)]
        rmse_m = float(np.sqrt(np.nanmean(inside**2)))
        yield {"time_s": float(ended_s[n - 1]), "swaths": int(n), "of": n_swaths, "rmse_m": rmse_m, **layers}


def _ended_s(path: Trajectory, end: FloatArray) -> float:
    """Return the time at which a path is nearest to the end (2,) of a swath [s]."""
    return float(path.time_s[np.argmin(np.hypot(*(path.position[:, :2] - end).T))])


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
