"""Structure of the code by the measures of its own tests: folders, lengths, names, circles, docstrings, copies."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.report import Row, main
from tests import test_docstrings, test_repetition, test_structure

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
COPYING = (
    "tests/firnline/test_objects.py::test_every_public_type_is_pickled_copied_and_compared",
    "tests/firnline/test_package_types.py::test_every_exported_type_is_pickled_and_copied",
)


RECIPES = ("-m", "walkthrough", "tests/docs/test_recipes.py")


def measure(quick: bool) -> Iterator[Row]:
    """Yield the sizes, then what tools find; quick leaves out what runs tests."""
    yield from _sizes()
    ambiguous = [name for name, places in test_structure.class_places().items() if len(places) > 1]
    yield Row.of("class names that stand for two things", len(ambiguous), "1", "<=", 0.0)
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


def _sizes() -> Iterator[Row]:
    """Yield the sizes of folders, files and functions."""
    folders, lengths = test_structure.folder_sizes(), list(test_structure.function_lengths().values())
    files = [len(lines) for _, _, lines in test_structure.trees()]
    yield Row("files", len(files), "1")
    yield Row.of("most files directly in a folder", max(folders.values()), "1", "<=", 15.0)
    yield Row.of("lines of a file, 90th percentile", float(np.percentile(files, 90)), "1", "<=", 250.0)
    yield Row("files of more than 250 lines", sum(n > 250 for n in files), "1")
    body = "lines of a function's body"
    yield Row.of(f"{body}, 90th percentile", float(np.percentile(lengths, 90)), "1", "<=", 17.0)
    yield Row.of(f"{body}, longest", max(lengths), "1", "<=", 45.0)


def _n_lines(tool: str) -> int:
    """Return the number of lines that a tool of this environment prints."""
    done = subprocess.run([BIN / tool], cwd=ROOT, check=False, capture_output=True, text=True)
    if done.returncode and not done.stdout:
        raise SystemExit(f"{tool} ended with exit code {done.returncode}: {done.stderr.strip()}")
    return len(done.stdout.splitlines())


def _failed(*words: str | Path) -> int:
    """Return 1 where a tool of this environment, or a command, fails, and 0 otherwise."""
    command = [BIN / words[0], *words[1:]]
    return int(subprocess.run(command, cwd=ROOT, check=False, capture_output=True).returncode != 0)


if __name__ == "__main__":
    main("House", measure, ())
