"""Compare what two checkouts make, file by file: ``python -m benchmarks.same_bytes BEFORE AFTER --out FOLDER``.

Both checkouts make the five cheapest figures and tables of the papers and run both missions of ``examples``. A
checkout that has an environment of its own (``.venv``) is run by it, any other by this Python. A part that ended
well is read from the folder when the command is given again; ``--parts`` chooses some.

The records of a run (``made.json``, ``manifest.json``, ``log.jsonl``) hold times and versions and are left out. A
file whose bytes differ is read: it has the same values when each value before is unchanged after. The table also
has the CPU time of each part.
"""

import argparse
import json
import os
import resource
import sqlite3
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.writer import TABLES, Run

RESULT = TABLES / "same_bytes.json"
FIGURES = ("glacier-tables", "glacier-fig6", "glacier-fig8", "glacier-fig9", "carving-fig3")
MISSIONS = ("srtm_ridge", "short_drive")
RECORDS = ("made.json", "manifest.json", "log.jsonl")
VERDICTS = ("same bytes", "same values", "different")
Values = dict[str, object]


class Made(NamedTuple):
    """A part that a checkout made: the folder of its files, and the CPU time that it took."""

    folder: Path
    cpu_s: float


def make(checkout: Path, part: str, place: Path) -> Made:
    """Make a part in a checkout, or read it if `place` has it."""
    record = place / f"{part}.json"
    if not record.exists():
        cpu_s = _cpu_of(checkout, part, place)
        record.write_text(json.dumps({"commit": commit(checkout), "cpu_s": round(cpu_s, 2)}))
    stored = json.loads(record.read_text())
    if stored["commit"] != commit(checkout):
        raise SystemExit(
            f"{place} has {part} of commit {stored['commit'][:10]}; remove it, or choose another --out."
        )
    folder = (
        place / part if part in FIGURES else (place / "runs" / part.replace("_", "-") / "latest").resolve()
    )
    return Made(folder, stored["cpu_s"])


