"""``firnline reproduce``: the papers' figures and tables, made anew."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import Quiet, Verbose
from sim.cli.outcome import refusals_told


@refusals_told
def reproduce(
    name: Annotated[
        str | None, typer.Argument(help="Which figure or table, e.g. glacier-fig10; `all` for every one.")
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder in which each study gets one of its own.")
    ] = Path("results"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Smaller and rougher, to see that it works.")
    ] = False,
    list_all: Annotated[bool, typer.Option("--list", help="Name every study and end.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,  # noqa: ARG001
) -> None:
    """Make a figure or table of the papers anew.

    For example:

      firnline reproduce --list

      firnline reproduce glacier-fig10

      firnline reproduce all --out /tmp/results
    """
    from sim.cli.progress import counted
    from sim.studies import STUDIES, study
    from survey.errors import InputError

    if list_all:
        typer.echo("\n".join(STUDIES))
        return
    if name is None:
        raise InputError("no study was named; `firnline reproduce --list` names them all.")
    for wanted in STUDIES if name == "all" else (name,):
        make = study(wanted)
        folder = out / wanted
        folder.mkdir(parents=True, exist_ok=True)
        with counted(quiet=quiet) as progress:
            make(folder, quick=quick, progress=progress)
        typer.echo(f"{wanted}: {folder}")
