"""The one writer of stored tables: each gets its provenance, and keeps the remark on it.

The provenance holds commit and digest of the code, machine, CPU time and date of the run. Parts that earlier runs have stored
are counted by the digest of their code, and their CPU time is added.
"""

import json
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from papers.provenance import KEY, Began, CodeState, kept_remark

TABLES = Path(__file__).parents[1] / "results" / "benchmarks"
CONTENTS = TABLES.parent / "contents.toml"
"""List of all stored tables."""
_LONG_S = 1200.0
_RUNS: list["Run"] = []


@dataclass
class Run:
    """A run of a benchmark: its table's file, its code and clocks at the begin, and the parts that earlier runs stored."""

    file: Path
    began: Began
    quick: bool = False
    parts: dict[Path, tuple[str, float]] = field(default_factory=dict)
    """Of each part that is stored apart: the digest of its code, empty where it is unknown, and what it took before this run [s]."""

    @classmethod
    def begin(cls, measure: Callable[..., object], file: Path, *, quick: bool = False) -> "Run":
        """Begin a run, and say what it will take if that is more than 20 minutes of CPU."""
        took_s = expected_cpu_s(file)
        if took_s > _LONG_S and not quick:
            print(
                f"This takes about {took_s / 60.0:.0f} minutes of CPU, as it did before.",
                file=sys.stderr,
                flush=True,
            )
        run = cls(file, Began.now(CodeState.by_another_process(name_of(measure))), quick)
        _RUNS[:] = [run]
        return run

    def write(self, table: Mapping[str, Any], file: Path | None = None) -> None:
        """Write a table with its provenance, into the results unless another file is named; a remark on it is kept."""
        digests, earlier_s = (
            Counter(code for code, _ in self.parts.values()),
            sum(s for _, s in self.parts.values()),
        )
        parts = {"parts": dict(digests), "earlier_cpu_s": round(earlier_s, 1)} if digests else {}
        target = file or self.file
        old = read_table(target) if target == self.file else {}
        is_same = all(old.get(key) == value for key, value in table.items() if key != "machine")
        record = {
            **table,
            KEY: self.began.facts(quick=self.quick, **parts),
            **kept_remark(old, is_same=is_same),
        }
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(json.dumps(record, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")

    def part(self, file: Path, made: Mapping[str, Any], *, is_earlier: bool) -> None:
        """Count a part of the table with the code and the CPU time that it states."""
        cpu_s = float(made.get("cpu_s", 0.0)) if is_earlier else 0.0
        self.parts.setdefault(file, (str(made.get("code") or ""), cpu_s))


def current_run() -> Run | None:
    """Return the run of this process, none in its children and in tests."""
    return _RUNS[0] if _RUNS else None


def name_of(measure: Callable[..., object]) -> str:
    """Return ``module:function`` of a benchmark, also of one that is run as the main program."""
    while isinstance(measure, partial):
        measure = measure.func
    module = measure.__module__
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    if module == "__main__" and spec is not None:
        module = spec.name
    return f"{module}:{measure.__qualname__}"


def read_table(file: Path) -> dict[str, Any]:
    """Return a stored table; an empty one where there is none."""
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return found


def expected_cpu_s(file: Path) -> float:
    """Return the CPU time of the stored run of a table, or the one that the list of results states [s]; 0 if unknown."""
    facts = read_table(file).get(KEY, {})
    measured = (facts.get("cpu_s") or 0.0) + (facts.get("earlier_cpu_s") or 0.0)
    listed = tomllib.loads(CONTENTS.read_text(encoding="utf-8"))["table"]
    stated = {one["file"]: 60.0 * one.get("cpu_min", 0.0) for one in listed}
    return float(measured or stated.get(file.name, 0.0))
