"""Commands of simulated missions: ``init``, ``simulate``, ``run``, ``report``, ``show``, ``montecarlo``, ``rehearse``, ``fit`` and ``reproduce``."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from firnline import actions
from firnline.actions.interface import preview_of
from firnline.actions.requests import (
    InitRequest,
    MonteCarloRequest,
    RehearseRequest,
    ReportRequest,
    RunOptions,
    RunRequest,
    SimulateRequest,
)
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import (
    DryRun,
    Json,
    Printing,
    Quiet,
    SurveyStep,
    Verbose,
    perform,
    print_result,
    with_options_of,
)
from survey.core import FirnlineError, InputError


def run_stages(mission_file: Path, options: RunOptions, until: str, printing: Printing) -> None:
    """Run the stages of a mission up to one and print its summary, or print which stages would be done."""
    from firnline.actions.runs import preview_stages, run_until

    if printing.dry_run:
        print_result(preview_stages(mission_file, options, until=until))
        return
    made = run_until(mission_file, until, options, watch=watched_by(printing), verbose=printing.verbose)
    print_result(replace(made, wanted=None), as_json=printing.as_json)


def watched_by(
    printing: Printing,
) -> Callable[[Mapping[str, float]], Callable[[str], AbstractContextManager[None]]]:
    """Return what shows the progress of stages, given the seconds that they took before."""
    from firnline.cli.progress import StageProgress

    return lambda expected_s: StageProgress(quiet=printing.quiet, expected_s=expected_s)


@with_exit_codes
@with_options_of(InitRequest)
def init(request: InitRequest, dry_run: DryRun = False) -> None:
    """Write a mission file with every setting, its unit and its default.

    For example:

      firnline init my-survey.toml

      firnline init my-survey.toml --dem copernicus.tif
    """
    from firnline.actions.interface import Preview

    made = actions.init(request)
    print_result(Preview.of([request.path]) if dry_run else made.write())


@with_exit_codes
@with_options_of(RunRequest)
def run(request: RunRequest, printing: Printing) -> None:
    """Run a mission from plan to report, or continue it where it was stopped.

    Stages: plan, simulate, localize, reconstruct, score, report. The report's path is
    printed last.

    For example:

      firnline run examples/srtm_ridge.toml

      firnline run mine.toml --set planner.swaths=6 --require

      firnline run mine.toml --dry-run
    """
    if printing.dry_run:
        print_result(preview_of(actions.run, request))
        return
    made = actions.run(request, watched_by(printing), verbose=printing.verbose)
    print_result(made, as_json=printing.as_json)


@with_exit_codes
@with_options_of(SimulateRequest)
def simulate(request: SimulateRequest, printing: Printing) -> None:
    """Plan and drive a mission: a recording for the estimator, the truth for scoring.

    For example:

      firnline simulate mine.toml --set fidelity=ideal

      firnline simulate short_drive.toml --serve
    """
    if printing.dry_run:
        print_result(preview_of(actions.simulate, request))
        return
    made = actions.simulate(
        request, watched_by(printing), verbose=printing.verbose, say=partial(typer.echo, err=True)
    )
    print_result(made, as_json=printing.as_json)


@with_exit_codes
@with_options_of(ReportRequest)
def report(request: ReportRequest, printing: Printing) -> None:
    """Draw the report of a run again; a mission file is run first where it is not done yet.

    For example:

      firnline report results/runs/srtm-ridge/latest

      firnline report mine.toml
    """
    if printing.dry_run:
        print_result(preview_of(actions.report, request))
        return
    made = actions.report(request, watched_by(printing), verbose=printing.verbose)
    print_result(made, as_json=printing.as_json)


@with_exit_codes
def show(
    run: Annotated[
        Path, typer.Argument(help="A run folder, a mission's folder of runs, or its latest link.")
    ],
    as_json: Json = False,
) -> None:
    """Show which stages of a run are done, how long they took, and the score.

    Every file is checked against the checksum that was taken when it was written.

    For example:

      firnline show results/runs/srtm-ridge
    """
    print_result(actions.show(run), as_json=as_json)


@with_exit_codes
@with_options_of(MonteCarloRequest)
def montecarlo(
    request: MonteCarloRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Survey many random terrains by several planners, and count the swaths that a map class takes.

    Trials are stored as they finish; the same command continues a stopped study.

    For example:

      firnline montecarlo examples/montecarlo_fig10.toml

      firnline montecarlo study.toml --set trials=1000 --scheduler tcp://10.0.0.5:8786
    """
    perform(actions.montecarlo, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


@with_exit_codes
@with_options_of(RehearseRequest)
def rehearse(request: RehearseRequest, printing: Printing) -> None:
    """Run a mission many times with other seeds and drawn settings, and count how often it reaches its class.

    Outcomes are stored as they finish; the same command continues a stopped rehearsal, and a larger --count adds
    runs. fault_tree.png shows what the runs that missed it failed of.

    For example:

      firnline rehearse mine.toml --count 50

      firnline rehearse mine.toml --set fleet.loss_probability=0.1
    """
    perform(
        actions.rehearse, request, dry_run=printing.dry_run, as_json=printing.as_json, quiet=printing.quiet
    )


@with_exit_codes
def fit(
    runs: Annotated[list[Path], typer.Argument(help="Run folders of missions in the vision fidelity.")],
) -> None:
    """Fit the sensor errors of the statistical fidelity to the errors of drives with images.

    Prints the section of a mission file; GPS and barometer are not touched. Fit to drives
    that nothing is judged on.

    For example:

      firnline fit results/runs/glacier-drive/latest > sensors.toml
    """
    typer.echo(actions.fit(runs), nl=False)


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
    list_all: Annotated[
        bool, typer.Option("--list", help="Name every study, with what it makes and its CPU time, and end.")
    ] = False,
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
    from papers.studies import STUDIES, listed

    if list_all:
        typer.echo("\n".join(map(listed, STUDIES)))
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


COMMANDS = {
    SurveyStep.BEGIN: (init,),
    SurveyStep.DRIVE: (simulate,),
    SurveyStep.RUN: (report, run, montecarlo, rehearse, fit, reproduce),
    SurveyStep.READ: (show,),
}
"""Commands by the step of a survey that they belong to."""
