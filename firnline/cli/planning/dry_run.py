"""``firnline plan --dry-run``: read and check everything, and state what would be done, without writing."""

from typing import Any, NoReturn

from firnline.cli.facts import end_dry_run
from firnline.cli.planning.request import PlanRequest


def print_plan_of(request: PlanRequest) -> NoReturn:
    """Check the inputs of a plan and print what the command would do."""
    if request.is_mission:
        from firnline.cli.mission_file import print_stages_of

        print_stages_of(request.source, request, until="plan")
    end_dry_run(request.files.values(), _facts(request))


def _facts(request: PlanRequest) -> dict[str, Any]:
    from survey.core.map_scale import ground_area_m2
    from survey.core.text import area_text

    pattern, config = "chosen for the guarantee" if request.season is None else "chosen for the season", None
    if request.require is None and request.season is None:
        from firnline.cli.planning.area import checked_options

        config = checked_options(request)
        pattern = f"{config.planner.pattern}, {config.fleet.rovers} rover{'s' * (config.fleet.rovers > 1)}"
    area, prior = request.read_area()
    if config is not None:
        from planners.routes.rover import Crew, homes_of

        homes_of(area, Crew(config.rover, config.fleet))
    facts = {
        "area": f"{request.source}, {area_text(ground_area_m2(area.crs, area.polygon))}, {area.crs.name}",
        "pattern": pattern,
    }
    if prior is not None:
        rows, columns = prior.shape
        facts["prior"] = f"{request.prior}, {rows} × {columns} cells of {prior.step_m:g} m"
    return facts
