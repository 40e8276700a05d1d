"""``firnline simulate``: drive a mission's route and keep what the rover sensed."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.options import RUNS, Json, Quiet, Runs, Settings, Verbose, Workers
from sim.cli.outcome import refusals_told


@refusals_told
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
    from sim.cli.mission_file import run_until, tell

    _, folder = run_until(
        mission, "simulate", runs=runs, settings=settings, quiet=quiet, verbose=verbose, workers=workers
    )
    tell(folder, as_json=as_json)
