"""Report page and QGIS project of a mission, made from its run folder alone.

The page shows plan, paths, map and scores, with the provenance of the run. The QGIS project holds plan, map with its
standard deviation and support, prior and reference as layers.
"""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

import survey
from sim.mission.derived_maps import HAZARDS, PAYLOAD
from sim.mission.fleet import LOSS_FILE, drive_folders, n_ties
from sim.mission.localization import LANDMARKS, SCAN_POINTS, mapped_points
from sim.simulate.simulated_drive import DRIVE_FILE, animate_frames
from survey import Recording, Truth
from survey.core import FloatArray, read_json
from survey.core.run_folder import RunFolder
from survey.data.sensors.payload import Quantity
from survey.io.tables import read_table
from survey.reconstruction.joint.drives import SeveralDrives
from survey.reporting.page import write_report
from survey.reporting.qgis import QgisGroup, QgisLayer, value_limits, write_project
from survey.reporting.rendering import PNG, PictureForm
from survey.reporting.survey_results import (
    FleetResults,
    HazardResults,
    OnBoard,
    PayloadResults,
    RoverDrive,
    SurveyResults,
)
from vision_slam.plotting import tracks_on_frames


def write_mission_report(folder: Path, run: RunFolder, form: PictureForm = PNG, field_work: str = "") -> Path:
    """Write ``index.html`` and its figures into `folder`; return the page."""
    plan, simulated, localized = run.folder("plan"), run.folder("simulate"), run.folder("localize")
    places = drive_folders(simulated)
    truth = Truth.read(places[0] / "truth")
    reconstruction = survey.Reconstruction.read(run.folder("reconstruct"))
    localization = run.folder("score") / "localization.json"
    points = [mapped_points(place) for place in drive_folders(localized)]
    surveyed = SurveyResults(
        area=survey.SurveyArea.read(plan / "area.gpkg"),
        prior=survey.Dem.read(plan / "prior.tif"),
        truth=truth.dem,
        route=survey.Route.read(simulated / "driven_route.geojson"),
        reconstruction=reconstruction,
        score=survey.Score.from_dict(read_json(run.folder("score") / "score.json", "the score")),
        payload=_payload(run),
        hazard=_hazard(run),
        points=SeveralDrives.of([(part, None) for part in points]).points,
        points_name="Scan points" if any(localized.rglob(SCAN_POINTS)) else "Landmarks",
    )
    if len(places) > 1:
        surveyed = replace(surveyed, fleet=_fleet(run))
    else:
        surveyed = replace(
            surveyed,
            trajectory=survey.Trajectory.read(localized / "trajectory.csv", truth.dem.crs),
            reference_trajectory=truth.trajectory,
            on_board=_on_board(simulated),
        )
    page = write_report(
        folder,
        surveyed,
        title=run.path.parent.name,
        localization=read_json(localization, "the localization error") if localization.exists() else None,
        config_text=run.config_text(),
        provenance=_provenance(run),
        form=form,
        field_work=field_work,
    )
    write_run_project(folder / "run.qgz", run, reconstruction)
    return page


def _hazard(run: RunFolder) -> HazardResults | None:
    """Return the hazards of the map, where the rover has a largest slope."""
    place = run.folder("reconstruct") / HAZARDS
    if not place.exists():
        return None
    facts = read_json(place / "hazard.json", "the hazards")
    limit_deg = facts.pop("max_slope_deg")
    return HazardResults(
        probability=survey.Dem.read(place / "hazard.tif"), max_slope_deg=limit_deg, facts=facts
    )


def _payload(run: RunFolder) -> tuple[PayloadResults, ...]:
    """Return the maps of the payload's quantities, with their scores."""
    file = run.folder("score") / f"{PAYLOAD}.json"
    if not file.exists():
        return ()
    scores = read_json(file, "the scores of the payload")
    return tuple(
        PayloadResults(
            quantity=Quantity(name=name, unit=found.pop("unit"), noise_sd=0.0),
            mapped=survey.Reconstruction.read(run.folder("reconstruct") / PAYLOAD / name),
            scores=found,
        )
        for name, found in scores.items()
    )


def _fleet(run: RunFolder) -> FleetResults:
    """Return the drives of all rovers, and what losses cost."""
    simulated = run.folder("simulate")
    ties = n_ties(run.folder("localize"), len(drive_folders(simulated)))
    rovers = tuple(
        replace(_rover(run, place, place.relative_to(simulated)), n_ties=n)
        for place, n in zip(drive_folders(simulated), ties, strict=True)
    )
    file = simulated / LOSS_FILE
    if not file.exists():
        return FleetResults(rovers=rovers)
    losses = read_json(file, "the account of the losses")
    shown = ("swaths_not_driven_m", "extra_length_m", "extra_time_s")
    return FleetResults(rovers=rovers, losses={name: losses[name] for name in shown})


