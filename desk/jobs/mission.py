"""Run of the mission of a plan, with its stages reported."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from desk.jobs.job import Job
from sim.cli.mission_file import best_class, summary
from sim.cli.progress import logged_to
from sim.mission.fleet import drive_folders
from sim.mission.runs import open_run, read_mission
from sim.mission.stages import run_mission
from survey.core.runs.store import STAGES, RunFolder
from survey.data.area import SurveyArea
from survey.data.trajectory import Trajectory

_MOST_PLACES = 1500


def mission_run(mission_file: Path, job: Job) -> dict[str, Any]:
    """Run a mission and report its stages.

    Parameters
    ----------
    mission_file : pathlib.Path
        As `write_mission` writes it; the runs are put beside it.
    job : Job
        Stages are reported to it; its files hold the folder of the report.

    Returns
    -------
    dict
        Score and class of the map, and the place of the run.

    Raises
    ------
    InputError, ConfigError
        What a stage refuses.
    """
    mission = read_mission(mission_file)
    run = open_run(mission, mission_file.parent / "runs")

    @contextmanager
    def watch(stage: str) -> Iterator[None]:
        job.report("stage", stage=stage, done=STAGES.index(stage), total=len(STAGES))
        yield
        if stage == "localize":
            job.report("driven", paths=_paths(run))

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
        "claims": content.get("own_claim", []),
    }


def _paths(run: RunFolder) -> list[list[list[float]]]:
    """Return each rover's estimated path, thinned for the map."""
    area = SurveyArea.read(run.folder("plan") / "area.gpkg")
    files = [place / "trajectory.csv" for place in drive_folders(run.folder("localize"))]
    places = [Trajectory.read(file, area.crs).position[:, :2] for file in files]
    return [path[:: max(1, len(path) // _MOST_PLACES)].round(2).tolist() for path in places]
