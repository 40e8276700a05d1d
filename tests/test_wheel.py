"""The wheel holds the files that the installed package reads beside its modules."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
READ_AT_RUN_TIME = (".j2", ".css", ".toml", ".pyi", ".typed", ".json", ".csv", ".qml")


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_every_file_beside_the_modules_is_in_the_wheel(names: set[str]) -> None:
    packages = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers")
    beside = {
        str(file.relative_to(ROOT))
        for package in packages
        for file in (ROOT / package).rglob("*")
        if file.suffix in (".py", *READ_AT_RUN_TIME) and "__pycache__" not in file.parts
    }
    assert "survey/reporting/templates/de.toml" in beside
    assert beside - names == set()


def test_the_examples_and_the_licence_are_in_the_wheel(names: set[str]) -> None:
    folder = ROOT / "examples"
    files = [*folder.glob("*.toml"), *folder.glob("*.py"), *folder.glob("notebooks/*.ipynb")]
    assert len(files) > 15
    assert {f"sim/{file.relative_to(ROOT)}" for file in files} - names == set()
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_nothing_else_lies_at_the_top_of_the_wheel(names: set[str]) -> None:
    top = {name.split("/")[0] for name in names}
    assert {name for name in top if not name.endswith(".dist-info")} == {
        "firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers",
    }  # fmt: skip
