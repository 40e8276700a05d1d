"""``firnline plan``: a route for an area, with a picture and what is expected of it."""

from firnline.actions.plan_request import PlanRequest, PlanResult
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import Printing, print_result, with_options_of
from firnline.cli.stages import run_stages


@with_exit_codes
@with_options_of(PlanRequest)
def plan(request: PlanRequest, printing: Printing) -> None:
    """Plan the route of a survey.

    Every setting of the sections planner, rover and fleet of a mission file can be set with --set. Ground
    that the rover cannot reach is left out; a warning gives its share, places and reasons. Distances are
    metres on the ground. An existing route or picture is replaced with --force only.

    For example:

      firnline plan site.geojson --prior srtm.tif --swaths 6 -o route.geojson

      firnline plan site.kml --prior srtm.tif --pattern wavy --spacing 50 --max-slope 20

      firnline plan area.kml --prior copernicus.tif -o plan.pdf

      firnline plan site.geojson --no-go map/no_go.tif --swaths 6

      firnline plan site.gpkg --spacing 20 --rovers 3 --set rover.turn_radius_m=2 --set rover.battery_j=4e6

      firnline plan site.gpkg --prior srtm.tif --require class-3 --probability 0.9

      firnline plan glacier.gpkg --prior glo30.tif --require class-3 --surface bare-ice --max-swaths 60

      firnline plan site.gpkg --prior srtm.tif --require class-3 --joint --set aids.base_station=true

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive -o first_two.geojson

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive --driven so_far.geojson --measured so_far.csv

      firnline plan glacier.gpkg --prior glo30.tif --season 0.3 --dates 2026-05-01,2026-09-20 --surface bare-ice

      firnline plan mine.toml

      firnline plan mine.toml --require class-3
    """
    from firnline.actions.planning import mode_of, plan, preview_plan
    from firnline.cli.progress import counted

    if request.is_mission and (printing.dry_run or request.require is None):
        mode_of(request)
        run_stages(request.source, request, "plan", printing)
        return
    if printing.dry_run:
        print_result(preview_plan(request))
        return
    with counted(quiet=printing.quiet) as progress:
        made = plan(request, progress)
    print_result(made.write() if isinstance(made, PlanResult) else made, as_json=printing.as_json)
