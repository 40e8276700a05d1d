"""``firnline desk``: a page in the browser to draw a survey and see its predicted error."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.outcome import with_exit_codes


@with_exit_codes
def desk(
    source: Annotated[
        Path | None,
        typer.Argument(
            help="Raster of prior elevations, plan of the desk (.desk.json), mission file (.toml) or run folder; "
            "the latest plan of this folder when left out."
        ),
    ] = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port on 127.0.0.1; a free one by default.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address only; open no browser.")
    ] = False,
    demo: Annotated[
        bool,
        typer.Option("--demo", help="Begin with real sample elevations, in the folder firnline-desk-demo."),
    ] = False,
) -> None:
    """Draw a survey on the map of its terrain, see the predicted error, and take the route along.

    The page runs on this machine alone: it answers to 127.0.0.1, needs no network, and writes into the folder of
    the terrain. The plan is stored there at every edit. Ctrl+C ends the server. Needs firnline[desk].

    For example:

      firnline desk srtm.tif

      firnline desk --demo
    """
    from survey.core.errors import ConfigError, InputError

    if demo and source is not None:
        raise ConfigError(f"--demo brings its own terrain; leave out {source}.")
    try:
        from desk.server.serve import serve
    except ModuleNotFoundError as error:
        raise InputError(
            f"the desk needs {error.name}, which is not installed; install firnline[desk]."
        ) from error
    serve(source, port=port, opens_browser=not no_browser, demo=demo)
