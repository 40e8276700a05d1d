"""Version, examples, help topics, shell completion and dry runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import shapely
from typer.testing import CliRunner

import firnline
from firnline.cli.main import app
from survey import SurveyArea

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*args: str, code: int = 0):
    result = CliRunner().invoke(app, [*args])
    assert result.exit_code == code, result.output
    return result


def test_the_version_is_that_of_the_package():
    assert run("--version").stdout == f"firnline {firnline.__version__}\n"


def test_examples_are_listed_and_copied():
    listed = run("example").stdout
    rows = [line for line in listed.splitlines() if line.startswith("  ")]
    files = [*(ROOT / "examples").glob("*.toml"), *(ROOT / "examples").glob("*.py")]
    assert sorted(row.split()[0] for row in rows) == sorted(file.stem for file in files)
    assert all(row.endswith(".") for row in rows)
    assert run("examples").stdout == listed
    assert "run: firnline run short_drive.toml" in run("example", "short-drive").stdout
    assert Path("short_drive.toml").read_bytes() == (ROOT / "examples" / "short_drive.toml").read_bytes()
    assert "short_drive.toml exists" in run("example", "short_drive", code=3).stderr
    assert "firnline montecarlo mine.toml" in run("example", "montecarlo_fig10", "-o", "mine.toml").stdout
    assert "there is no example 'nothing'; take " in run("example", "nothing", code=4).stderr


@pytest.mark.parametrize("file", ["two_summers.py", "two_summers.ipynb"])
def test_tutorials_are_copied_as_scripts_and_notebooks(file):
    assert file in run("example", file).stdout
    folder = ROOT / "examples" / ("notebooks" if file.endswith(".ipynb") else "")
    assert Path(file).read_bytes() == (folder / file).read_bytes()


def test_help_explains_topics_and_commands():
    formats = run("help", "FORMATS").stdout
    for ending in (".kmz", ".plan", ".laz", ".hgt", ".qgz"):
        assert ending in formats
    assert "interrupted" in run("help", "exit-codes").stdout
    assert "--set KEY=VALUE" in run("help", "settings").stdout
    assert "Write a file in the format" in run("help", "export").stdout
    assert "topics: formats" in run("help").stdout
    assert "there is no topic or command 'poem'" in run("help", "poem", code=4).stderr


def test_a_shell_completes_commands():
    environment = os.environ | {
        "_FIRNLINE_COMPLETE": "complete_bash",
        "COMP_WORDS": "firnline pl",
        "COMP_CWORD": "1",
        "PYTHONPATH": str(ROOT),
    }
    code = "import sys; sys.argv = ['firnline']; from firnline.__main__ import main; main()"
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert ended.stdout.split() == ["plan"]


def test_a_dry_run_of_a_plan_reads_everything_and_writes_nothing():
    area = SurveyArea(shapely.box(526_000.0, 6_478_000.0, 526_200.0, 6_478_100.0), "EPSG:32608")
    area.write("site.gpkg")
    out = run("plan", "site.gpkg", "--swaths", "3", "-o", "plan.pdf", "--dry-run").stdout
    assert "site.gpkg, 2 ha, WGS 84 / UTM zone 8N" in out
    assert "lawnmower, 1 rover" in out
    assert "plan.pdf, plan.geojson, plan_sigma.tif" in out
    assert [file.name for file in Path().iterdir()] == ["site.gpkg"]
    assert "does not exist" in run("plan", "other.gpkg", "--dry-run", code=3).stderr
    assert run("plan", "site.gpkg", "--set", "rover.speed=2", "--dry-run", code=4).stderr


def test_a_dry_run_of_a_mission_names_its_folder_and_stages():
    run("init", "mine.toml")
    out = run("run", "mine.toml", "--runs", "runs", "--dry-run").stdout
    assert out.splitlines()[0].startswith("  run                runs/mine/")
    assert "  to do              plan, simulate, localize, reconstruct, score, report" in out
    assert not Path("runs").exists()
    assert run("run", "mine.toml", "--set", "planner.swathes=3", "--dry-run", code=4).stderr


def test_examples_in_help_stand_on_one_line_each():
    """A pasted example of two lines would be two commands."""
    for command in app.registered_commands:
        name = command.name or command.callback.__name__
        written = [line.strip() for line in command.callback.__doc__.splitlines()]
        shown = [line.strip() for line in run(name, "--help").stdout.splitlines()]
        for example in (line for line in written if line.startswith("firnline ")):
            assert example in shown
