"""``firnline score``: errors, coverage and class of a map against a reference or checkpoints."""

from typing import NoReturn

from firnline.actions.interface import end_dry_run
from firnline.actions.scoring import (
    ScoreRequest,
    map_of,
    read_checkpoints,
    score_against_raster,
    score_at_checkpoints,
)
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of


@with_exit_codes
@with_options_of(ScoreRequest)
def score(request: ScoreRequest) -> None:
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
        from firnline.actions.missions import print_summary, run_until

        request.refuse_options_of_maps()
        _, run = run_until(request.source, "score", request)
        print_summary(run, as_json=request.as_json)
        return
    request.check()
    if request.dry_run:
        _end_dry_run(request)
    if request.checkpoints is None:
        score_against_raster(request)
    else:
        score_at_checkpoints(request, map_of(request.source, request.crs, request.epoch_s))


def _end_dry_run(request: ScoreRequest) -> NoReturn:
    """Read the map and what it is judged by, and print both."""
    from survey import Dem

    map_ = map_of(request.source, request.crs, request.epoch_s)
    dem = map_ if isinstance(map_, Dem) else map_.mean
    facts = {"map": "{} × {} cells".format(*dem.shape)}
    if request.checkpoints is None:
        assert request.truth is not None
        facts["reference"] = "{} × {} cells".format(*Dem.read(request.truth, crs=request.crs).shape)
    else:
        facts["checkpoints"] = str(len(read_checkpoints(request, dem).names))
    end_dry_run([] if request.report is None else [request.report], facts)
