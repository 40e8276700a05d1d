"""The architecture picture shows the packages that there are."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_picture_names_every_package():
    svg = (ROOT / "docs" / "images" / "architecture.svg").read_text(encoding="utf-8")
    shown = {name.strip().split(".")[0] for name in re.findall(r">([^<>]+)</text>", svg)}
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = set(stated["tool"]["importlinter"]["root_packages"])
    assert packages <= shown, "run python docs/architecture.py"


def named_places() -> set[tuple[str, str]]:
    """Return each file that the page names, with the functions and classes that stand behind it."""
    page = (ROOT / "docs" / "project" / "architecture.md").read_text(encoding="utf-8")
    found = re.findall(r"`([a-z_]+(?:/[a-z_0-9]+)*/[a-z_0-9]+\.py)`((?: `\w+`)*)", page)
    return {(file, name) for file, names in found for name in (re.findall(r"\w+", names) or [""])}


def test_the_page_names_files_and_functions_that_there_are():
    places = named_places()
    assert len(places) > 20
    wrong = set()
    for file, name in places:
        path = ROOT / file
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        if not text or (name and not re.search(rf"^\s*(?:def|class) {name}\b", text, re.MULTILINE)):
            wrong.add((file, name))
    assert not wrong
