"""``firnline reproduce``: figures and tables of the papers."""

from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Quiet, Verbose, print_result


@with_exit_codes
def reproduce(
    name: Annotated[
        str | None, typer.Argument(help="Which figure or table, e.g. glacier-fig10; `all` for every one.")
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder in which each study gets one of its own.")
    ] = Path("results"),
    quick: Annotated[bool, typer.Option("--quick", help="Use smaller sizes, for a quick test.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace studies that are there, complete ones included.")
    ] = False,
    dry_run: DryRun = False,
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
    from papers.studies import STUDIES
    from survey.core.errors import InputError

    if list_all:
        typer.echo("\n".join(STUDIES))
    elif name is None:
        raise InputError("no study was named; `firnline reproduce --list` names them all.")
    elif dry_run:
        _end_dry_run(name, out, quick=quick, force=force)
    elif name == "all":
        _reproduce_all(out, quick=quick, force=force, quiet=quiet)
    else:
        _reproduce(name, out, quick=quick, force=force, quiet=quiet)
        typer.echo(f"{name}: {out / name}")


def _end_dry_run(name: str, out: Path, *, quick: bool, force: bool) -> None:
    """Check the folders, and print which studies would be made."""
    from firnline.actions.interface import Preview, refuse_existing
    from papers.studies import study

    if name == "all":
        print_result(Preview.of(out / each for each in _left(out, quick=quick, force=force)))
        return
    study(name)
    refuse_existing([out / name], force=force, own=("*",))
    print_result(Preview.of([out / name]))


def _left(out: Path, *, quick: bool, force: bool) -> list[str]:
    """Return the studies that are not complete, all of them with `force`."""
    from papers.studies import STUDIES, is_complete

    return [name for name in STUDIES if force or not is_complete(out / name, quick=quick)]


def _reproduce(name: str, out: Path, *, quick: bool, force: bool, quiet: bool) -> None:
    """Make one study beside its folder and exchange the two."""
    from firnline.actions.interface import refuse_existing
    from firnline.cli.progress import counted
    from papers.studies import replacing_study, study

    make = study(name)
    refuse_existing([out / name], force=force, own=("*",))
    with replacing_study(out / name, quick=quick) as draft, counted(quiet=quiet) as progress:
        make(draft, quick=quick, progress=progress)


def _reproduce_all(out: Path, *, quick: bool, force: bool, quiet: bool) -> None:
    """Make all studies that are not complete, in the order of the papers."""
    from survey.core.errors import FirnlineError, InputError

    left = _left(out, quick=quick, force=force)
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
    from papers.studies import LONG, STUDIES

    typer.echo(f"{len(left)} of {len(STUDIES)} studies to make in {out}; the others are complete")
    for name in () if quick else left:
        if name in LONG:
            typer.echo(f"{name} is long: {LONG[name]}")
