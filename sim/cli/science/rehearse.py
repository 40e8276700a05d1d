"""``firnline rehearse``: how probable it is that a mission ends with its class."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from sim.cli.facts import end_dry_run, fact_line
from sim.cli.options import RunOptions
from sim.cli.outcome import with_exit_codes
from sim.cli.request import with_options_of


@dataclass(frozen=True, kw_only=True)
class RehearseRequest(RunOptions):
    """Options of the command."""

    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")]
    n_runs: Annotated[int, typer.Option("--count", "-n", min=1, help="Number of runs.")] = 50
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes; one for each core when left out.")
    ] = None


@with_exit_codes
@with_options_of(RehearseRequest)
def rehearse(request: RehearseRequest) -> None:
    """Run a mission many times with other seeds and drawn settings, and count how often it reaches its class.

    Outcomes are stored as they finish; the same command continues a stopped rehearsal, and a larger --count adds
    runs.

    For example:

      firnline rehearse mine.toml --count 50

      firnline rehearse mine.toml --set fleet.loss_probability=0.1
    """
    import json

    from sim.cli.progress import counted
    from sim.mission.rehearsal import CAUSES, outcomes, rehearsal_folder, summarized
    from sim.mission.rehearsal import rehearse as run_all_of
    from sim.mission.rehearsal_figure import write_outcome_plot
    from sim.mission.runs import read_mission

    mission = read_mission(request.mission, request.settings)
    if request.dry_run:
        end_dry_run([rehearsal_folder(mission, request.runs)], {"runs": request.n_runs})
    with counted(quiet=request.quiet) as progress:
        folder = run_all_of(
            mission,
            request.runs,
            request.n_runs,
            workers=request.workers,
            watch=lambda done, total: progress("runs", done, total),
        )
    found = outcomes(folder, request.n_runs)
    summary = summarized(found)
    write_outcome_plot(summary, folder / "outcomes.png")
    if request.as_json:
        typer.echo(json.dumps({"folder": str(folder), **summary._asdict(), "runs": found}, indent=2))
        return
    low, high = summary.interval
    typer.echo(
        f"{mission.score.require} met in {summary.counts['met']} of {summary.n_runs} runs: probability "
        f"{summary.probability:.2f} (95 %: {low:.2f} to {high:.2f})"
    )
    for cause, n in summary.counts.items():
        if n and cause != "met":
            typer.echo(fact_line(CAUSES[cause], n))
    typer.echo(fact_line("outcomes", folder))
