"""QGIS project of a run: plan, map with its standard deviation and support, prior and reference."""

from pathlib import Path

import survey
from sim.mission.drives import LANDMARKS, SCAN_POINTS
from sim.mission.fleet import drive_folders
from survey.core.runs.store import RunFolder
from survey.reporting.qgis import QgisGroup, QgisLayer, value_limits, write_project


def write_run_project(file: Path, run: RunFolder, reconstruction: survey.Reconstruction) -> None:
    """Write the project of a run; it refers to the files of its stages by relative paths.

    Parameters
    ----------
    file : pathlib.Path
        The project, in the folder of a stage.
    run : RunFolder
        All stages but the report are done.
    reconstruction : survey.Reconstruction
        The map of the run.
    """
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
