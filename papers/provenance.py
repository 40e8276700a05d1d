"""Provenance of stored tables and figures: commit, digest of the code, machine, CPU time and date of a run.

``python -m papers.provenance MODULE:FUNCTION`` prints commit and digest of the code as it stands.
"""

import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from papers.code_closure import PACKAGES, ROOT, code_of_today

KEY = "provenance"
MEASURED = "measured"


@dataclass(frozen=True)
class CodeState:
    """Commit of the checkout, whether its code was changed since, and digest of what ``module:function`` reaches."""

    of: str
    commit: str | None
    has_changes: bool
    code: str | None

    @classmethod
    def of_today(cls, function: str) -> "CodeState":
        """Return the state of the code as it stands; no commit outside of a checkout."""
        commit = git("rev-parse", "--short=12", "HEAD")
        changes = git("status", "--porcelain", "--untracked-files=no", "--", *PACKAGES)
        return cls(
            function, commit.strip() if commit else None, bool(changes), code_of_today().digest(function)
        )

    @classmethod
    def by_another_process(cls, function: str) -> "CodeState":
        """Return the same, found by a process of its own, so that this one keeps its memory and its CPU time."""
        command = [sys.executable, "-m", "papers.provenance", function]
        done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
        return cls(**json.loads(done.stdout))


@dataclass(frozen=True)
class Began:
    """The code and the clocks at the begin of a run: its code may change while it runs, its table is of the first."""

    state: CodeState
    cpu_s: float
    wall_s: float

    @classmethod
    def now(cls, state: CodeState) -> "Began":
        """Begin a run."""
        return cls(state, used_cpu_s(), time.perf_counter())

    def facts(self, *, quick: bool, **more: Any) -> dict[str, Any]:
        """Return what is stored beside the outcome of a run that ends now, CPU times of child processes included."""
        return {
            "source": MEASURED,
            **asdict(self.state),
            "machine": processor(),
            "python": platform.python_version(),
            "cpu_s": round(used_cpu_s() - self.cpu_s, 1),
            "wall_s": round(time.perf_counter() - self.wall_s, 1),
            "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
            "quick": quick,
            **more,
        }


def kept_remark(old: Mapping[str, Any], *, is_same: bool) -> dict[str, Any]:
    """Return the remark of an old table or figure for a new one, with the commit it was written for if outcomes differ."""
    if not old.get("remark"):
        return {}
    written_for = old.get("remark_of") or (
        None if is_same else old.get(KEY, {}).get("commit") or "an earlier run"
    )
    return {"remark": old["remark"]} | ({"remark_of": written_for} if written_for else {})


def used_cpu_s() -> float:
    """Return the CPU time of this process and of its children that have ended [s]."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def processor() -> str:
    """Return the name of the processor and the number of its cores."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {os.cpu_count()} cores"


def git(*words: str) -> str | None:
    """Return what git prints in the checkout of this code; nothing where there is no checkout or no git."""
    if not (ROOT / ".git").exists():
        return None
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout


if __name__ == "__main__":
    sys.stdout.write(json.dumps(asdict(CodeState.of_today(sys.argv[1]))) + "\n")
