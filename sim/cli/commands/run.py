"""``firnline run``: run a mission from plan to report, or continue it."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, DryRun, Json, Quiet, Runs, Settings, Verbose, Workers
from sim.cli.outcome import NOT_MET, with_exit_codes


@with_exit_codes
def run(
    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")],
    runs: Runs = RUNS,
    first: Annotated[
        str | None, typer.Option("--from", metavar="STAGE", help="Do this stage and all after it again.")
    ] = None,
    until: Annotated[str, typer.Option("--until", metavar="STAGE", help="Stop after this stage.")] = "report",
    fresh: Annotated[bool, typer.Option("--fresh", help="Do every stage again.")] = False,
    require: Annotated[
        bool, typer.Option("--require", help="End with exit code 5 when the wanted class is not met.")
    ] = False,
    settings: Settings = None,
    workers: Workers = None,
    dry_run: DryRun = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Run a mission from plan to report, or continue it where it was stopped.

    Stages: plan, simulate, localize, reconstruct, score, report. The report's path is
    printed last.

    For example:

      firnline run examples/srtm_ridge.toml

      firnline run mine.toml --set planner.swaths=6 --require

      firnline run mine.toml --dry-run
    """
    from sim.cli.mission_file import class_met, print_summary, run_until, summary
    from survey.core.errors import ConfigError
    from survey.core.runs.store import STAGES

    for stage in (first, until):
        if stage is not None and stage not in STAGES:
            raise ConfigError(f"there is no stage {stage!r}; the stages are {', '.join(STAGES)}.")
    start = "plan" if fresh else first
    if dry_run:
        from sim.cli.mission_file import print_stages_of

        print_stages_of(mission, runs, tuple(settings or ()), first=start, until=until)
        return
    done, folder = run_until(
        mission,
        until,
        runs=runs,
        settings=settings,
        quiet=quiet,
        verbose=verbose,
        first=start,
        workers=workers,
    )
    print_summary(folder, as_json=as_json)
    if require and not class_met(summary(folder), done.score.require):
        raise typer.Exit(NOT_MET)
