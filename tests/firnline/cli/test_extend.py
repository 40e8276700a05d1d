"""``firnline extend``: map, orthoimage, heights, facts and picture of a drive, and refusals with the next step."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, SurfacePoints
from survey.io.raster import read_raster
from tests.vision_slam.tilted_plane import height, write_drive


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("extend")
    write_drive(folder)
    return folder


def extended(place: Path, *options: str) -> str:
    command = [
        "extend",
        str(place / "drive"),
        str(place / "localized"),
        "--reach",
        "20",
        "--grid",
        "2",
        *options,
    ]
    return CliRunner().invoke(app, [*command, "--out", str(place / "beyond")]).output


@pytest.mark.pictures
def test_images_extend_the_map_of_the_scans(place):
    said = extended(place, "--pixel", "0.5")
    out = place / "beyond"
    names = {"map.tif", "orthoimage.tif", "heights.gpkg", "extend.json", "extended.png"}
    assert {file.name for file in out.iterdir()} == names, said
    facts = json.loads((out / "extend.json").read_text())
    heights = SurfacePoints.read(out / "heights.gpkg")
    assert facts["n_heights"] == len(heights)
    assert 0 < facts["n_beyond_scans"] < len(heights)
    assert np.median(np.abs(heights.xyz[:, 2] - height(heights.xyz[:, :2]))) < 0.05
    made = Dem.read(out / "map.tif")
    near = made.at(heights.xyz[:, :2]) - height(heights.xyz[:, :2])
    assert np.nanmedian(np.abs(near)) < 0.05
    assert np.isfinite(read_raster(out / "orthoimage.tif").values).any()
    assert "heights from images:" in said


def test_a_folder_without_landmarks_is_refused(place, tmp_path):
    (tmp_path / "trajectory.csv").write_bytes((place / "localized" / "trajectory.csv").read_bytes())
    done = CliRunner().invoke(
        app, ["extend", str(place / "drive"), str(tmp_path), "-o", str(tmp_path / "out")]
    )
    assert done.exit_code != 0
    assert "no landmarks.gpkg" in done.output
