"""A file that does not exist is named before anything is loaded to read it, in the words of its reader."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from tests.docs.scratch import make_scratch
from tests.firnline.cli.test_imports import PROGRAM

COMMANDS = (
    "plan none.gpkg --swaths 4",
    "plan site.geojson --prior none.tif --swaths 4",
    "plan none.toml",
    "reconstruct none.csv --crs EPSG:32608",
    "reconstruct none.toml",
    "reconstruct landmarks.csv --crs EPSG:32608 --prior none.tif",
    "score none.tif --truth lidar.tif",
    "score lidar.tif --truth none.tif",
    "score lidar.tif --checkpoints none.csv",
    "score 2026.tif --truth 2024.tif --area none.gpkg",
    "score 2026.tif --truth 2024.tif --route none.geojson",
    "change none.tif lidar.tif",
    "change lidar.tif none.tif",
    "change 2026.tif 2024.tif --outline none.gpkg",
    "run none.toml",
    "simulate none.toml",
    "rehearse none.toml",
    "montecarlo none.toml",
    "report none.toml",
    "counts none.csv --crs EPSG:32608",
    "track none.tif lidar.tif --days 3",
    "track lidar.tif none.tif --days 3",
    "payload landmarks.csv --name a --unit degC --terrain none.tif",
    "reroute none.geojson landmarks.csv --at 1,2",
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("missing")
    make_scratch(folder)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_missing_file_is_refused_in_the_words_of_its_reader(
    command: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    early = CliRunner().invoke(app, command.split())
    monkeypatch.setattr("firnline.cli.request.require_inputs", lambda _: None)
    late = CliRunner().invoke(app, command.split())
    assert early.exit_code == late.exit_code == 3
    assert early.output == late.output
    assert "does not exist; check the path" in early.output


def test_nothing_is_loaded_to_refuse_a_missing_recording(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, "localize", "none.bag"], cwd=tmp_path, capture_output=True, text=True
    )
    code, modules = json.loads(run.stdout.splitlines()[-1])
    assert code == 3
    assert "the recording none.bag does not exist" in run.stderr
    assert not {"numpy", "scipy", "cv2", "numba", "matplotlib"} & set(modules)
