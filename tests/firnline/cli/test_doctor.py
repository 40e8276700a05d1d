"""The doctor checks what the demos need, and states what will not run."""

import json
import re
from importlib.metadata import PackageNotFoundError

import pytest
from matplotlib.font_manager import fontManager
from typer.testing import CliRunner

from firnline.cli.diagnosis import disk_finding, memory_finding
from firnline.cli.main import app


def doctor(*args: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["doctor", *args])
    return done.exit_code, done.stdout


def test_all_that_the_demos_need_is_checked() -> None:
    code, said = doctor("--json")
    rows = {row["what"]: row for row in json.loads(said)}
    assert code == 0
    assert {
        "Python", "numpy", "physics engine", "memory", "disk", "threads", "fonts", "compiled loops", "temporary files", "GDAL",
    } <= set(rows)  # fmt: skip
    assert "both demos will run" in doctor()[1]


def test_a_missing_physics_engine_names_the_demo_that_will_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.vehicle.rigid_bodies.find_spec", lambda _: None)
    code, said = doctor()
    assert code == 1
    assert "LOOK  physics engine" in said
    assert "will not run: the second demo (short_drive)" in said


def test_a_missing_package_is_named_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(name: str) -> str:
        if name == "scipy":
            raise PackageNotFoundError(name)
        return "99"

    monkeypatch.setattr("firnline.cli.diagnosis.version", found)
    code, said = doctor()
    assert code == 1
    assert "LOOK  scipy                    missing; install firnline again" in said


def test_little_memory_or_disk_is_said_with_the_need() -> None:
    assert memory_finding(2**30).found == "1.0 GiB; the demos need 2 GiB"
    assert not memory_finding(2**30).is_well
    assert memory_finding(8 * 2**30).is_well
    assert disk_finding(10 * 2**20).prevents == "the demos"


def test_an_incomplete_list_of_fonts_is_said_with_the_file_to_delete(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    listed = [font for font in fontManager.ttflist if font.name != "STIXGeneral"]
    monkeypatch.setattr(fontManager, "ttflist", listed)
    code, said = doctor()
    assert code == 0
    assert re.search(r"fonts .*lacks \d+ of its own, such as STIX\w+; delete", said)


def test_a_folder_for_compiled_loops_that_is_named_but_missing_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/missing/folder")
    code, said = doctor()
    assert code == 0
    assert "every start compiles for a minute; set NUMBA_CACHE_DIR" in said
