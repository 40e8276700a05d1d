"""Options of ``firnline`` before the name of a command: the version."""

from typing import Annotated

import typer


def print_version(wanted: bool) -> None:
    """Print the version and leave, where it is asked for."""
    if wanted:
        from importlib.metadata import version

        typer.echo(f"firnline {version('firnline')}")
        raise typer.Exit


def options(
    _: Annotated[
        bool,
        typer.Option("--version", callback=print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Plan, simulate and judge robotic surveys of glaciers and other terrain."""
