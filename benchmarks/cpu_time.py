"""CPU time of the two demos and of the test suite, from compiled loops that are not stored yet, as in a fresh clone.

With ``--quick`` the demos alone, and a second time with the loops that the first run stored.
"""

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.report import Row, main

ROOT = Path(__file__).parents[1]
DEMOS = ("srtm_ridge.toml", "short_drive.toml")
SUITE = ("-m", "pytest", "-q", "-n", "auto", "--dist", "loadfile", "-p", "no:cacheprovider")
DEMOS_S, SUITE_S = 83.0, 640.0


def measure(quick: bool) -> Iterator[Row]:
    """Yield the CPU time of demos and suite."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        first = [_demo_s(demo, folder / "first", folder / "loops") for demo in DEMOS]
        yield from (Row(f"{demo}, first run", spent, "s") for demo, spent in zip(DEMOS, first, strict=True))
        yield Row.of("both demos, first run", sum(first), "s", "<=", DEMOS_S)
        again = [_demo_s(demo, folder / "again", folder / "loops") for demo in DEMOS]
        yield Row("both demos, compiled before", sum(again), "s")
        if not quick:
            yield Row.of("test suite, first run", _cpu_s(SUITE, ROOT, folder / "suite"), "s", "<=", SUITE_S)


def _demo_s(demo: str, runs: Path, loops: Path) -> float:
    """Return the CPU time of a demo with its report [s]."""
    runs.mkdir(exist_ok=True)
    return _cpu_s(("-m", "sim.cli.main", "run", str(ROOT / "examples" / demo), "--quiet"), runs, loops)


def _cpu_s(words: Sequence[str], folder: Path, loops: Path) -> float:
    """Return the CPU time in user mode of a Python command and all its processes [s]."""
    settings = {
        "PYTHONPATH": str(ROOT),
        "NUMBA_CACHE_DIR": str(loops),
        "MPLBACKEND": "Agg",
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run(
        [sys.executable, *words], cwd=folder, env=os.environ | settings, check=True, stdout=subprocess.DEVNULL
    )
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


if __name__ == "__main__":
    main("CPU time", measure, ("numpy", "scipy", "numba", "matplotlib"))
