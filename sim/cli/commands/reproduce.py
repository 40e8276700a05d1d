"""``firnline reproduce``: figures and tables of the papers."""

from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from sim.cli.options import Quiet, Verbose
from sim.cli.outcome import with_exit_codes


@with_exit_codes
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
    force: Annotated[
        bool, typer.Option("--force", help="Replace studies that are there, complete ones included.")
    ] = False,
    list_all: Annotated[bool, typer.Option("--list", help="Name every study and end.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,  # noqa: ARG001
) -> None:
    """Make figures and tables of the papers.

    With `all` every study is made in turn, except those that are complete. When it was stopped,
    the same command continues. A study that is refused does not stop the others. An old study
    stays until the new one is complete.

    For example:

      firnline reproduce --list

      firnline reproduce glacier-fig10 --out /tmp/results

      firnline reproduce all --out /tmp/results --quick
    """
    from sim.studies import STUDIES
    from survey.core.errors import InputError

    if list_all:
        typer.echo("\n".join(STUDIES))
    elif name is None:
        raise InputError("no study was named; `firnline reproduce --list` names them all.")
    elif name == "all":
        _reproduce_all(out, quick=quick, force=force, quiet=quiet)
    else:
        _reproduce(name, out, quick=quick, force=force, quiet=quiet)
        typer.echo(f"{name}: {out / name}")


def _reproduce(name: str, out: Path, *, quick: bool, force: bool, quiet: bool) -> None:
    """Make one study beside its folder and exchange the two."""
    from sim.cli.outputs import refuse_existing
    from sim.cli.progress import counted
    from sim.studies import study
    from sim.studies.study_cache import replacing_study

    make = study(name)
    refuse_existing([out / name], force=force, own=("*",))
    with replacing_study(out / name, quick=quick) as draft, counted(quiet=quiet) as progress:
        make(draft, quick=quick, progress=progress)


def _reproduce_all(out: Path, *, quick: bool, force: bool, quiet: bool) -> None:
    """Make all studies that are not complete, in the order of the papers."""
    from sim.studies import STUDIES
    from sim.studies.study_cache import is_complete
    from survey.core.errors import FirnlineError, InputError

    left = [name for name in STUDIES if force or not is_complete(out / name, quick=quick)]
    _announce(left, out, quick=quick)
    refused = []
    for n, name in enumerate(left, start=1):
        began = perf_counter()
        try:
            _reproduce(name, out, quick=quick, force=force, quiet=quiet)
        except FirnlineError as error:
            refused.append(name)
            typer.echo(f"{n}/{len(left)} {name}: refused, {error}", err=True)
        else:
            typer.echo(f"{n}/{len(left)} {name}: {out / name}, {perf_counter() - began:.0f} s")
    if refused:
        raise InputError(
            f"{len(refused)} studies were refused: {', '.join(refused)}; all others are complete."
        )


def _announce(left: list[str], out: Path, *, quick: bool) -> None:
    """Print how many studies will be made, and which of them take long."""
    from sim.studies import LONG, STUDIES

    typer.echo(f"{len(left)} of {len(STUDIES)} studies to make in {out}; the others are complete")
    for name in () if quick else left:
        if name in LONG:
            typer.echo(f"{name} is long: {LONG[name]}")
