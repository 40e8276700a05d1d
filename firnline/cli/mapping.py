"""Commands from a recording to a map: ``localize``, ``calibrate``, ``reconstruct``, ``extend``, ``overhangs``, ``payload`` and ``counts``."""

import typer

from firnline import actions
from firnline.actions.interface import preview_of
from firnline.actions.requests import (
    CountsRequest,
    ExtendRequest,
    OverhangsRequest,
    PayloadRequest,
    ReconstructRequest,
)
from firnline.cli.missions import run_stages
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import (
    DryRun,
    Json,
    Printing,
    Quiet,
    SurveyStep,
    perform,
    print_result,
    with_options_of,
)


@with_exit_codes
@with_options_of(actions.LocalizeRequest)
def localize(
    request: actions.LocalizeRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Estimate the path of a rover and its landmarks from a recording.

    For example:

      firnline localize results/runs/mine/latest/2-simulate/recording

      firnline localize KITTI_sequence_1 --scale-from 10

      firnline localize my-images --camera camera.toml --gps log.nmea

      firnline localize phone-photos --camera camera.toml --gps gnss_log.txt

      firnline localize drone-photos -o flight

      firnline localize video-frames --frame-rate 30 --gps fixes.csv --columns time=t,lat=phi,lon=lambda

      firnline localize my-images --gps track.gpx --set localization.landmark_thinning=information

      firnline localize glacier-drive --gps log.ubx --epoch 14400

      firnline localize drive.bag --topic /left/image_raw --viewer drive.rrd

    Written are trajectory.tum and health.csv, landmarks.csv, the pictures map.png and tracks.png,
    with fixes also trajectory.csv (covariances), online_trajectory.csv (the causal path),
    track.gpkg and landmarks.gpkg in their CRS, and with a reference errors.png. No landmarks are
    written where the fixes contradict the images so much that the path is that of the fixes. Without fixes the
    path is relative to the first image, and path.csv has its standard deviations. A folder of
    images takes its times from frames.csv (time_s,file), times.txt, the names of the files or
    EXIF, its calibration from camera.toml (see firnline calibrate) or the focal length in EXIF,
    positions in EXIF as fixes, and wheels.csv and inertial.csv where they are there.
    """
    perform(actions.localize, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


@with_exit_codes
@with_options_of(actions.CalibrateRequest)
def calibrate(
    request: actions.CalibrateRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Calibrate a camera from images of a chessboard or a ChArUco board.

    For example:

      firnline calibrate board-photos --board 9x6 --square-mm 25

      firnline calibrate board-photos --charuco 8x5 --square-mm 30 --marker-mm 22 --dictionary 5X5_100

      firnline localize my-images --camera camera.toml

    Take 15 to 30 sharp images of a flat board, with the focus and zoom of the survey: move it through all of the
    image, corners included, and tilt it by 20 to 45 degrees in several directions. Written are camera.toml, with
    the standard deviation of each parameter, and a picture of the residuals (camera.png). The mounting in it
    (T_body_camera) is level and forward until you correct it.
    """
    perform(actions.calibrate, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


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
    perform(
        actions.reconstruct, request, dry_run=printing.dry_run, as_json=printing.as_json, quiet=printing.quiet
    )


def _map_in_tiles(request: ReconstructRequest, printing: Printing) -> None:
    from firnline.cli.progress import counted

    if printing.dry_run:
        print_result(preview_of(actions.map_in_tiles, request))
        return

    def announce(line: str) -> None:
        if not printing.quiet:
            typer.echo(line, err=True)

    with counted(quiet=printing.quiet) as progress:
        made = actions.map_in_tiles(request, progress, announce)
    print_result(made.write(), as_json=printing.as_json)


@with_exit_codes
@with_options_of(ExtendRequest)
def extend(
    request: ExtendRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Map ground beyond the range of a scanner with the images of its drive.

    For example:

      firnline extend recording localization --prior srtm.tif

      firnline extend results/runs/mine/latest/2-simulate/recording results/runs/mine/latest/3-localize --reach 30 -o beyond

    Written are map.tif (elevation and standard deviation), orthoimage.tif (grey or colour), heights.gpkg (heights from images
    with their errors), extend.json (errors, and places where images contradict scans with their reasons), and the picture
    extended.png.
    """
    perform(actions.extend, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


@with_exit_codes
@with_options_of(OverhangsRequest)
def overhangs(
    request: OverhangsRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Estimate the surface of steep walls, undercuts and serac edges from LiDAR scans, with its standard deviation.

    A map of heights has one height over each place; this surface is a mesh and may have several.

    For example:

      firnline overhangs serac.ply

      firnline overhangs scans/ --crs EPSG:32608 --sigma 0.02 --scan-sigma 0.01 --area serac.gpkg

      firnline overhangs recording --trajectory localization/trajectory.csv --crs EPSG:32608 --area serac.gpkg -o serac

    Written are surface.ply (a mesh with the standard deviation along the normal and the support of each vertex), overhangs.json
    (areas, errors and sections), and the picture overhangs.png (a map, and vertical sections through the steepest places).
    """
    perform(actions.overhangs, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


@with_exit_codes
@with_options_of(PayloadRequest)
def payload(request: PayloadRequest, dry_run: DryRun = False, quiet: Quiet = False) -> None:
    """Map a quantity that was logged on a drive: a Gaussian process with elevation as covariate.

    For example:

      firnline payload weather.csv --name air_temperature --unit degC --lag 8 --trajectory localization/trajectory.csv --terrain map/dem.tif

      firnline payload albedo.csv --name albedo --unit 1 --terrain dem.tif --out albedo
    """
    perform(actions.payload, request, dry_run=dry_run, quiet=quiet)


@with_exit_codes
@with_options_of(CountsRequest)
def counts(
    request: CountsRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Map the intensity of radiation or of a plume from counts, and find its source.

    For example:

      firnline counts gamma.csv --crs EPSG:32608 --grid 2 --limit 30 --source radiation

      firnline counts methane.csv --crs EPSG:32608 --source plume --height 1 --area site.gpkg --out methane

      firnline counts so-far.csv --crs EPSG:32608 --source radiation --next-from 500010,6700020

    Written are intensity.tif (median), lower.tif and upper.tif (95 % interval) in counts per second, with --limit
    below_limit.tif (probability), counts.json, and the picture counts.png.
    """
    perform(actions.count_map, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


COMMANDS = {SurveyStep.MAP: (calibrate, localize, reconstruct, extend, overhangs, payload, counts)}
"""Commands by the step of a survey that they belong to."""
