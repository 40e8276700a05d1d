"""CPU time of the two demos and of the test suite, from compiled loops that are not stored yet, as in a fresh clone.

The suite is what ``make test`` runs; the tests that are marked ``long`` are measured apart.
Python stores the bytecode of modules, as it does unless the environment forbids it.
With ``--quick`` the demos alone, and a second time with the loops that the first run stored. Processors differ: where
``FIRNLINE_EARLIER`` names a checkout of commit e7dc4dd with an environment of its own, its demos and its test suite run
in turn with today's, for the ratio.
"""

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.report import Row, main

ROOT = Path(__file__).parents[1]
DEMOS = ("srtm_ridge.toml", "short_drive.toml")
SUITE = ("-m", "pytest", "-q", "-n", "auto", "--dist", "loadfile", "-p", "no:cacheprovider")
LONG = (*SUITE, "-m", "long and not exhaustive")
DEMOS_S, SUITE_S = 83.0, 640.0
EARLIER = os.environ.get("FIRNLINE_EARLIER")


class Code(NamedTuple):
    """A checkout, and the Python that runs it."""

    root: Path
    python: Path


TODAY = Code(ROOT, Path(sys.executable))


def measure(quick: bool) -> Iterator[Row]:
    """Yield the CPU time of demos and suite."""
    earlier = None if EARLIER is None else Code(Path(EARLIER), Path(EARLIER) / ".venv/bin/python")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        yield from _demos(folder, earlier)
        if not quick:
            yield from _suites(folder, earlier)


def _demos(folder: Path, earlier: Code | None) -> Iterator[Row]:
    """Yield the CPU time of the demos, of those of an earlier checkout, and of a second run."""
    first = [_demo_s(TODAY, demo, folder / "first", folder / "loops") for demo in DEMOS]
    yield from (Row(f"{demo}, first run", spent, "s") for demo, spent in zip(DEMOS, first, strict=True))
    yield Row.of("both demos, first run", sum(first), "s", "<=", DEMOS_S)
    if earlier is not None:
        place = folder / "earlier"
        before = [_demo_s(earlier, demo, place, place / "loops") for demo in DEMOS]
        yield from _ratio("both demos", sum(first), sum(before))
    again = [_demo_s(TODAY, demo, folder / "again", folder / "loops") for demo in DEMOS]
    yield Row("both demos, compiled before", sum(again), "s")


def _suites(folder: Path, earlier: Code | None) -> Iterator[Row]:
    """Yield the CPU time of the test suite, and of that of an earlier checkout."""
    spent, code = _measured((sys.executable, *SUITE), ROOT, ROOT, folder / "suite")
    yield Row.of("test suite, first run", spent, "s", "<=", SUITE_S)
    yield Row.of("test suite, exit code", code, "1", "<=", 0.0)
    long_s, code = _measured((sys.executable, *LONG), ROOT, ROOT, folder / "suite")
    yield Row("long tests, after the suite", long_s, "s")
    yield Row.of("long tests, exit code", code, "1", "<=", 0.0)
    if earlier is not None:
        before, _ = _measured(
            (str(earlier.python), *SUITE), earlier.root, earlier.root, folder / "earlier-suite"
        )
        yield from _ratio("test suite", spent, before)
        yield Row("test suite and long tests over the test suite of e7dc4dd", (spent + long_s) / before, "x")


def _ratio(what: str, today_s: float, before_s: float) -> Iterator[Row]:
    """Yield the CPU time of an earlier checkout, and that of today's over it."""
    yield Row(f"{what} of e7dc4dd, first run", before_s, "s")
    yield Row.of(f"{what}, first run, over e7dc4dd", today_s / before_s, "x", "<=", 1.0)


def _demo_s(code: Code, demo: str, runs: Path, loops: Path) -> float:
    """Return the CPU time of a demo with its report [s]."""
    runs.mkdir(exist_ok=True)
    # The installed command: its module has moved since the earlier checkout.
    command = (str(code.python.parent / "firnline"), "run", str(code.root / "examples" / demo), "--quiet")
    spent, exit_code = _measured(command, code.root, runs, loops)
    if exit_code:
        raise SystemExit(f"the demo {demo} ended with exit code {exit_code}; run it alone to see why.")
    return spent


def _measured(command: Sequence[str], root: Path, folder: Path, loops: Path) -> tuple[float, int]:
    """Return the CPU time in user mode of a command of a checkout and all its processes [s], and its exit code."""
    settings = {
        "PYTHONPATH": str(root),
        "NUMBA_CACHE_DIR": str(loops),
        "MPLBACKEND": "Agg",
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    # The output goes to stderr, where failed tests are named.
    done = subprocess.run(command, cwd=folder, env=inherited | settings, check=False, stdout=sys.stderr)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before, done.returncode


if __name__ == "__main__":
    main("CPU time", measure, ("numpy", "scipy", "numba", "matplotlib"))
