"""Structure of the code by the measures of its own tests: sizes, depth, imports, names, docstrings, copies, CPU time."""

import os
import resource
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.report import Row, main
from tests import test_docstrings, test_repetition, test_structure

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
COPYING = (
    "tests/firnline/test_objects.py::test_every_public_type_is_pickled_copied_and_compared",
    "tests/firnline/test_package_types.py::test_every_type_is_pickled_and_copied",
)
RECIPES = ("-m", "walkthrough", "tests/docs/test_recipes.py")
BELOW = ("desk", "live", "survey", "planners", "vision_slam", "sim")


def measure(quick: bool) -> Iterator[Row]:
    """Yield the sizes, then what tools find; quick leaves out what runs tests and type checks."""
    yield from _sizes()
    yield from _depth()
    yield from _doors()
    ambiguous = [name for name, places in test_structure.class_places().items() if len(places) > 1]
    yield Row.of("class names that stand for two things", len(ambiguous), "1", "<=", 0.0)
    several = [name for name, places in test_structure.function_places().items() if len(places) > 1]
    yield Row.of("public function names that stand for two things", len(several), "1", "<=", 0.0)
    yield Row.of("broken contracts of imports, circles among them", _failed("lint-imports"), "1", "<=", 0.0)
    yield Row.of("names that nothing in the product reaches", _n_lines("vulture"), "1", "<=", 0.0)
    complete = test_docstrings.share(test_docstrings.findings())
    yield Row.of("complete public docstrings", complete, "1", ">=", test_docstrings.REQUIRED_SHARE)
    repeated = test_repetition.repeated(test_repetition.texts_of_the_project())
    yield Row.of("runs of six equal lines in two places", len(repeated), "1", "<=", 0.0)
    if not quick:
        test = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider")
        yield Row.of("failures to pickle or copy a public type", _failed(*test, *COPYING), "1", "<=", 0.0)
        yield Row.of("recipes that touch more files than stated", _failed(*test, *RECIPES), "1", "<=", 0.0)
        with TemporaryDirectory() as cache:
            seconds = _cpu_s("mypy", "--cache-dir", cache)
        yield Row.of("CPU of mypy without a cache", seconds, "s", "<=", 60.0)
        with TemporaryDirectory() as cache:
            seconds = _cpu_s(*test, "--collect-only", PYTHONPYCACHEPREFIX=cache, PYTHONDONTWRITEBYTECODE="1")
        yield Row.of("CPU of collecting the tests, without stored bytecode", seconds, "s", "<=", 12.0)
        with TemporaryDirectory() as cache:
            stored = {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
            _cpu_s(*test, "--collect-only", **stored)
            yield Row("CPU of collecting the tests, with it", _cpu_s(*test, "--collect-only", **stored), "s")


def _sizes() -> Iterator[Row]:
    """Yield the sizes of the product, its folders, files and functions."""
    files, folders = test_structure.file_lengths(), test_structure.folder_sizes()
    lengths = list(test_structure.function_lengths().values())
    yield Row.of("files of the product", len(files), "1", "<=", test_structure.MOST_FILES)
    yield Row.of("folders of the product", len(folders), "1", "<=", test_structure.MOST_FOLDERS)
    yield Row.of("lines of the product", sum(files.values()), "1", "<=", test_structure.MOST_LINES)
    lines = np.array(list(files.values()))
    yield Row("lines of a file, median", float(np.median(lines)), "1")
    yield Row("lines of a file, 90th percentile", float(np.percentile(lines, 90)), "1")
    yield Row.of("lines of a file, longest", int(lines.max()), "1", "<=", test_structure.LONGEST_FILE)
    body = "lines of a function's body"
    yield Row.of(f"{body}, median", float(np.median(lengths)), "1", "<=", test_structure.FUNCTION_MEDIAN)
    p90 = float(np.percentile(lengths, 90))
    yield Row.of(f"{body}, 90th percentile", p90, "1", "<=", test_structure.FUNCTION_P90)
    yield Row.of(f"{body}, longest", max(lengths), "1", "<=", test_structure.LONGEST_FUNCTION)


def _depth() -> Iterator[Row]:
    """Yield how deep modules and folders are: their users, their imports, their number."""
    share = len(test_structure.with_one_user()) / len(test_structure.users())
    yield Row.of("modules with exactly one importer", share, "1", "<=", 0.12)
    small = test_structure.small_with_a_neighbour()
    yield Row.of(
        f"modules below {test_structure.SMALL} lines beside their only importer", len(small), "1", "<=", 0.0
    )
    share = test_structure.import_share()
    yield Row.of("import lines", share, "1", "<=", test_structure.MOST_IMPORT_LINES)
    most = max(len(used) for used in test_structure.uses().values())
    yield Row.of("modules that one module imports, most", most, "1", "<=", test_structure.MOST_IMPORTED)
    thin = [name for name, n in test_structure.folder_sizes().items() if n < test_structure.FEWEST_MODULES]
    yield Row.of(
        "folders below a package of fewer than 3 modules", sum("/" in name for name in thin), "1", "<=", 0.0
    )


def _doors() -> Iterator[Row]:
    """Yield the imports of the command line by what lies below it, and those that the contracts excuse."""
    upward = [
        (user, name)
        for user, used in test_structure.uses().items()
        for name in used
        if name.startswith("firnline.cli") and user.split(".")[0] in BELOW
    ]
    yield Row.of("imports of the command line by packages below it", len(upward), "1", "<=", 0.0)
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    excused = sum(len(contract.get("ignore_imports", ())) for contract in stated["contracts"])
    yield Row.of("imports that contracts excuse", excused, "1", "<=", 0.0)


def _cpu_s(*words: str | Path, **environment: str) -> float:
    """Return the CPU time of a tool of this environment [s], with changed variables of the environment."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    if _failed(*words, **environment):
        raise SystemExit(f"{words[0]} failed; its time would mean nothing.")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _n_lines(tool: str) -> int:
    """Return the number of lines that a tool of this environment prints."""
    done = subprocess.run([BIN / tool], cwd=ROOT, check=False, capture_output=True, text=True)
    if done.returncode and not done.stdout:
        raise SystemExit(f"{tool} ended with exit code {done.returncode}: {done.stderr.strip()}")
    return len(done.stdout.splitlines())


def _failed(*words: str | Path, **environment: str) -> int:
    """Return 1 where a tool of this environment, or a command, fails, and 0 otherwise."""
    command = [BIN / words[0], *words[1:]]
    env = {**os.environ, **environment}
    return int(subprocess.run(command, cwd=ROOT, env=env, check=False, capture_output=True).returncode != 0)


if __name__ == "__main__":
    main("House", measure, ())
