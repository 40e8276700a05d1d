"""``firnline --version``: the version of the installed package."""

import typer


def print_version(wanted: bool) -> None:
    """Print the version and leave, where it is asked for."""
    if wanted:
        from importlib.metadata import version

        typer.echo(f"firnline {version('firnline')}")
        raise typer.Exit
