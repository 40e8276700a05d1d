"""Repeated code: no six lines in a row stand in two places of the packages, tests, benchmarks, docs or examples.

Docstrings, imports, signatures, comments and blank lines are not counted: numpydoc describes the same parameter
wherever it is taken, and functions that can be exchanged have the same signature.
``python -m tests.test_repetition`` prints the places of equal runs.
"""

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (
    "firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers", "benchmarks", "docs", "examples", "tests",
)  # fmt: skip
N_LINES = 6


def uncounted(tree: ast.Module) -> Iterator[range]:
    """Yield the line numbers of docstrings, imports and signatures."""
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if is_text or isinstance(node, ast.Import | ast.ImportFrom):
            yield range(node.lineno, (node.end_lineno or node.lineno) + 1)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            yield range(first, node.body[0].lineno)


def counted_lines(text: str) -> list[tuple[int, str]]:
    """Return the lines of code with their numbers."""
    left_out = {number for lines in uncounted(ast.parse(text)) for number in lines}
    stripped = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [
        (number, line)
        for number, line in stripped
        if line and not line.startswith("#") and number not in left_out
    ]


def repeated(texts: dict[str, str]) -> list[list[str]]:
    """Return the places of each run of equal lines, by file and line."""
    places = defaultdict(list)
    for name, text in texts.items():
        lines = counted_lines(text)
        for k in range(len(lines) - N_LINES + 1):
            run = tuple(line for _, line in lines[k : k + N_LINES])
            places[run].append(f"{name}:{lines[k][0]}")
    return [found for found in places.values() if len(found) > 1]


def texts_of_the_project() -> dict[str, str]:
    names = (file.relative_to(ROOT) for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py")))
    # Built documentation holds copies of the examples.
    return {
        str(name): (ROOT / name).read_text(encoding="utf-8")
        for name in names
        if name.parts[:2] not in {("docs", "gallery"), ("docs", "_build")}
    }


def test_equal_lines_are_found_whatever_their_indentation_and_documentation():
    body = "\n".join(f"    x{k} = {k}" for k in range(6))
    first, second = f'def f(a):\n    """Say one."""\n{body}\n', f"def g(a):\n    # Two.\n{body}\n"
    assert repeated({"a.py": first, "b.py": second}) == [["a.py:3", "b.py:3"]]
    assert not repeated({"a.py": first, "b.py": second.replace("x3", "y3")})


def test_no_code_stands_twice():
    assert not repeated(texts_of_the_project())


if __name__ == "__main__":
    for found in repeated(texts_of_the_project()):
        print(*found)  # noqa: T201
