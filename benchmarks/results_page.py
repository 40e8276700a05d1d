"""The page of results: claims of the three papers beside ours, what misses, and every stored table with its provenance.

Written by ``python -m benchmarks.results_page`` (``make results``) from ``results/claims.toml``, the stored tables and their states in ``results/checked.json``.
"""

import csv
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.stored import CHECKED, FRESH, RESULTS, Stored, check, every_stored
from papers.provenance import git
from papers.studies import ABOUT

PAGE, REMARKS = RESULTS / "README.md", RESULTS / "remarks.md"
_VALUE = re.compile(r"\{([^{}|]+)\|([^{}]+)\|([^{}|]*)\}")


def write_page(states: Mapping[str, str]) -> None:
    """Store the states with commit and date of the check, and write the page of results and that of the remarks."""
    commit = (git("rev-parse", "--short=8", "HEAD") or "unknown").strip()
    about = {"commit": commit, "date": datetime.now(UTC).strftime("%Y-%m-%d"), "states": dict(states)}
    old = json.loads(CHECKED.read_text(encoding="utf-8")) if CHECKED.exists() else {}
    if old.get("states") != about["states"]:
        CHECKED.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    for file, text in pages().items():
        file.write_text(text, encoding="utf-8")


def pages() -> dict[Path, str]:
    """Return the pages of results as the stored files ask for."""
    stored = {one.name: one for one in every_stored()}
    checked = json.loads(CHECKED.read_text(encoding="utf-8"))
    text = tomllib.loads((RESULTS / "claims.toml").read_text(encoding="utf-8"))
    parts = [text["head"].strip(), _freshness(checked, stored), text["pictures"].strip()]
    for paper in text["paper"]:
        parts += [
            f"## {paper['title']}",
            paper["about"].strip(),
            _claims(paper["claim"], stored, checked["states"]),
        ]
    parts += ["## Known misses", text["misses"].strip(), _missed_bars(stored.values())]
    parts += ["## Every stored table", text["tables"].strip(), _tables(stored.values(), checked["states"])]
    parts += ["## Older than today's code", text["stale"].strip(), _stale(checked)]
    return {PAGE: filled("\n\n".join(parts)) + "\n", REMARKS: _remarks(stored.values(), checked["states"])}


def _freshness(checked: Mapping[str, Any], stored: Mapping[str, Stored]) -> str:
    """Return how many tables and figures are of the code that was checked."""
    n = {kind: sum(one.is_study == kind for one in stored.values()) for kind in (False, True)}
    fresh = [
        stored[name].is_study
        for name, state in checked["states"].items()
        if state == FRESH and name in stored
    ]
    return (
        f"{fresh.count(False)} of {n[False]} stored tables and {fresh.count(True)} of {n[True]} figures and tables of the papers "
        f"are of the code of {checked['date']} ({checked['commit']}); the others are named [below](#older-than-todays-code)."
    )


def _stale(checked: Mapping[str, Any]) -> str:
    """Return what is not of the code that was checked, by the reason."""
    groups: dict[str, list[str]] = {}
    for name, state in checked["states"].items():
        groups.setdefault(state, []).append(f"`{name}`")
    groups.pop(FRESH, None)
    return "\n".join(f"- {state}: {', '.join(names)}." for state, names in groups.items()) or "Nothing."


def _claims(
    claims: Iterable[Mapping[str, Any]], stored: Mapping[str, Stored], states: Mapping[str, str]
) -> str:
    """Return the table of a paper's claims."""
    rows = []
    for claim in claims:
        one = stored.get(claim.get("of", ""))
        if one is None:
            command, cpu, commit = claim.get("command", ""), "", ""
        else:
            command, cpu, commit = one.command, cpu_time(one), commit_of(one, states.get(one.name, ""))
        rows.append((claim["says"], claim["ours"], claim["reproduced"], command, cpu, commit))
    return _table(("the paper's claim", "ours", "reproduced", "command", "CPU time", "commit"), rows)


def cpu_time(one: Stored) -> str:
    """Return the CPU time of a stored run, or the one that is stated for it."""
    facts = one.provenance
    if facts.get("cpu_s") is not None:
        return _duration(float(facts["cpu_s"]) + float(facts.get("earlier_cpu_s", 0.0)))
    stated = 60.0 * (ABOUT[one.name].cpu_min or 0.0) if one.is_study else 0.0
    return f"about {_duration(stated)}" if stated else "not measured"