def _rover(run: RunFolder, simulated: Path, part: Path) -> RoverDrive:
    """Return the drive of one rover."""
    truth = Truth.read(simulated / "truth")
    account = read_json(simulated / DRIVE_FILE, "the account of the drive")
    errors = read_json(run.folder("score") / part / "localization.json", "the localization error")
    return RoverDrive(
        trajectory=survey.Trajectory.read(run.folder("localize") / part / "trajectory.csv", truth.dem.crs),
        reference_trajectory=truth.trajectory,
        ending=account["ending"],
        duration_s=account["duration_s"],
        energy_j=account["energy_j"],
        horizontal_rms_m=errors.get("horizontal_rms_m"),
        vertical_rms_m=errors.get("vertical_rms_m"),
    )


def _on_board(simulated: Path) -> OnBoard | None:
    """Return what there is to show of a drive that has images."""
    recording = Recording.read(simulated / "recording")
    if recording.frames is None:
        return None
    return OnBoard(
        tracks=tracks_on_frames(recording),
        video=animate_frames(recording.frames),
        estimated=_estimated_on_board(simulated / "estimated.csv"),
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


def write_run_project(file: Path, run: RunFolder, reconstruction: survey.Reconstruction) -> None:
    """Write the project of a run; it refers to the files of its stages by relative paths."""
    plan, simulated = run.folder("plan"), run.folder("simulate")
    area = survey.SurveyArea.read(plan / "area.gpkg")
    groups = (
        QgisGroup("Survey", tuple(_survey_layers(run, area))),
        QgisGroup("Map", tuple(_map_layers(run.folder("reconstruct"), reconstruction))),
        QgisGroup("Reference", tuple(_terrain_layers(drive_folders(simulated)[0] / "truth" / "dem.tif"))),
        QgisGroup("Prior", tuple(_terrain_layers(plan / "prior.tif"))),
    )
    write_project(file, run.path.parent.name, groups, area.crs, area.bounds)


def _survey_layers(run: RunFolder, area: survey.SurveyArea) -> list[QgisLayer]:
    driven, planned = run.folder("simulate") / "driven_route.geojson", run.folder("plan") / "route.geojson"
    n_rovers = survey.Route.read(planned).n_rovers
    file = run.folder("plan") / "area.gpkg"
    layers = [
        QgisLayer("Driven route", driven, "route", table="route", n_rovers=n_rovers),
        QgisLayer("Planned route", planned, "route", table="route", n_rovers=n_rovers, is_visible=False),
        QgisLayer("Survey area", file, "area", table="area"),
        *_point_layers(run.folder("localize")),
    ]
    return [QgisLayer("Starts", file, "starts", table="area"), *layers] if len(area.starts) else layers


def _point_layers(folder: Path) -> list[QgisLayer]:
    """Return the landmarks of each rover, and the points of its scans."""
    places = drive_folders(folder)
    shown = {LANDMARKS: "Surface points", SCAN_POINTS: "Scan points"}
    return [
        QgisLayer(
            name if len(places) == 1 else f"{name}, {place.name}",
            place / file,
            "points",
            table=Path(file).stem,
            is_visible=False,
        )
        for place in places
        for file, name in shown.items()
        if (place / file).exists()
    ]


def _map_layers(folder: Path, reconstruction: survey.Reconstruction) -> list[QgisLayer]:
    mean, std = (value_limits(dem.elevation) for dem in (reconstruction.mean, reconstruction.std))
    file = folder / "dem.tif"
    return [
        QgisLayer("Support", folder / "support.tif", "support", is_visible=False),
        QgisLayer("Standard deviation", file, "deviation", 2, (0.0, std[1]), is_visible=False),
        QgisLayer("Hillshade", file, "hillshade"),
        QgisLayer("Elevation", file, "elevation", 1, mean),
    ]


def _terrain_layers(file: Path) -> list[QgisLayer]:
    limits = value_limits(survey.Dem.read(file).elevation)
    return [
        QgisLayer("Hillshade", file, "hillshade", is_visible=False),
        QgisLayer("Elevation", file, "elevation", limits=limits, is_visible=False),
    ]
