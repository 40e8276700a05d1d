"""Commands of many runs: ``montecarlo``, ``rehearse`` and ``fit``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from firnline.actions.interface import (
    DryRun,
    ExecutionOptions,
    Json,
    Quiet,
    RunOptions,
    Settings,
    end_dry_run,
    fact_line,
)
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from sim.mission.rehearsal.fault_tree import FaultEvent


@dataclass(frozen=True, kw_only=True)
class MonteCarloRequest(ExecutionOptions):
    """Options of the command."""

    study: Annotated[Path, typer.Argument(help="Study file (TOML).")]
    runs: Annotated[Path, typer.Option("--runs", help="Folder that holds all studies.")] = Path(
        "results/montecarlo"
    )
    fresh: Annotated[bool, typer.Option("--fresh", help="Do every trial again.")] = False
    settings: Settings = field(default_factory=list)
    dry_run: DryRun = False
    as_json: Json = False
    quiet: Quiet = False


@with_exit_codes
@with_options_of(MonteCarloRequest)
def montecarlo(request: MonteCarloRequest) -> None:
    """Survey many random terrains by several planners, and count the swaths that a map class takes.

    Trials are stored as they finish; the same command continues a stopped study.

    For example:

      firnline montecarlo examples/montecarlo_fig10.toml

      firnline montecarlo study.toml --set trials=1000 --scheduler tcp://10.0.0.5:8786
    """
    from firnline.cli.progress import counted
    from sim.montecarlo.capacity import require_study
    from sim.montecarlo.config import read_study
    from sim.montecarlo.study import run_study

    engine = request.chosen_engine()
    wanted = read_study(request.study, request.settings)
    folder = request.runs / wanted.name
    if request.dry_run:
        require_study(wanted)
        end_dry_run([folder], {"trials": wanted.trials})
    with counted(quiet=request.quiet) as progress:
        page = run_study(
            wanted,
            folder,
            engine=engine,
            workers=request.workers,
            scheduler=request.scheduler,
            fresh=request.fresh,
            watch=lambda done, total: progress("trials", done, total),
        )
    _print_results(folder, page, as_json=request.as_json)


def _print_results(folder: Path, page: Path, *, as_json: bool) -> None:
    """Print the fewest swaths of every curve, for people or as JSON, from files that are checked."""
    import csv
    import json

    from survey.core.runs.manifest import read_record

    read_record(folder)
    with (folder / "minimum_swaths.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    if as_json:
        typer.echo(json.dumps({"study": str(folder), "report": str(page), "minimum_swaths": rows}, indent=2))
        return
    for row in rows:
        fewest, safe = row["fewest_by_mean"] or "none", row["fewest_by_90_percent"] or "none"
        typer.echo(
            f"{row['terrain']}, {row['planner']}, {row['map']}: fewest swaths by the mean error {fewest}, in 90 % of trials {safe}"
        )
    typer.echo(fact_line("table", folder / "trials.csv"))
    typer.echo(fact_line("report", page))


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
    from sim.mission.rehearsal.fault_tree import fault_tree
    from sim.mission.rehearsal.figure import write_fault_tree
    from sim.mission.rehearsal.runs import outcomes, rehearsal_folder, summarized
    from sim.mission.rehearsal.runs import rehearse as run_all_of
    from sim.mission.runs import read_mission

    engine = request.chosen_engine()
    mission = read_mission(request.mission, request.settings)
    if request.dry_run:
        end_dry_run([rehearsal_folder(mission, request.runs)], {"runs": request.n_runs})
    with counted(quiet=request.quiet) as progress:
        folder = run_all_of(
            mission,
            request.runs,
            request.n_runs,
            engine=engine,
            workers=request.workers,
            scheduler=request.scheduler,
            watch=lambda done, total: progress("runs", done, total),
        )
    found = outcomes(folder, request.n_runs)
    summary, tree = summarized(found), fault_tree(found)
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


@with_exit_codes
def fit(
    runs: Annotated[list[Path], typer.Argument(help="Run folders of missions in the vision fidelity.")],
) -> None:
    """Fit the sensor errors of the statistical fidelity to the errors of drives with images.

    Prints the section of a mission file; GPS and barometer are not touched. Fit to drives
    that nothing is judged on.

    For example:

      firnline fit results/runs/glacier-drive/latest > sensors.toml
    """
    import tomlkit

    from sim.config.mission import SensorConfig
    from sim.simulate.error_model import errors_of, fitted
    from survey.core.runs.store import RunFolder

    found = fitted([errors_of(RunFolder.find(run)) for run in runs]).model_dump(mode="json")
    usual = SensorConfig().model_dump(mode="json")
    changed = {name: value for name, value in found.items() if value != usual[name]}
    typer.echo(tomlkit.dumps({"sensors": changed}), nl=False)
