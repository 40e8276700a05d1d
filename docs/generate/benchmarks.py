"""Tables of benchmarks from ``results/benchmarks``, and the comparison with the papers from the pages of ``results``."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from generate.tables import code, table, toctree

RESULTS = Path(__file__).resolve().parents[2] / "results"
_HEAD = """\
# Benchmarks

Each table holds the rows of one file in `results/benchmarks`, as `python -m benchmarks.NAME` wrote it. Times are CPU
seconds of one thread. A *limit* is what the project asks of the figure; a row without one is for information. Rows that
miss their limit are shown as missed.

"""


def pages() -> dict[str, str]:
    """Return a page for each benchmark, an overview, and the comparison with the papers."""
    tables = stored_tables()
    texts = {
        f"reference/benchmarks/{name}.md": benchmark_page(name, content) for name, content in tables.items()
    }
    overview = [overview_row(name, content) for name, content in tables.items()]
    texts["reference/benchmarks/index.md"] = (
        _HEAD + table(("benchmark", "command", "rows", "limits met"), overview) + "\n" + toctree(tables)
    )
    texts["reference/papers.md"] = papers_page()
    return texts


def stored_tables() -> dict[str, dict[str, Any]]:
    """Return the tables with a list of rows in ``results/benchmarks`` by the names of their files."""
    files = {
        file.stem: json.loads(file.read_text(encoding="utf-8"))
        for file in sorted(RESULTS.joinpath("benchmarks").glob("*.json"))
    }
    return {
        name: content
        for name, content in files.items()
        if isinstance(content, dict) and isinstance(content.get("rows"), list)
    }


def benchmark_page(name: str, content: dict[str, Any]) -> str:
    """Return the page of a benchmark: command, machine and rows."""
    what, command = described(name)
    machine = ", ".join(f"{key} {value}" for key, value in content["machine"].items())
    rows = [row(item) for item in content["rows"]]
    facts = content.get("provenance", {})
    run = f" Commit {facts['commit']} of {facts['date'][:10]}." if facts else ""
    head = f"# {what or title(name)}\n\nCommand: {command or 'see results/README.md'}. Machine: {machine}.{run}\n\n"
    remarks = "\n".join(f"- {text}" for text in content.get("remark", ()))
    rest = f"\n## Remarks on the stored run\n\n{remarks}\n" if remarks else ""
    return head + table(("figure", "value", "unit", "limit", "met"), rows) + rest


def row(item: dict[str, Any]) -> tuple[str, str, str, str, str]:
    """Return a row of a benchmark."""
    met = {True: "yes", False: "**missed**", None: ""}[item["holds"]]
    return escaped(item["name"]), number(item["value"]), item["unit"], item["bar"], met


def overview_row(name: str, content: dict[str, Any]) -> tuple[str, str, str, str]:
    """Return a benchmark's line of the overview."""
    what, command = described(name)
    judged = [item["holds"] for item in content["rows"] if item["holds"] is not None]
    return (
        f"[{what or title(name)}]({name}.md)",
        command,
        str(len(content["rows"])),
        f"{sum(judged)} of {len(judged)}",
    )


def described(name: str) -> tuple[str, str]:
    """Return what a benchmark measures and its command, as ``results/contents.toml`` has them."""
    listed = tomllib.loads((RESULTS / "contents.toml").read_text(encoding="utf-8"))["table"]
    return next(((one["what"], one["command"]) for one in listed if one["file"] == f"{name}.json"), ("", ""))


def papers_page() -> str:
    """Return the claims of the papers from ``results/README.md``, then the pages of each paper."""
    claims = (RESULTS / "README.md").read_text(encoding="utf-8")
    texts = [claims[claims.index("## Glacier paper") : claims.index("## Known misses")]]
    texts += [
        "#" + (RESULTS / f"{paper}.md").read_text(encoding="utf-8")
        for paper in ("glacier", "emap", "carving")
    ]
    head = "# Beside the papers\n\n`firnline reproduce --list` names every figure and table.\n\n"
    return head + "\n".join(texts).replace("[the claims](README.md)", "the claims above")


def title(name: str) -> str:
    """Return the name of a file as a title."""
    return name.replace("_", " ").capitalize()


def number(value: Any) -> str:
    """Return a number with four digits."""
    return (
        code(f"{value:.4g}")
        if isinstance(value, int | float) and not isinstance(value, bool)
        else escaped(str(value))
    )


def escaped(text: str) -> str:
    """Return text without accidental markup."""
    return re.sub(r"([*_<>\[\]$])", r"\\\1", text)
