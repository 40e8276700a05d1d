"""Commands of missions: ``init``, ``run``, ``simulate``, ``report`` and ``show``."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.actions.requests import InitRequest, ReportRequest, RunRequest, SimulateRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, Printing, print_result, with_options_of
from firnline.cli.stages import run_stages, watched_by


@with_exit_codes
@with_options_of(InitRequest)
def init(request: InitRequest, dry_run: DryRun = False) -> None:
    """Write a mission file with every setting, its unit and its default.

    For example:

      firnline init my-survey.toml

      firnline init my-survey.toml --dem copernicus.tif
    """
    from firnline.actions import missions
    from firnline.actions.interface import Preview

    made = missions.init(request)
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
    from firnline.actions import missions

    if printing.dry_run:
        print_result(missions.preview_run(request))
        return
    made = missions.run(request, watched_by(printing), verbose=printing.verbose)
    print_result(made, as_json=printing.as_json)


@with_exit_codes
@with_options_of(SimulateRequest)
def simulate(request: SimulateRequest, printing: Printing) -> None:
    """Plan and drive a mission: a recording for the estimator, the truth for scoring.

    For example:

      firnline simulate mine.toml --set fidelity=ideal
    """
    run_stages(request.mission, request, "simulate", printing, workers=request.workers)


@with_exit_codes
@with_options_of(ReportRequest)
def report(request: ReportRequest, printing: Printing) -> None:
    """Draw the report of a run again; a mission file is run first where it is not done yet.

    For example:

      firnline report results/runs/srtm-ridge/latest

      firnline report mine.toml
    """
    from firnline.actions import missions

    if printing.dry_run:
        print_result(missions.preview_report(request))
        return
    made = missions.report(request, watched_by(printing), verbose=printing.verbose)
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
    from firnline.actions import missions

    print_result(missions.show(run), as_json=as_json)