def commit(checkout: Path) -> str:
    """Return the commit of a checkout, which has to hold no changes of product code."""
    git = ("git", "-C", str(checkout))
    products = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers", "examples")
    changed = subprocess.run(
        [*git, "status", "--porcelain", "--", *products], check=True, capture_output=True, text=True
    ).stdout
    if changed:
        raise SystemExit(f"{checkout} has uncommitted changes; commit them first:\n{changed}")
    return subprocess.run(
        [*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True
    ).stdout.strip()


def _cpu_of(checkout: Path, part: str, place: Path) -> float:
    """Run the command of a part in a checkout; return its CPU time [s]."""
    own = checkout / ".venv" / "bin" / "python"
    python = str(own) if own.exists() else sys.executable
    words = (
        ("reproduce", part, "--out", place)
        if part in FIGURES
        else ("run", f"examples/{part}.toml", "--runs", place / "runs")
    )
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    environment = {**os.environ, **threads, "PYTHONPATH": str(checkout)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [python, "-m", "firnline.cli.main", *map(str, words), "-q"]
    subprocess.run(command, check=True, cwd=checkout, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compared(before: Path, after: Path) -> Iterator[tuple[str, str, list[str]]]:
    """Yield each file of two folders with a verdict, and the values that differ."""
    names = sorted(_files(before) | _files(after))
    for name in names:
        one, other = before / name, after / name
        if not (one.exists() and other.exists()):
            yield name, VERDICTS[2], ["only before" if one.exists() else "only after"]
        elif one.read_bytes() == other.read_bytes():
            yield name, VERDICTS[0], []
        else:
            yield name, *_values_compared(one, other)


def _files(folder: Path) -> set[str]:
    """Return the paths of all files of a folder but the records of a run."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name not in RECORDS)
    return {str(path.relative_to(folder)) for path in files}


def _values_compared(before: Path, after: Path) -> tuple[str, list[str]]:
    """Return the verdict of two files whose bytes differ, and the names of values that differ."""
    read = READERS.get(before.suffix)
    if read is None:
        return VERDICTS[2], []
    one, other = read(before), read(after)
    differing = [name for name, value in one.items() if other.get(name, _ABSENT) != value]
    return VERDICTS[2 if differing else 1], differing


_ABSENT = object()


def _flat(content: object, name: str = "") -> Values:
    """Return the values of nested mappings and lists by their dotted names."""
    if isinstance(content, Mapping):
        children = content.items()
    elif isinstance(content, list):
        children = enumerate(content)
    else:
        return {name: content}
    return {
        key: value
        for own, child in children
        for key, value in _flat(child, f"{name}.{own}".lstrip(".")).items()
    }


def _arrays(path: Path) -> Values:
    with np.load(path) as arrays:
        return {name: (arrays[name].dtype.str, arrays[name].shape, arrays[name].tobytes()) for name in arrays}


def _tables(path: Path) -> Values:
    """Return the columns of each table of a GeoPackage; its list of contents has the time of writing."""
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as database:
        listed = database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table' AND name != 'gpkg_contents'"
        )
        names = [name for (name,) in listed if not name.startswith("rtree_")]
        return {key: value for name in names for key, value in _columns(database, name).items()}


def _columns(database: sqlite3.Connection, table: str) -> Values:
    found = database.execute(f'SELECT * FROM "{table}"')
    columns = [name for name, *_ in found.description]
    rows = found.fetchall()
    return {f"{table}.{name}": [row[i] for row in rows] for i, name in enumerate(columns)}


READERS: dict[str, Callable[[Path], Values]] = {
    ".json": lambda path: _flat(json.loads(path.read_text())),
    ".geojson": lambda path: _flat(json.loads(path.read_text())),
    ".toml": lambda path: _flat(tomllib.loads(path.read_text())),
    ".npz": _arrays,
    ".gpkg": _tables,
}


def row_of(part: str, before: Made, after: Made) -> dict[str, object]:
    """Compare a part of two checkouts; return the counts of verdicts and the files that are not the same."""
    files = list(compared(before.folder, after.folder))
    verdicts = Counter(verdict for _, verdict, _ in files)
    changed = {
        name: {"verdict": verdict, "values": values[:8]}
        for name, verdict, values in files
        if verdict != VERDICTS[0]
    }
    cpu_s = {"cpu_before_s": before.cpu_s, "cpu_after_s": after.cpu_s}
    return {
        "part": part,
        "files": len(files),
        **{verdict: verdicts[verdict] for verdict in VERDICTS},
        **cpu_s,
        "changed": changed,
    }


def print_table(rows: list[dict[str, object]]) -> None:
    """Print a line for each part, then the files whose bytes differ."""
    table = Table(title="Same bytes")
    for heading in (columns := ("part", "files", *VERDICTS, "cpu_before_s", "cpu_after_s")):
        table.add_column(heading)
    for row in rows:
        table.add_row(*(str(row[column]) for column in columns))
    console = Console(width=120)
    console.print(table)
    for row in rows:
        for name, found in row["changed"].items():  # type: ignore[attr-defined]
            console.print(
                f"{row['part']}: {name}: {found['verdict']} {', '.join(found['values'])}", markup=False
            )


def main() -> None:
    """Print the table, and store it when all parts were made."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("before", type=Path, help="a checkout")
    parser.add_argument("after", type=Path, help="another checkout")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of what both make; finished parts are read from it"
    )
    parser.add_argument("--parts", nargs="+", choices=(*FIGURES, *MISSIONS), default=(*FIGURES, *MISSIONS))
    options = parser.parse_args()
    run = Run.begin(main, RESULT)
    rows = []
    for part in options.parts:
        made = []
        for name in ("before", "after"):
            place = options.out.resolve() / name
            place.mkdir(parents=True, exist_ok=True)
            made.append(make(getattr(options, name).resolve(), part, place))
        rows.append(row_of(part, *made))
    print_table(rows)
    if len(options.parts) == len(FIGURES + MISSIONS):
        commits = {name: commit(getattr(options, name).resolve()) for name in ("before", "after")}
        run.write({**commits, "parts": rows})


if __name__ == "__main__":
    main()
