"""``firnline score``: errors, coverage and class of a map against a reference or checkpoints."""

import typer

from firnline.actions.scoring import ScoreRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import Printing, print_result, with_options_of
from firnline.cli.stages import run_stages


@with_exit_codes
@with_options_of(ScoreRequest)
def score(request: ScoreRequest, printing: Printing) -> None:
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
    from firnline.actions import scoring

    if request.is_mission:
        request.refuse_options_of_maps()
        run_stages(request.source, request, "score", printing)
        return
    if printing.dry_run:
        print_result(scoring.preview_score(request))
        return
    made = scoring.score(request).write()
    if printing.as_json and made.written is not None:
        typer.echo(made.report_line, err=True)
    print_result(made, as_json=printing.as_json)
