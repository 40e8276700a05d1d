"""``firnline reconstruct``: a map from measured points or LiDAR scans."""

import typer

from firnline.actions.requests import ReconstructRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import Printing, print_result, with_options_of
from firnline.cli.stages import run_stages


@with_exit_codes
@with_options_of(ReconstructRequest)
def reconstruct(request: ReconstructRequest, printing: Printing) -> None:
    """Reconstruct terrain from points, with its standard deviation.

    Settings of the methods are those of a mission: --set reconstruction.gp.family=matern-3/2.

    For example:

      firnline reconstruct landmarks.csv --crs EPSG:32608 --prior srtm.tif --grid 2 --area site.gpkg

      firnline reconstruct cloud.laz --method tin -o map

      firnline reconstruct surface_points.gpkg --method joint --trajectory trajectory.csv

      firnline reconstruct a/points.gpkg b/points.gpkg --method joint --trajectory a/path.csv --trajectory b/path.csv

      firnline reconstruct scans/ --method field --rays --max-slope 20 --crs EPSG:32608 --sigma 0.03

      firnline reconstruct recording --trajectory trajectory.csv --crs EPSG:32608 --grid 2

      firnline reconstruct survey/*.laz --tiles --workers 2 --control gnss.csv

      firnline reconstruct mine.toml
    """
    if request.is_mission:
        run_stages(request.sources[0], request, "reconstruct", printing)
    elif request.tiles:
        _map_in_tiles(request, printing)
    else:
        _map(request, printing)


def _map(request: ReconstructRequest, printing: Printing) -> None:
    from firnline.actions.mapping import preview_reconstruction, reconstruct
    from firnline.cli.progress import counted

    if printing.dry_run:
        print_result(preview_reconstruction(request))
        return
    with counted(quiet=printing.quiet) as progress:
        made = reconstruct(request, progress)
    print_result(made.write(), as_json=printing.as_json)


def _map_in_tiles(request: ReconstructRequest, printing: Printing) -> None:
    from firnline.actions.tiled_mapping import map_in_tiles, preview_tiles
    from firnline.cli.progress import counted

    if printing.dry_run:
        print_result(preview_tiles(request))
        return

    def announce(line: str) -> None:
        if not printing.quiet:
            typer.echo(line, err=True)

    with counted(quiet=printing.quiet) as progress:
        made = map_in_tiles(request, progress, announce)
    print_result(made.write(), as_json=printing.as_json)
