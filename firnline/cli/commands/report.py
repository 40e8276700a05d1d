"""``firnline report``: write the report page of a run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.facts import end_dry_run
from firnline.cli.options import RunOptions
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of


@dataclass(frozen=True, kw_only=True)
class ReportRequest(RunOptions):
    """Options of the command."""

    source: Annotated[Path, typer.Argument(help="A run folder, or a mission file (TOML).")]


@with_exit_codes
@with_options_of(ReportRequest)
def report(request: ReportRequest) -> None:
    """Draw the report of a run again; a mission file is run first where it is not done yet.

    For example:

      firnline report results/runs/srtm-ridge/latest

      firnline report mine.toml
    """
    from firnline.cli.mission_file import print_summary, run_until
    from survey.core.errors import InputError
    from survey.core.run_folder import RunFolder

    if request.source.suffix == ".toml":
        _, run = run_until(request.source, "report", request)
    else:
        from sim.mission.report import write_mission_report

        run = RunFolder.find(request.source)
        if not run.has("score"):
            raise InputError(
                f"{run.path} is not scored yet, so there is nothing to report; finish it with firnline run."
            )
        for stage in ("plan", "simulate", "localize", "reconstruct", "score"):
            run.verify(stage)
        if request.dry_run:
            end_dry_run([run.folder("report")])
        with run.stage("report") as folder:
            write_mission_report(folder, run)
    print_summary(run, as_json=request.as_json)