def _duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s" if seconds >= 1.0 else "< 1 s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def commit_of(one: Stored, state: str) -> str:
    """Return the commit of a stored run, in bold where its code is today's."""
    commit = str(one.provenance.get("commit") or "unknown")[:8]
    return f"**{commit}**" if state == FRESH else commit


def _rows_with_bars(one: Stored) -> Sequence[Mapping[str, Any]]:
    """Return the rows of a table that are judged by a bar; tables of named rows have none."""
    rows = one.content.get("rows", ())
    return rows if isinstance(rows, list) else ()


def _missed_bars(stored: Iterable[Stored]) -> str:
    """Return how many rows with a bar miss it, and in which tables."""
    missed, judged = [], 0
    for one in stored:
        held = [row["holds"] for row in _rows_with_bars(one) if row["holds"] is not None]
        judged += len(held)
        if held.count(False):
            missed.append((one.name, held.count(False), len(held)))
    n = sum(count for _, count, _ in missed)
    listed = ", ".join(
        f"`{name}` {count} of {of}" for name, count, of in sorted(missed, key=lambda each: -each[1])
    )
    return (
        f"{judged - n:,} of {judged:,} rows with a bar hold; {n} miss it, in {len(missed)} tables: {listed}."
    )


def _tables(stored: Iterable[Stored], states: Mapping[str, str]) -> str:
    """Return the list of all tables and figures with their provenance."""
    rows = []
    for one in stored:
        place = f"{one.name}/" if one.is_study else f"benchmarks/{one.file.name}"
        note = f" ({one.note})" if one.note else ""
        date = str(one.provenance.get("date", ""))[:10]
        rows.append(
            (
                one.what,
                f"{one.command}{note}",
                f"`{place}`",
                cpu_time(one),
                f"{commit_of(one, states.get(one.name, ''))}, {date}",
            )
        )
    return _table(("what", "command", "stored in", "CPU time", "commit"), rows)


def _remarks(stored: Iterable[Stored], states: Mapping[str, str]) -> str:
    """Return the page of the remarks on stored runs, with the rows that miss their bar."""
    parts = [
        "# Remarks on stored runs\n\nHow runs were made, and which rows miss their bar. Written by `make results`."
    ]
    for one in stored:
        older = one.content.get("remark_of")
        lines = [f"Written for the run of {older}, before this one."] if older else []
        lines += one.content.get("remark", ())
        for row in _rows_with_bars(one):
            if row["holds"] is False:
                unit = "" if row["unit"] == "1" else f" {row['unit']}".rstrip()
                lines.append(f"Missed: {row['name']}, {row['value']:.4g}{unit} for {row['bar']}")
        if lines:
            name = f"{one.name}/" if one.is_study else one.file.name
            parts.append(
                "\n".join([f"## {name}", f"{states.get(one.name, '')}", "", *(f"- {line}" for line in lines)])
            )
    return "\n\n".join(parts) + "\n"


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join("| " + " | ".join(" ".join(cell.split()) for cell in line) + " |" for line in lines)


def filled(text: str) -> str:
    """Return a text with the values of stored tables in the place of ``{FILE|ROW|COLUMN|FORMAT}``.

    A row of a CSV file is named by its first cells; a row of a table of a benchmark by its name, without a column.
    """

    def value(found: re.Match[str]) -> str:
        file, place, form = found.groups()
        return format(_looked_up(file, tuple(place.split("|"))), form).replace("-", "−")

    return _VALUE.sub(value, text)


@cache
def _looked_up(file: str, place: tuple[str, ...]) -> float:
    """Return a value of a stored table."""
    found = list(_values(RESULTS / file, place))
    if len(found) != 1:
        raise SystemExit(
            f"results/claims.toml asks for {' | '.join(place)} of {file}: {len(found)} values, not one."
        )
    return found[0]


def _values(file: Path, place: tuple[str, ...]) -> Iterator[float]:
    if file.suffix == ".json":
        rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
        yield from (float(row["value"]) for row in rows if (row["name"],) == place)
        return
    *first, column = place
    with file.open(encoding="utf-8", newline="") as lines:
        heading, *rows = csv.reader(lines)
        yield from (float(row[heading.index(column)]) for row in rows if row[: len(first)] == list(first))


if __name__ == "__main__":
    write_page(check())
