"""``firnline export``: convert a route, map, track, area or set of points to the format of another program."""

from firnline.actions import exporting
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, print_result, with_options_of


@with_exit_codes
@with_options_of(exporting.ExportRequest)
def export(request: exporting.ExportRequest, dry_run: DryRun = False) -> None:
    """Write a file in the format that the other's ending names.

    For example:

      firnline export route.geojson survey.plan --autopilot ardupilot --area site.kml --dem prior.tif --speed 1.2

      firnline export results/runs/srtm-ridge/latest route.gpx

      firnline export results/runs/short-drive/latest drive.mcap

      firnline export map.tif map.asc

      firnline export trajectory.csv track.gpx --as track --crs EPSG:32608
    """
    if dry_run:
        print_result(exporting.preview_export(request))
    else:
        print_result(exporting.export(request).write())
