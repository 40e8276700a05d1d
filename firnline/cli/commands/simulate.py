"""``firnline simulate``: simulate the drive of a mission and record its sensors."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.options import RunOptions, Workers
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of


@dataclass(frozen=True, kw_only=True)
class SimulateRequest(RunOptions):
    """Options of the command."""

    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")]
    workers: Workers = None


@with_exit_codes
@with_options_of(SimulateRequest)
def simulate(request: SimulateRequest) -> None:
    """Plan and drive a mission: a recording for the estimator, the truth for scoring.

    For example:

      firnline simulate mine.toml --set fidelity=ideal
    """
    from firnline.cli.mission_file import print_summary, run_until

    _, folder = run_until(request.mission, "simulate", request, workers=request.workers)
    print_summary(folder, as_json=request.as_json)
