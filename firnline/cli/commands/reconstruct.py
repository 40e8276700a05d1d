"""``firnline reconstruct``: a map from measured points or LiDAR scans."""

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from firnline.actions.mapping_request import ReconstructOptions
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from firnline.actions.mapping_request import MapRequest


@with_exit_codes
@with_options_of(ReconstructOptions)
def reconstruct(options: ReconstructOptions) -> None:
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
    if options.sources[0].suffix == ".toml":
        from firnline.actions.missions import print_summary, run_until

        _, run = run_until(options.sources[0], "reconstruct", options)
        print_summary(run, as_json=options.as_json)
        return
    if options.tiles:
        from firnline.actions.tiled_mapping import map_tiled

        map_tiled(options)
        return
    _refuse_without_tiles(options)
    _refuse_max_slope(options.max_slope_deg, rays=options.rays)
    _map(options)


def _map(options: ReconstructOptions) -> None:
    """Check input and output, make the map, write and print it."""
    from firnline.actions.files import refuse_existing
    from firnline.actions.mapping import OWN_FILES, map_points, map_scan_files, print_map, write_map
    from firnline.actions.mapping_request import map_request

    request = map_request(options)
    refuse_existing([options.out], force=options.force, inputs=request.inputs, own=OWN_FILES)
    if options.dry_run:
        _end_dry_run(request, options.out)
    made = map_scan_files(request) if request.is_of_scans else map_points(request)
    write_map(made, options.out, rays=request.config.rays, max_slope_deg=options.max_slope_deg)
    print_map(made, options.out, as_json=options.as_json)


def _end_dry_run(request: "MapRequest", out: Path) -> NoReturn:
    """Read and check all input, and print what would be mapped."""
    from firnline.actions.interface import end_dry_run
    from firnline.actions.mapping import read_inputs
    from survey.interchange.scans import scan_files

    if request.is_of_scans:
        facts = {"scans": f"{len(scan_files(request.options.sources))} files"}
    else:
        facts = read_inputs(request).facts
    end_dry_run([out], {"method": request.method.name, **facts})


def _refuse_without_tiles(options: ReconstructOptions) -> None:
    from survey.core.errors import InputError

    given = {"--workers": options.workers, "--scheduler": options.scheduler, "--control": options.control}
    for name, value in given.items():
        if value is not None:
            raise InputError(f"{name} is of maps in tiles; add --tiles, or leave {name} out.")


def _refuse_max_slope(max_slope_deg: float | None, *, rays: bool) -> None:
    from survey.core.errors import InputError

    if max_slope_deg is not None and not rays:
        raise InputError("steep ground is found from the map's bounds; add --rays to --max-slope.")
