"""``firnline run``: run a mission from plan to report, or continue it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.options import RunOptions, Workers
from firnline.cli.outcome import NOT_MET, with_exit_codes
from firnline.cli.request import with_options_of


@dataclass(frozen=True, kw_only=True)
class RunRequest(RunOptions):
    """Options of the command."""

    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")]
    first: Annotated[
        str | None, typer.Option("--from", metavar="STAGE", help="Repeat this stage and all later ones.")
    ] = None
    until: Annotated[str, typer.Option("--until", metavar="STAGE", help="Stop after this stage.")] = "report"
    fresh: Annotated[bool, typer.Option("--fresh", help="Repeat every stage.")] = False
    require: Annotated[
        bool, typer.Option("--require", help="End with exit code 5 when the wanted class is not met.")
    ] = False
    workers: Workers = None


@with_exit_codes
@with_options_of(RunRequest)
def run(request: RunRequest) -> None:
    """Run a mission from plan to report, or continue it where it was stopped.

    Stages: plan, simulate, localize, reconstruct, score, report. The report's path is
    printed last.

    For example:

      firnline run examples/srtm_ridge.toml

      firnline run mine.toml --set planner.swaths=6 --require

      firnline run mine.toml --dry-run
    """
    from firnline.cli.mission_file import class_met, print_summary, run_until, summary
    from survey.core.errors import ConfigError
    from survey.core.run_folder import STAGES

    for stage in (request.first, request.until):
        if stage is not None and stage not in STAGES:
            raise ConfigError(f"there is no stage {stage!r}; the stages are {', '.join(STAGES)}.")
    start = "plan" if request.fresh else request.first
    done, folder = run_until(request.mission, request.until, request, first=start, workers=request.workers)
    print_summary(folder, as_json=request.as_json)
    if request.require and not class_met(summary(folder), done.score.require):
        raise typer.Exit(NOT_MET)
