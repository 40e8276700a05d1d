"""Structure of the code: sizes of folders, files and functions, and names that stand for one thing.

A function's length is that of its body: lines after the signature, without the docstring, blank lines
and comments. The docstrings are not counted because numpydoc sections make those of public functions longer than
their bodies. A file's length counts all its lines but those of docstrings; with them, nine files of ten have at most
250. ``python -m tests.test_structure`` prints the measures.
"""

import ast
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers")
MOST_FILES = 15
FILE_P90, FILE_P90_WITH_DOCSTRINGS = 220, 250
FUNCTION_P90 = 17
LONGEST_FUNCTION = 45
LEAST_NAMED_BY_TESTS = 0.7


def files() -> list[Path]:
    return sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py"))


@cache
def trees() -> list[tuple[Path, ast.Module, list[str]]]:
    texts = [(file, file.read_text(encoding="utf-8")) for file in files()]
    return [(file, ast.parse(text), text.splitlines()) for file, text in texts]


def code_lines(function: ast.FunctionDef | ast.AsyncFunctionDef, lines: list[str]) -> int:
    """Return the number of lines of a function's body, without docstring, blank lines and comments."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    if not body:
        return 0
    stripped = (line.strip() for line in lines[body[0].lineno - 1 : function.end_lineno])
    return sum(bool(line) and not line.startswith("#") for line in stripped)


def function_lengths() -> dict[str, int]:
    found = {}
    for file, tree, lines in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                found[f"{file.relative_to(ROOT)}:{node.lineno} {node.name}"] = code_lines(node, lines)
    return found


def docstring_lines(tree: ast.Module) -> int:
    """Return the number of lines of all docstrings, those of fields included."""
    texts = [
        node for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    ]
    return sum((text.end_lineno or text.lineno) - text.lineno + 1 for text in texts)


def file_lengths() -> dict[str, int]:
    return {str(file.relative_to(ROOT)): len(lines) - docstring_lines(tree) for file, tree, lines in trees()}


def folder_sizes() -> Counter[str]:
    return Counter(str(file.parent.relative_to(ROOT)) for file in files() if file.name != "__init__.py")


def class_places() -> dict[str, set[str]]:
    """Return the modules that define each public class or type alias of a module's top level."""
    places = defaultdict(set)
    for file, tree, _ in trees():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].add(str(file.relative_to(ROOT)))
    return places


@cache
def without_tests() -> list[str]:
    """Return the modules with code that no test file is named after, no test imports, and that hold no example.

    What they do is tested through the functions that use them.
    """
    tests = sorted((ROOT / "tests").rglob("*.py"))
    text = "\n".join(file.read_text(encoding="utf-8") for file in tests)
    found = []
    for file, tree, lines in trees():
        place = file.relative_to(ROOT)
        defines = any(isinstance(node, ast.FunctionDef | ast.ClassDef) for node in tree.body)
        has_own = ROOT / "tests" / place.with_name(f"test_{place.name}") in tests
        is_named = ".".join(place.with_suffix("").parts) in text
        if defines and not (has_own or is_named or any(">>>" in line for line in lines)):
            found.append(str(place))
    return found


def test_folders_hold_at_most_fifteen_files():
    crowded = {folder: n for folder, n in folder_sizes().items() if n > MOST_FILES}
    assert not crowded


def test_every_class_name_stands_for_one_class():
    assert not {name: places for name, places in class_places().items() if len(places) > 1}


def test_files_are_short():
    assert np.percentile(list(file_lengths().values()), 90) <= FILE_P90
    raw = [len(lines) for _, _, lines in trees()]
    assert np.percentile(raw, 90) <= FILE_P90_WITH_DOCSTRINGS


def test_functions_are_short():
    lengths = function_lengths()
    assert np.percentile(list(lengths.values()), 90) <= FUNCTION_P90
    assert not {name: n for name, n in lengths.items() if n > LONGEST_FUNCTION}


def test_most_modules_are_named_by_a_test_or_hold_an_example():
    assert 1.0 - len(without_tests()) / len(trees()) >= LEAST_NAMED_BY_TESTS


def test_every_folder_says_what_it_holds():
    silent = [
        str(file.relative_to(ROOT))
        for file, tree, _ in trees()
        if file.name == "__init__.py" and not ast.get_docstring(tree)
    ]
    assert not silent


if __name__ == "__main__":
    lengths, sizes = function_lengths(), file_lengths()
    print("functions: median, p90, longest", *np.percentile(list(lengths.values()), [50, 90, 100]))  # noqa: T201
    print("files: median, p90, longest", *np.percentile(list(sizes.values()), [50, 90, 100]))  # noqa: T201
    for title, table in (("functions", lengths), ("files", sizes), ("folders", dict(folder_sizes()))):
        print(title, *sorted(table.items(), key=lambda item: -item[1])[:12], sep="\n  ")  # noqa: T201
    print("modules that no test names", *without_tests(), sep="\n  ")  # noqa: T201
