"""Options that several commands share: `run`, `plan`, `simulate`, `reconstruct`, `score`, `report`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

RUNS = Path("results/runs")

Runs = Annotated[Path, typer.Option("--runs", help="Folder that holds all runs.")]
Settings = Annotated[
    list[str],
    typer.Option("--set", metavar="KEY=VALUE", help="Override a setting, e.g. planner.swaths=6."),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        help="Processes of drives with images: up to 2 for one rover, one for each rover of a fleet; as many as cores when left out.",
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Check all input and print what would be done; write nothing.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on stderr.")]
Verbose = Annotated[
    int, typer.Option("--verbose", "-v", count=True, help="More detail in the log; -vv shows tracebacks.")
]


def columns_option(help_: str) -> Any:
    """Return the option that chooses the columns of a table of text."""
    return typer.Option("--columns", metavar="KEY=COLUMN,…", help=help_)


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of the commands that do stages of a mission."""

    runs: Runs = RUNS
    settings: Settings = field(default_factory=list)
    dry_run: DryRun = False
    as_json: Json = False
    quiet: Quiet = False
    verbose: Verbose = 0


@dataclass(frozen=True, kw_only=True)
class ExecutionOptions:
    """Options of the commands that do many independent runs."""

    engine: Annotated[str, typer.Option("--engine", help="serial, processes (of this machine) or dask.")] = (
        "processes"
    )
    workers: Annotated[
        int | None,
        typer.Option("--workers", min=1, help="Number of processes; one for each core when left out."),
    ] = None
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="A dask scheduler, tcp://host:port.")
    ] = None

    def chosen_engine(self) -> Any:
        """Return the engine; a scheduler is one of dask."""
        from survey.core.errors import ConfigError

        if self.engine not in ("serial", "processes", "dask"):
            raise ConfigError(f"there is no engine {self.engine!r}; take serial, processes or dask.")
        return "dask" if self.scheduler else self.engine


def epoch_option(help_: str) -> Any:
    """Return the option for the moment of a map or path on moving ice."""
    return typer.Option("--epoch", help=help_)
