"""Parameters and facts that actions share.

Options that several requests have, then the lines in which a result is printed: a name, and a value with its unit.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NoReturn

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


Url = Annotated[
    str,
    typer.Argument(
        metavar="URL",
        help="udp://HOST:PORT sends to a vehicle, udpin://HOST:PORT waits for one that sends there; also tcp://HOST:PORT, "
        "serial:///dev/DEVICE:BAUD.",
    ),
]
Patience = Annotated[
    float, typer.Option("--patience", min=0.5, help="Time after which a silent vehicle counts as lost [s].")
]
System = Annotated[
    int | None,
    typer.Option("--system", min=1, max=255, help="MAVLink system id; by default the first that is heard."),
]


@contextmanager
def needs_live_extra() -> Iterator[None]:
    """Turn a missing package into a sentence that names the extra."""
    from survey.core.errors import InputError

    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"this command needs {error.name}, which is not installed; install firnline[live]."
        ) from error


_WIDTH = 18
_DRY_RUN = "nothing was written (--dry-run)"
_NAMES = {
    "n": "points",
    "std": "standard deviation",
    "worst": "largest error",
    "horizontal rms": "horizontal RMS error",
    "vertical rms": "vertical RMS error",
    "end sigma": "σ at the end",
    "yaw rms": "heading RMS error",
    "ate se3": "RMS, aligned",
    "ate sim3": "RMS, scaled",
}
_WORDS = {"rmse": "RMSE", "nmad": "NMAD", "p95": "95 % below", "rpe": "relative error", "nees": "NEES"}
_UNITS = {
    "m": "{:.3f} m",
    "m2": "{:.4g} m²",
    "deg": "{:.2f}°",
    "per_cent": "{:.2f} %",
}
# A unit ends a name, or stands before the number of one of several.
_UNIT = re.compile(r"_(m2|m|s|deg|per_cent)(?=(_\d+)?$)")


def fact_line(name: str, value: object) -> str:
    """Return one fact: its name, padded to the width of the column, and its value.

    Parameters
    ----------
    name : str
        In words.
    value : object
        A text with the unit, or anything that is written as one.

    Returns
    -------
    str
        Without a line feed.

    Examples
    --------
    >>> fact_line("length", "4.09 km")
    '  length             4.09 km'
    """
    return f"  {name:<{_WIDTH}} {value}"


def figure_lines(figures: Mapping[str, Any]) -> list[str]:
    r"""Return figures with machine names, such as ``rmse_m``, as facts with units.

    Parameters
    ----------
    figures : mapping of str to number or str
        Units end the names: ``_m``, ``_m2``, ``_s``, ``_deg``, ``_per_cent``, ``_per_s``.

    Returns
    -------
    list of str
        One line each, in their order.

    Examples
    --------
    >>> print("\n".join(figure_lines({"rmse_m": 0.04661, "length_m": 4093.2, "time_s": 4140.0, "n": 36})))
      RMSE               0.047 m
      length             4.09 km
      time               1 h 09 min
      points             36
    """
    return [fact_line(_title(name), _value(name, value)) for name, value in figures.items()]


def end_dry_run(writes: Iterable[Path], facts: Mapping[str, object] | None = None) -> NoReturn:
    """Print what a command would do with the input that it has checked, and end it.

    Parameters
    ----------
    writes : iterable of pathlib.Path
        Files and folders that it would write.
    facts : mapping of str to object, optional
        What was read, by name.

    Raises
    ------
    typer.Exit
        With exit code 0.
    """
    for name, value in (facts or {}).items():
        typer.echo(fact_line(name, value))
    files = ", ".join(str(path) for path in writes)
    typer.echo(fact_line("would write", files or "no file"))
    typer.echo(_DRY_RUN)
    raise typer.Exit


def _title(name: str) -> str:
    """Return a machine name in words, without its unit."""
    words = _UNIT.sub("", name.replace("_per_s", " per second")).replace("_", " ")
    return _NAMES.get(words, " ".join(_WORDS.get(word, word) for word in words.split()))


def _value(name: str, value: Any) -> str:
    """Return a value with the unit that its name ends in."""
    from survey.core.quantity_text import duration_text, length_text

    if not isinstance(value, float):
        return str(value)
    if name.endswith("length_m"):
        return length_text(value)
    found = _UNIT.search(name.replace("_per_s", ""))
    unit = "" if found is None else found.group(1)
    return duration_text(value) if unit == "s" else _UNITS.get(unit, "{:.4g}").format(value)
