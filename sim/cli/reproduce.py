"""``firnline reproduce``: the papers' figures and tables, made anew."""

from pathlib import Path
from time import perf_counter
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
    fresh: Annotated[
        bool, typer.Option("--fresh", help="With `all`: make also anew what stands whole.")
    ] = False,
    list_all: Annotated[bool, typer.Option("--list", help="Name every study and end.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,  # noqa: ARG001
) -> None:
    """Make a figure or table of the papers anew.

    With `all` every study is made in turn, but for those that stand whole: killed, the same command goes on where
    it was. A study that is refused does not keep the others from being made.

    For example:

      firnline reproduce --list

      firnline reproduce glacier-fig10

      firnline reproduce all --out /tmp/results --quick
    """
    from sim.studies import STUDIES
    from survey.core.errors import InputError

    if list_all:
        typer.echo("\n".join(STUDIES))
    elif name is None:
        raise InputError("no study was named; `firnline reproduce --list` names them all.")
    elif name == "all":
        _reproduce_all(out, quick=quick, fresh=fresh, quiet=quiet)
    else:
        _reproduce(name, out, quick=quick, quiet=quiet)
        typer.echo(f"{name}: {out / name}")


def _reproduce(name: str, out: Path, *, quick: bool, quiet: bool) -> None:
    """Make one study, and record it when it is whole."""
    from sim.cli.progress import counted
    from sim.studies import study
    from sim.studies.study_cache import forget, record

    make = study(name)
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    forget(folder)
    with counted(quiet=quiet) as progress:
        make(folder, quick=quick, progress=progress)
    record(folder, quick=quick)


def _reproduce_all(out: Path, *, quick: bool, fresh: bool, quiet: bool) -> None:
    """Make what does not stand, in the order of the papers; name what takes long before, and what was refused after."""
    from sim.studies import LONG, STUDIES
    from sim.studies.study_cache import forget, stands
    from survey.core.errors import FirnlineError, InputError

    if fresh:
        for name in STUDIES:
            forget(out / name)
    left = [name for name in STUDIES if not stands(out / name, quick=quick)]
    typer.echo(f"{len(left)} of {len(STUDIES)} studies to make in {out}; the others stand")
    for name in () if quick else left:
        if name in LONG:
            typer.echo(f"{name} is long: {LONG[name]}")
    refused = []
    for n, name in enumerate(left, start=1):
        began = perf_counter()
        try:
            _reproduce(name, out, quick=quick, quiet=quiet)
        except FirnlineError as error:
            refused.append(name)
            typer.echo(f"{n}/{len(left)} {name}: refused, {error}", err=True)
        else:
            typer.echo(f"{n}/{len(left)} {name}: {out / name}, {perf_counter() - began:.0f} s")
    if refused:
        raise InputError(f"{len(refused)} studies were refused: {', '.join(refused)}; all others stand.")
