"""``firnline rehearse``: how probable it is that a mission ends with its class."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from firnline.cli.facts import end_dry_run, fact_line
from firnline.cli.options import ExecutionOptions, RunOptions
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from sim.mission.rehearsal import FaultEvent


@dataclass(frozen=True, kw_only=True)
class RehearseRequest(RunOptions, ExecutionOptions):
    """Options of the command."""

    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")]
    n_runs: Annotated[int, typer.Option("--count", "-n", min=1, help="Number of runs.")] = 50


@with_exit_codes
@with_options_of(RehearseRequest)
def rehearse(request: RehearseRequest) -> None:
    """Run a mission many times with other seeds and drawn settings, and count how often it reaches its class.

    Outcomes are stored as they finish; the same command continues a stopped rehearsal, and a larger --count adds
    runs. fault_tree.png shows what the runs that missed it failed of.

    For example:

      firnline rehearse mine.toml --count 50

      firnline rehearse mine.toml --set fleet.loss_probability=0.1
    """
    import json

    from firnline.cli.progress import counted
    from sim.mission.rehearsal import (
        fault_tree,
        outcomes,
        rehearsal_folder,
        rehearse_mission,
        summarize_outcomes,
        write_fault_tree,
    )
    from sim.mission.runs import read_mission

    engine = request.chosen_engine()
    mission = read_mission(request.mission, request.settings)
    if request.dry_run:
        end_dry_run([rehearsal_folder(mission, request.runs)], {"runs": request.n_runs})
    with counted(quiet=request.quiet) as progress:
        folder = rehearse_mission(
            mission,
            request.runs,
            request.n_runs,
            engine=engine,
            workers=request.workers,
            scheduler=request.scheduler,
            watch=lambda done, total: progress("runs", done, total),
        )
    found = outcomes(folder, request.n_runs)
    summary, tree = summarize_outcomes(found), fault_tree(found)
    write_fault_tree(summary, tree, folder / "fault_tree.png")
    if request.as_json:
        facts = {"folder": str(folder), **summary._asdict(), "fault_tree": _nested(tree), "runs": found}
        typer.echo(json.dumps(facts, indent=2))
        return
    low, high = summary.interval
    typer.echo(
        f"{mission.score.require} met in {summary.counts['met']} of {summary.n_runs} runs: probability "
        f"{summary.probability:.2f} (95 %: {low:.2f} to {high:.2f})"
    )
    _print_parts(tree, "")
    typer.echo(fact_line("fault tree", folder / "fault_tree.png"))
    typer.echo(fact_line("outcomes", folder))


def _print_parts(event: "FaultEvent", indent: str) -> None:
    """Print the events below one, each with its number of runs."""
    for part in event.parts:
        typer.echo(fact_line(f"{indent}{part.name}", part.n_runs))
        _print_parts(part, f"{indent}  ")


def _nested(event: "FaultEvent") -> dict[str, Any]:
    """Return an event and those below it as JSON has them."""
    return {"name": event.name, "n_runs": event.n_runs, "parts": [_nested(part) for part in event.parts]}
