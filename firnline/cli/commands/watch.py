"""``firnline watch``: the map, its class and the next swath while a rover drives."""

import typer

from firnline.actions.watching import WatchRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import Quiet, print_result, with_options_of


@with_exit_codes
@with_options_of(WatchRequest)
def watch(request: WatchRequest, quiet: Quiet = False) -> None:
    """Follow a survey while it is driven: map, class with its probability, next swath, or stop.

    For example:

      firnline watch udp://127.0.0.1:14550 --area site.gpkg --route route.geojson --require 0.45 --log drive.jsonl

      firnline watch fixes.csv --area site.gpkg --route route.geojson --once

      firnline watch --replay drive.jsonl --log again.jsonl

    The survey may stop when the map meets the class with the probability. After every swath the covariance of the terrain
    is fitted again, and the swath is named after which fewest have to follow; between, the map is updated. Warnings are
    about a rover that is stuck or silent, and about the charge for the way home. Ends with exit code 5 where no further
    swath would reach the class. Telemetry needs firnline[live].
    """
    from firnline.actions import watching

    def show(line: str) -> None:
        if not quiet:
            typer.echo(line)

    print_result(watching.watch(request, show))
