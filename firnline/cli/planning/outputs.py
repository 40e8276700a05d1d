"""Files that ``firnline plan`` writes: a route with its picture, or plan sheets with route and standard deviation."""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firnline.cli.facts import fact_line
from firnline.cli.planning.drawing import PlanDrawing
from firnline.cli.planning.qgis_project import write_plan_project
from firnline.cli.planning.request import PlanRequest

if TYPE_CHECKING:
    import planners
    import survey
    from survey.figures.sheets import PlanContent, RoverEffort


def write_plan(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:
    """Write the files of a plan; all replace what was there, or none does."""
    if request.out.suffix.lower() == ".pdf":
        _write_sheets(request, route, drawing)
    elif request.out.suffix.lower() == ".qgz":
        write_plan_project(request, route, drawing)
    else:
        _write_route(request, route, drawing)


def plan_facts(request: PlanRequest, route: "survey.Route") -> dict[str, Any]:
    """Return files, counts and predictions of a plan, for ``--json``."""
    from planners.swaths.reference_lines import count_lines

    return (
        request.written | {"lines": count_lines(route), "swaths": len(route.swaths)} | dict(route.prediction)
    )


def fact_lines(prediction: Mapping[str, float]) -> list[str]:
    """Return what is expected of a route as lines for people, in hours, kilometres and kilowatt-hours."""
    return [fact_line(title, text) for title, text in fact_texts(prediction).values()]


def fact_texts(prediction: Mapping[str, float]) -> dict[str, tuple[str, str]]:
    """Return title and text of each number that is expected of a route, by its name."""
    from survey.core.text import duration_text, energy_text, length_text

    texts = {
        "length_m": ("length", length_text),
        "n_turns": ("turns", "{:.0f}".format),
        "time_s": ("time", duration_text),
        "energy_j": ("energy", energy_text),
        "n_recharges": ("recharges", "{:.0f}".format),
        "transit_share": ("transit", "{:.1%} of the swaths' length".format),
        "left_out_share": ("left out", "{:.1%} of the area".format),
        "rmse_m": ("predicted RMSE", "{:.2f} m".format),
        "map_scale": ("scale of the CRS", "{:.6f}".format),
        "prior_covered_share": ("prior", "covers {:.1%} of the area".format),
    }
    rows = {}
    for name, value in prediction.items():
        title, text = texts.get(name, (name.replace("_", " ").removesuffix(" m"), "{:.4g}".format))
        if name.startswith("wait_s_rover_"):
            title, text = f"rover {int(name.rsplit('_', 1)[1]) + 1} departs after", duration_text
        rows[name] = (title, text(value))
    return rows


def _write_route(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:
    from survey.core.replacement import replacing_files
    from survey.figures import plan_map
    from survey.figures.style import png_bytes

    pieces = [piece.polygon for piece in drawing.left_out]
    figure = plan_map(drawing.area, route, terrain=drawing.terrain, std=drawing.std(route), left_out=pieces)
    with replacing_files(request.out, request.files["picture"]) as (route_file, picture_file):
        route.write(route_file)
        picture_file.write_bytes(png_bytes(figure))


def _write_sheets(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:
    from survey.core.replacement import replacing_files
    from survey.figures.page_layout import pdf_bytes
    from survey.figures.sheets import plan_sheets

    std = drawing.std(route, drawing.fine_cell_m)
    content = _content(request, route, drawing, std)
    pdf = pdf_bytes(plan_sheets(content), content.title)
    files = [request.files["sheets"], request.files["route"]]
    with replacing_files(*files, *([request.files["sigma"]] if std is not None else [])) as drafts:
        drafts[0].write_bytes(pdf)
        route.write(drafts[1])
        if std is not None:
            std.write(drafts[2], "sigma_m")


def _content(
    request: PlanRequest, route: "survey.Route", drawing: PlanDrawing, std: "survey.Dem | None"
) -> "PlanContent":
    """Return what the sheets of a plan state."""
    import planners
    from planners.swaths.reference_lines import swaths_text
    from survey.figures.sheets import PlanContent

    rover = drawing.rover or planners.Rover()
    efforts = tuple(_effort(route, k, rover, drawing.terrain) for k in range(route.n_rovers))
    return PlanContent(
        request.source.stem,
        f"{datetime.now(UTC):%d %B %Y}",
        drawing.area,
        route,
        efforts,
        swaths_text(route),
        route.prediction.get("time_s", max(effort.time_s for effort in efforts)),
        drawing.terrain,
        std,
        tuple((piece.polygon, piece.reason) for piece in drawing.left_out),
        (*_rover_assumptions(rover, drawing.terrain, request.prior), *drawing.assumptions),
    )


def _effort(
    route: "survey.Route", k: int, rover: "planners.Rover", terrain: "survey.Dem | None"
) -> "RoverEffort":
    from planners.routes.rover import effort
    from survey.figures.sheets import RoverEffort

    own = effort(route.path(k), rover, terrain, crs=route.crs)
    batteries = None if rover.battery_j is None else own.energy_j / rover.battery_j
    return RoverEffort(*own, batteries)


def _rover_assumptions(
    rover: "planners.Rover", terrain: "survey.Dem | None", prior: Path | None
) -> list[str]:
    """Return in sentences what time and energy rest on."""
    slopes = "level ground" if terrain is None else f"slopes of {prior.name if prior else 'the prior'}"
    sentences = [
        f"Time and energy: {rover.speed_m_s:g} m/s, {rover.turn_s:g} s for a turn, {rover.mass_kg:g} kg, rolling resistance "
        f"{rover.rolling_resistance:g}, efficiency {rover.efficiency:g}, {rover.idle_w:g} W at rest; {slopes}."
    ]
    if terrain is not None:
        sentences.append(
            f"Terrain: {prior.name if prior else 'prior'}, cells of {terrain.step_m:g} m, "
            f"{terrain.vertical_datum or 'vertical datum not stated'}."
        )
    return sentences
