"""Every refusal that a reader raises names the option, column or file that helps; all of them are found in the sources."""

import ast
import re
from pathlib import Path

import pytest

import survey

ROOT = Path(survey.__file__).parent
READERS = sorted(file for folder in ("io", "interchange") for file in (ROOT / folder).rglob("*.py"))
NAMED = re.compile(
    r"--[a-z]|-[a-z_]+\)|column|attribute|\bfile\b|\bfolder\b|gdal|`|\.json|\.toml|crs=|"
    r"\{[^}]*(file|path|where|source|folder|out|target|name|place|what)[^}]*\}",
    re.IGNORECASE,
)


def text_of(node: ast.expr) -> str:
    """Return a message with its replaced parts in braces."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return "{" + ast.unparse(node.value) + "}"
    return "{" + ast.unparse(node) + "}"


def refusals() -> list[tuple[str, str]]:
    """Return place and text of every refusal in the readers."""
    found = []
    for file in READERS:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args
            if is_call and node.func.id in ("InputError", "CapacityError"):
                found.append((f"{file.relative_to(ROOT)}:{node.lineno}", text_of(node.args[0])))
    return found


def test_the_readers_have_refusals() -> None:
    assert len(refusals()) > 150


@pytest.mark.parametrize(("place", "text"), refusals())
def test_a_refusal_names_what_helps(place: str, text: str) -> None:
    assert NAMED.search(text), f"{place} names no option, column or file: {text}"


def test_a_refusal_that_names_nothing_is_found() -> None:
    assert not NAMED.search("the speed is {speed_m_s}; a number above 0 was expected.")
