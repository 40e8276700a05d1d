"""Commands that judge maps: ``score``, ``change`` and ``track``."""

import typer

from firnline import actions
from firnline.actions.interface import preview_of
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
@with_options_of(actions.ScoreRequest)
def score(request: actions.ScoreRequest, printing: Printing) -> None:
    """Judge a map against a reference or checkpoints: error statistics, coverage, map class.

    Large rasters are read in blocks. A standard whose conditions are not met gives no verdict.
    The exit code is 5 where checkpoints show that a wanted class is not met.

    For example:

      firnline score mine.tif --truth lidar.tif --area site.gpkg

      firnline score mine.tif --checkpoints gnss.csv --standard asprs-edition-2 --class 0.10

      firnline score mine.tif --checkpoints export.txt --columns x=Rechtswert,y=Hochwert,z=Hoehe,sigma_z=mH

      firnline score mine.tif --checkpoints gnss.csv --class 0.10 --report accuracy.pdf --language de

      firnline score mine.tif --truth lidar.tif --by slope --by landcover.tif

      firnline score mine.toml
    """
    if request.is_mission:
        request.refuse_options_of_maps()
        run_stages(request.source, request, "score", printing)
        return
    if printing.dry_run:
        print_result(preview_of(actions.score, request))
        return
    made = actions.score(request).write()
    if printing.as_json and made.written is not None:
        typer.echo(made.report_line, err=True)
    print_result(made, as_json=printing.as_json)


@with_exit_codes
@with_options_of(actions.ChangeRequest)
def change(request: actions.ChangeRequest, dry_run: DryRun = False, as_json: Json = False) -> None:
    """Compute the change of elevation, volume and mass on the ground, with correlated errors.

    For example:

      firnline change 2026.tif 2024.tif --outline glacier.gpkg

      firnline change 2026.tif srtm.tif --outline rgi.shp --density 900 --density-std 20

      firnline change 2026.tif 2024.tif --stable rock.gpkg

      firnline change 2026.tif 2024.tif --outline glacier.gpkg --report change.pdf

      firnline change 2026.tif 2024.tif --outline glacier.gpkg --flow track --thickness 80

      firnline change 2026.laz 2024.laz --method m3c2 --registration 0.02
    """
    perform(actions.change, request, dry_run=dry_run, as_json=as_json)


@with_exit_codes
@with_options_of(actions.TrackRequest)
def track(request: actions.TrackRequest, dry_run: DryRun = False, quiet: Quiet = False) -> None:
    """Track the features of a moving surface between two surveys: displacements, velocities and their errors.

    Weak matches, and those that contradict their neighbours, are written with outlier = 1.

    For example:

      firnline track 2024.tif 2026.tif --days 730 -o velocity.gpkg
    """
    perform(actions.track, request, dry_run=dry_run, quiet=quiet)


COMMANDS = {SurveyStep.JUDGE: (score, change, track)}
"""Commands by the step of a survey that they belong to."""
