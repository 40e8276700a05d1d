"""Run of the mission of a plan, with its stages reported."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from desk.jobs.job import CancelledError, Job
from desk.runs.camera import watched_frames
from desk.runs.growth import growing_maps
from firnline.cli.mission_file import best_class, summary
from firnline.cli.progress import logged_to
from sim.mission.fleet import drive_folders
from sim.mission.runs import open_run, read_mission
from sim.mission.stages import run_mission
from survey.core.run_folder import STAGES, RunFolder
from survey.data.area import SurveyArea
from survey.data.trajectory import Trajectory
from survey.data.truth import Truth
from survey.reconstruction.gp.kernels import Kernel

_MOST_PLACES = 1500


def mission_run(mission_file: Path, kernel: Kernel | None, job: Job) -> dict[str, Any]:
    """Run a mission and report its stages, images, paths, and the map as it grows."""
    mission = read_mission(mission_file)
    run = open_run(mission, mission_file.parent / "runs")

    @contextmanager
    def watch(stage: str) -> Iterator[None]:
        job.report("stage", stage=stage, done=STAGES.index(stage), total=len(STAGES))
        is_seen = stage == "simulate" and mission.fidelity == "vision"
        with watched_frames(run.path, lambda frame: _show(frame, job)) if is_seen else nullcontext():
            yield
        if stage == "localize":
            _report_drive(run, kernel, job)

    with logged_to(run.log_file, 0):
        run_mission(mission, run, watch=watch, workers=1)
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
