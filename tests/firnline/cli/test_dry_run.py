"""Dry runs: every command that writes checks its input, prints what it would do and writes nothing."""

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from benchmarks.small_inputs import IDEAL_MISSION
from firnline.cli.main import app
from survey.data.route import Leg, Route
from tests.docs.scratch import make_scratch
from tests.firnline.cli.test_pages_in_browser import STUDY

# Commands that only print, the desk, which writes what is drawn, and those that need a rover.
WITHOUT = {"desk", "doctor", "download", "fit", "help", "rover", "schema", "show", "watch"}
RUNS = {
    "calibrate": "images --board 9x6 -o camera.toml",
    "change": "2026.tif 2024.tif --outline glacier.gpkg -o change --report change.pdf",
    "counts": "gamma.csv --crs EPSG:32608 --source radiation -o gamma",
    "example": "short-drive",
    "extend": "scanned localized --reach 20 -o beyond",
    "export": "map.tif map.nc",
    "export points": "landmarks.csv landmarks.ply --crs EPSG:32608",
    "init": "other.toml --dem srtm.tif",
    "localize": "images --frame-rate 10 --camera camera/camera.toml -o localization",
    "montecarlo": "study.toml",
    "overhangs": "serac.ply -o serac",
    "payload": "air.csv --name air --unit degC --terrain lidar.tif",
    "plan": "site.kml --prior srtm.tif -o plan.pdf",
    "plan mission": "mission.toml",
    "reconstruct": "landmarks.csv --crs EPSG:32608 --prior srtm.tif --grid 20",
    "reconstruct mission": "mission.toml",
    "rehearse": "mission.toml --count 2",
    "report": "mission.toml",
    "reproduce": "glacier-fig10 -o figures",
    "reroute": "line.geojson seen.csv",
    "run": "mission.toml",
    "score": "map.tif --checkpoints gnss.csv --class 0.1 --report accuracy",
    "score raster": "map.tif --truth lidar.tif",
    "simulate": "mission.toml",
    "track": "2024.tif 2026.tif --days 730 --window 21 --search 5 -o velocity.gpkg",
    "upload": "route.geojson udp://127.0.0.1:9",
}
CAMERA = """
model = "pinhole"
width = 64
height = 48
matrix = [[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
T_body_camera = [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.7], [0.0, 0.0, 0.0, 1.0]]
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of small files with a mission, a study and three images."""
    import cv2
    import numpy as np

    folder = tmp_path_factory.mktemp("dry")
    make_scratch(folder)
    swath = Leg("swath", np.array([[500_050.0, 6_700_300.0], [500_450.0, 6_700_300.0]]))
    Route((swath,), "EPSG:32608", "line").write(folder / "route.geojson")
    (folder / "mission.toml").write_text(IDEAL_MISSION)
    (folder / "study.toml").write_text(STUDY)
    rows = [f"{500_050 + 10 * k},{6_700_300},{1.0 + 0.01 * k}\n" for k in range(40)]
    (folder / "air.csv").write_text("easting_m,northing_m,air\n" + "".join(rows))
    (folder / "camera").mkdir()
    (folder / "camera" / "camera.toml").write_text(CAMERA)
    (folder / "images").mkdir()
    for k in range(3):
        grey = np.random.default_rng(k).integers(0, 255, (48, 64), dtype=np.uint8)
        cv2.imwrite(str(folder / "images" / f"{k:04d}.png"), grey)
    return folder


@pytest.mark.parametrize("name", RUNS)
def test_a_dry_run_writes_nothing(place: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(place)
    before = {file: file.stat().st_mtime_ns for file in place.rglob("*")}
    done = CliRunner().invoke(app, [name.split(maxsplit=1)[0], *RUNS[name].split(), "--dry-run"])
    assert done.exit_code == 0, done.output
    assert done.stdout.endswith("nothing was written (--dry-run)\n")
    assert "  would write " in done.stdout
    assert {file: file.stat().st_mtime_ns for file in place.rglob("*")} == before


def test_every_command_that_writes_has_a_dry_run() -> None:
    every = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    commands = {name: command for name, command in every.items() if not command.hidden}
    with_it = {
        name
        for name, command in commands.items()
        if any("--dry-run" in option.opts for option in command.params)
    }
    assert set(commands) - with_it == WITHOUT
    assert {name.split()[0] for name in RUNS} == with_it


@pytest.mark.parametrize(
    "words",
    [
        "change 2026.tif 2024.tif --outline nowhere.gpkg",
        "export landmarks.csv landmarks.ply",
        "reconstruct landmarks.csv",
        "score map.tif --checkpoints nowhere.csv",
        "localize nowhere",
        "plan site.geojson --swaths 6 --rovers 2",
        "run mission.toml --set fleet.rovers=2",
    ],
)
def test_a_dry_run_refuses_what_the_command_refuses(
    place: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    monkeypatch.chdir(place)
    for options in ([], ["--dry-run"]):
        done = CliRunner().invoke(app, [*words.split(), *options])
        assert done.exit_code == 3, done.output
