"""Report page of a mission, made from its run folder alone."""

from importlib.metadata import version
from pathlib import Path

import numpy as np

import survey
from sim.mission.qgis_project import write_run_project
from sim.simulate.preview import animated
from survey.core.arrays import FloatArray
from survey.core.documents import read_json
from survey.core.runs.store import RunFolder
from survey.data.recording import Recording
from survey.data.truth import Truth
from survey.io.tables import read_table
from survey.reporting import OnBoard, SurveyResults, write_report
from vision_slam.plotting import tracks_on_frames


def write_mission_report(folder: Path, run: RunFolder) -> Path:
    """Write ``index.html`` and its figures into `folder`; return the page."""
    plan, localized = run.folder("plan"), run.folder("localize")
    truth = Truth.read(run.folder("simulate") / "truth")
    reconstruction = survey.Reconstruction.read(run.folder("reconstruct"))
    area = survey.SurveyArea.read(plan / "area.gpkg")
    route = survey.Route.read(run.folder("simulate") / "driven_route.geojson")
    localization = run.folder("score") / "localization.json"
    surveyed = SurveyResults(
        area=area,
        prior=survey.Dem.read(plan / "prior.tif"),
        truth=truth.dem,
        route=route,
        reconstruction=reconstruction,
        score=survey.Score.from_dict(read_json(run.folder("score") / "score.json", "the score")),
        trajectory=survey.Trajectory.read(localized / "trajectory.csv", truth.dem.crs),
        reference_trajectory=truth.trajectory,
        points=survey.SurfacePoints.read(localized / "surface_points.gpkg"),
        on_board=_on_board(run.folder("simulate")),
    )
    page = write_report(
        folder,
        surveyed,
        title=run.path.parent.name,
        localization=read_json(localization, "the localization error") if localization.exists() else None,
        config_text=run.config_text(),
        provenance=_provenance(run),
    )
    write_run_project(folder / "run.qgz", run, reconstruction)
    return page


def _on_board(simulated: Path) -> OnBoard | None:
    """Return what there is to show of a drive that has images."""
    recording = Recording.read(simulated / "recording")
    if recording.frames is None:
        return None
    return OnBoard(
        tracks=tracks_on_frames(recording),
        video=animated(recording.frames),
        estimated=_estimated_on_board(simulated / "believed.csv"),
    )


def _estimated_on_board(file: Path) -> FloatArray | None:
    """Return the places (N, 2) [m] that the rover steered by, if it did."""
    if not file.exists():
        return None
    table = read_table(file, ("easting_m", "northing_m"), what="the path estimated on board")
    return np.column_stack([table["easting_m"], table["northing_m"]])


def _provenance(run: RunFolder) -> dict[str, str]:
    manifest = run.manifest
    facts = {
        "firnline": version("firnline"),
        "seed": str(manifest["seed"]),
        "configuration": manifest["config_sha256"],
    }
    return facts | {f"input {name}": digest for name, digest in manifest["inputs_sha256"].items()}
