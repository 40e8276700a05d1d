"""``firnline simulate``: simulate the drive of a mission and record its sensors."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose, Workers
from sim.cli.outcome import with_exit_codes


@with_exit_codes
def simulate(
    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")],
    runs: Runs = RUNS,
    settings: Settings = None,
    workers: Workers = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Plan and drive a mission: a recording for the estimator, the truth for scoring.

    For example:

      firnline simulate mine.toml --set fidelity=ideal
    """
    from sim.cli.mission_file import print_summary, run_until

    _, folder = run_until(
        mission, "simulate", runs=runs, settings=settings, quiet=quiet, verbose=verbose, workers=workers
    )
    print_summary(folder, as_json=as_json)
