"""``firnline plan AREA``: a route as the options ask for it, with its picture."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    import planners
    import survey
    from survey.reconstruction.gp.covariance.kernels import Kernel


def read_area(
    source: Path, prior: Path | None, crs: str | None, no_go: Path | None
) -> "tuple[survey.SurveyArea, survey.Dem | None]":
    """Read the area, less the ground that a raster marks, and what is known of it, in one CRS."""
    import survey
    from planners.ground.traversability import without_marked

    dem = None if prior is None else survey.Dem.read(prior)
    area = survey.SurveyArea.read(source, crs=crs if dem is None or crs is not None else dem.crs)
    if dem is not None:
        area.require_crs(dem.crs, "the prior")
    if no_go is not None:
        area = without_marked(area, survey.Dem.read(no_go, mask=True))
    return area, dem


def plan_area(
    area: "survey.SurveyArea",
    dem: "survey.Dem | None",
    wanted: dict[str, Any],
    settings: list[str],
    out: Path,
    *,
    quiet: bool,
) -> "survey.Route":
    """Plan, and write the route and its picture."""
    import planners
    from sim.cli.progress import counted
    from survey.core.config import Section, validated, with_overrides

    class Wanted(Section):
        planner: planners.PlannerConfig
        rover: planners.Rover = planners.Rover()
        fleet: planners.Fleet = planners.Fleet()

    config = validated(Wanted, with_overrides(wanted, settings), "the options")
    with counted(quiet=quiet) as progress:
        progress("learning how the terrain varies", 0, 1)
        kernel = None if dem is None else _kernel(dem, area)
        progress("learning how the terrain varies", 1, 1)
        route = planners.plan(
            area,
            dem,
            config.planner,
            rover=config.rover,
            fleet=config.fleet,
            kernel=kernel,
            progress=progress,
        )
    route.write(out)
    _draw(route, area, dem, kernel, planners.drivable(area, config.rover, dem), out.with_suffix(".png"))
    return route


def _kernel(dem: "survey.Dem", area: "survey.SurveyArea") -> "Kernel | None":
    """Return the covariance that the prior speaks for; None, with the reason told, when it is too coarse."""
    import planners
    from survey.core.errors import InputError

    try:
        return planners.terrain_kernel(dem, area)
    except InputError as error:
        typer.echo(f"firnline: no error is predicted: {error}", err=True)
        return None


def _draw(
    route: "survey.Route",
    area: "survey.SurveyArea",
    dem: "survey.Dem | None",
    kernel: "Kernel | None",
    site: "planners.Drivable",
    path: Path,
) -> None:
    import planners
    from survey import figures
    from survey.core.files import replacing

    std = None
    if kernel is not None and "rmse_m" in route.prediction:
        std = planners.predict_error(route, area, kernel, noise_m=0.1).std
    pieces = [piece.polygon for piece in site.left_out]
    figure = figures.plan_map(area, route, terrain=dem, std=std, left_out=pieces)
    with replacing(path) as file:
        file.write_bytes(figures.png_bytes(figure))


def tell_route(route: "survey.Route", out: Path, *, as_json: bool) -> None:
    """Print what is expected of the route, for people or as JSON."""
    picture = out.with_suffix(".png")
    if as_json:
        content = {"route": str(out), "picture": str(picture), "length_m": route.length_m, **route.prediction}
        typer.echo(json.dumps(content, indent=2))
        return
    typer.echo(
        f"{len(route.swaths)} swaths, {route.length_m:.0f} m in all, written to {out}, drawn in {picture}"
    )
    for name, value in route.prediction.items():
        typer.echo(f"  predicted {name} = {value:.6g}")
