"""A roboticist's first day: photographs of a phone, a board to calibrate with, a phone's log, a notebook."""

import subprocess
from pathlib import Path

import pytest

from tests.docs.scratch_drives import N_IMAGES, make_drives
from tests.first_day.conftest import Firnline

pytestmark = pytest.mark.walkthrough


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with photographs of a phone, frames of a video with a table of fixes, and images of a board."""
    folder = tmp_path_factory.mktemp("recorded")
    make_drives(folder, "phone-photos video-frames fixes.csv board-photos")
    return folder


def test_photographs_of_a_phone_become_a_path_with_pictures_and_a_next_step(
    firnline: Firnline, recorded: Path, here: Path
) -> None:
    said = firnline("localize", str(recorded / "phone-photos"), "-o", "path", "-q").stdout
    assert "times are those of EXIF" in said
    assert "pixels from EXIF" in said
    assert "fixes from EXIF" in said
    assert f"  poses              {N_IMAGES}" in said
    assert "  next               firnline reconstruct path/landmarks.gpkg --prior DEM.tif" in said
    files = {file.name for file in (here / "path").iterdir()}
    assert {"map.png", "tracks.png", "landmarks.gpkg", "trajectory.tum"} <= files


def test_a_table_of_fixes_is_read_with_named_columns_that_are_printed_back(
    firnline: Firnline, recorded: Path
) -> None:
    fixes = ("--gps", str(recorded / "fixes.csv"), "--columns", "time=t,lat=phi,lon=lambda")
    said = firnline(
        "localize", str(recorded / "video-frames"), "--frame-rate", "4",
        "--camera", str(recorded / "camera.toml"), *fixes, "-o", "path", "-q",
    ).stdout  # fmt: skip
    assert "fixes.csv: columns read as time = t, longitude = lambda, latitude = phi" in said


def test_a_camera_is_calibrated_from_a_chessboard(firnline: Firnline, recorded: Path, here: Path) -> None:
    board = ("--board", "9x6", "--square-mm", "20")
    said = firnline("calibrate", str(recorded / "board-photos"), *board, "-q").stdout
    assert said.startswith("written to camera.toml, camera.png")
    assert " ± " in said
    assert "sigma" in (here / "camera.toml").read_text()


def test_maps_show_themselves_in_a_notebook(command: list[str], site: Path) -> None:
    python = command[0] if command[-2:] == ["-m", "firnline"] else str(Path(command[0]).with_name("python"))
    program = "from firnline import Dem; print('<img' in Dem.read('map.tif')._repr_html_())"
    done = subprocess.run([python, "-c", program], cwd=site, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
