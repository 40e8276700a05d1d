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
