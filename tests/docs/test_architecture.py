"""The architecture picture shows the folders that there are."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("firnline", "desk", "sim", "planners", "vision_slam", "survey")


@pytest.mark.parametrize("package", PACKAGES)
def test_the_picture_names_every_package_and_its_folders(package):
    svg = (ROOT / "docs" / "images" / "architecture.svg").read_text(encoding="utf-8")
    shown = {name.strip() for name in re.findall(r">([^<>]+)</text>", svg)}
    folders = {file.parent.name for file in (ROOT / package).glob("*/__init__.py")}
    assert {package} | folders <= shown, "run python docs/architecture.py"
