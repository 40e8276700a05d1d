"""``firnline montecarlo``: simulate many surveys of random terrains and summarize their errors."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.facts import end_dry_run, fact_line
from firnline.cli.options import DryRun, ExecutionOptions, Json, Quiet, Settings
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of


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
    from sim.montecarlo.config import read_study
    from sim.montecarlo.study import require_study, run_study

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

    from survey.core.documents import read_record

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
