"""``firnline plan -o plan.qgz``: a QGIS project with the route, the area, the terrain and the predicted error."""

from pathlib import Path
from typing import TYPE_CHECKING

from firnline.cli.planning.drawing import PlanDrawing
from firnline.cli.planning.request import PlanRequest

if TYPE_CHECKING:
    import survey
    from survey.reporting.qgis import QgisGroup


def write_plan_project(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:
    """Write the project with its layers: route, area, and, where given, terrain and predicted error. All files are written or none."""
    from survey.core.replacement import replacing_files
    from survey.reporting.qgis import write_project

    std = drawing.std(route, drawing.fine_cell_m)
    rasters = {"sigma": std, "terrain": drawing.terrain}
    known = {name: raster for name, raster in rasters.items() if raster is not None}
    names = ["project", "route", "area", *known]
    files = {name: request.files[name] for name in names}
    with replacing_files(*files.values()) as drafts:
        draft = dict(zip(names, drafts, strict=True))
        route.write(draft["route"])
        drawing.area.write(draft["area"])
        for name, raster in known.items():
            raster.write(draft[name], "sigma_m" if name == "sigma" else "elevation")
        groups = _groups(files, route, drawing, std)
        write_project(
            draft["project"],
            request.source.stem,
            groups,
            route.crs,
            drawing.area.bounds,
            place=files["project"],
        )


def _groups(
    files: dict[str, Path], route: "survey.Route", drawing: PlanDrawing, std: "survey.Dem | None"
) -> "tuple[QgisGroup, ...]":
    from survey.reporting.qgis import QgisGroup, QgisLayer, value_limits

    plan = [
        QgisLayer("Route", files["route"], "route", table="route", n_rovers=route.n_rovers),
        QgisLayer("Survey area", files["area"], "area", table="area"),
    ]
    if len(drawing.area.starts):
        plan.insert(0, QgisLayer("Starts", files["area"], "starts", table="area"))
    groups = [QgisGroup("Plan", tuple(plan))]
    if std is not None:
        limits = (0.0, value_limits(std.elevation)[1])
        layer = QgisLayer("Predicted standard deviation", files["sigma"], "deviation", limits=limits)
        groups.append(QgisGroup("Prediction", (layer,)))
    if drawing.terrain is not None:
        limits = value_limits(drawing.terrain.elevation)
        shade = QgisLayer("Hillshade", files["terrain"], "hillshade")
        groups.append(
            QgisGroup(
                "Prior terrain", (shade, QgisLayer("Elevation", files["terrain"], "elevation", limits=limits))
            )
        )
    return tuple(groups)
