"""The one form of every benchmark: a table, ``--json FILE`` and ``--quick``, with the machine named.

A benchmark is a function of `quick` that yields rows.  Times are CPU seconds of one thread, ratios are taken
within one process.  `benchmarks.writer` stores the table with its provenance.
"""

import argparse
import platform
import resource
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal, TypeVar

from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from benchmarks.writer import TABLES, Run

T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    """One measured value, with its bar if it has one."""

    name: str
    value: float
    unit: str
    bar: str = ""
    holds: bool | None = None

    @classmethod
    def of(cls, name: str, value: float, unit: str, sign: Literal["<=", ">="], limit: float) -> "Row":
        """Row with a bar, held or not."""
        holds = value <= limit if sign == "<=" else value >= limit
        return cls(name, float(value), unit, f"{sign} {limit:g}", bool(holds))


def cpu_seconds(work: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a piece of work, and the CPU time of this process that it took [s]."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def fastest(work: Callable[[], T], n: int) -> tuple[T, float]:
    """Return the result and the least CPU time [s] of `n` runs: what the machine's other users add is left out."""
    runs = [cpu_seconds(work) for _ in range(n)]
    return runs[-1][0], min(seconds for _, seconds in runs)


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def machine(packages: Sequence[str]) -> dict[str, str]:
    """Name of the CPU, and versions of Python and of the packages that are installed."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    facts = {"cpu": names[0] if names else platform.processor(), "python": platform.python_version()}
    for package in packages:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            continue
    return facts


def main(
    title: str,
    measure: Callable[[bool], Iterable[Row]],
    packages: Sequence[str] = ("numpy", "scipy"),
    arguments: Sequence[str] | None = None,
    *,
    is_complete: bool = True,
) -> None:
    """Run one benchmark from the command line; only the table of a complete run is stored in the results."""
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument(
        "--json", metavar="FILE", type=Path, help="write the rows and their provenance to a file"
    )
    parser.add_argument("--quick", action="store_true", help="smaller sizes, same bars, under 50 s")
    chosen = parser.parse_args(arguments)
    file = TABLES / f"{title.lower().replace(' ', '_').replace('-', '_')}.json"
    run = Run.begin(measure, file, quick=chosen.quick)
    start = time.perf_counter()
    with threadpool_limits(1):
        rows = [_announced(row) for row in measure(chosen.quick)]
    facts = machine(packages)
    _print(title, rows, facts, time.perf_counter() - start)
    table = {"machine": facts, "rows": [asdict(row) for row in rows]}
    if chosen.json:
        run.write(table, chosen.json)
    if is_complete and not chosen.quick:
        run.write(table)


def _announced(row: Row) -> Row:
    """Say on stderr that a row is done, for those who wait."""
    print(f"  {row.name}: {row.value:.4g} {row.unit}", file=sys.stderr, flush=True)
    return row


def _print(title: str, rows: Sequence[Row], facts: dict[str, str], seconds: float) -> None:
    """Print the table, the machine and the time taken."""
    table = Table(title=title)
    for heading in ("what", "value", "unit", "bar", "holds"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for row in rows:
        verdict = {True: "yes", False: "NO", None: ""}[row.holds]
        table.add_row(row.name, f"{row.value:.4g}", row.unit, row.bar, verdict)
    console = Console(width=120)
    console.print(table)
    console.print(", ".join(f"{key} {value}" for key, value in facts.items()))
    console.print(f"{seconds:.0f} s; times are CPU seconds of one thread")
