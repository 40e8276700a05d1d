"""``firnline report``: write the report page of a run."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose
from sim.cli.outcome import with_exit_codes


@with_exit_codes
def report(
    source: Annotated[Path, typer.Argument(help="A run folder, or a mission file (TOML).")],
    runs: Runs = RUNS,
    settings: Settings = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Draw the report of a run again; a mission file is run first where it is not done yet.

    For example:

      firnline report results/runs/srtm-ridge/latest

      firnline report mine.toml
    """
    from sim.cli.mission_file import print_summary, run_until
    from survey.core.errors import InputError
    from survey.core.runs.store import RunFolder

    if source.suffix == ".toml":
        _, run = run_until(source, "report", runs=runs, settings=settings, quiet=quiet, verbose=verbose)
    else:
        from sim.mission.report import write_mission_report

        run = RunFolder.find(source)
        if not run.has("score"):
            raise InputError(
                f"{run.path} is not scored yet, so there is nothing to report; finish it with firnline run."
            )
        for stage in ("plan", "simulate", "localize", "reconstruct", "score"):
            run.verify(stage)
        with run.stage("report") as folder:
            write_mission_report(folder, run)
    print_summary(run, as_json=as_json)
