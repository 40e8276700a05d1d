"""``firnline localize`` on someone else's images, and what it refuses."""

import json
import resource
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from pyproj import CRS
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from vision_slam import recorded_drive
from vision_slam.drive_estimate import Localization
from vision_slam.pipeline import localize


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """Five images in KITTI's layout, of a speckled wall 12 m ahead that comes nearer by 0.5 m each time."""
    folder = tmp_path / "street"
    (folder / "image_0").mkdir(parents=True)
    speckle = cv2.GaussianBlur(
        np.random.default_rng(1).normal(size=(400, 600)).astype(np.float32), (0, 0), 2.0
    )
    wall = (128 + 40 * speckle / speckle.std()).clip(0, 255).astype(np.uint8)
    for k in range(5):
        zoom = 12.0 / (12.0 - 0.5 * k)
        grown = np.array([[zoom, 0.0, 160 - 300 * zoom], [0.0, zoom, 120 - 200 * zoom]])
        cv2.imwrite(str(folder / "image_0" / f"{k:06d}.png"), cv2.warpAffine(wall, grown, (320, 240)))
    (folder / "calib.txt").write_text("P0: 240 0 160 0 0 240 120 0 0 0 1 0")
    (folder / "poses.txt").write_text("\n".join(f"1 0 0 0 0 1 0 0 0 0 1 {0.5 * k}" for k in range(5)))
    return folder


@pytest.mark.pictures
def test_writes_path_and_health_of_a_foreign_sequence(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["localize", str(street), "--scale-from", "1", "-o", str(out), "-q", "--json"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    assert summary["poses"] == 5
    # A wall hardly distinguishes sideways motion from turning: a tenth of the 2 m.
    assert summary["end_error_m"] < 0.2
    assert {
        "scale_error_per_cent",
        "scale_drift_per_cent",
        "rpe_per_cent",
        "yaw_rms_deg",
        "nees_2d",
    } <= summary.keys()
    assert {file.name for file in out.iterdir()} == {
        *("trajectory.tum", "path.csv", "landmarks.csv", "health.csv", "map.png", "tracks.png", "errors.png")
    }
    assert len((out / "health.csv").read_text().splitlines()) == 6
    again = CliRunner().invoke(app, words)
    assert again.exit_code == 3
    assert "--force" in again.stderr


def test_fixes_in_metres_without_a_crs_are_a_wrong_configuration(street: Path, tmp_path: Path) -> None:
    fixes = tmp_path / "a.csv"
    fixes.write_text("time_s,easting_m,northing_m,height_m\n0.0,5e5,6e6,1.0\n0.2,5e5,6e6,1.0\n")
    result = CliRunner().invoke(
        app, ["localize", str(street), "--gps", str(fixes), "-o", str(tmp_path / "o"), "-q"]
    )
    assert result.exit_code == 4
    assert "--crs" in result.stderr


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (["--camera", "nowhere.toml"], 3, "nowhere.toml does not exist"),
        (["--gps", "nowhere.nmea"], 3, "nowhere.nmea does not exist"),
        (["--reference", "nowhere.tum"], 3, "nowhere.tum does not exist"),
        (["--scale-from", "99"], 3, "cannot give the scale"),
        (["--set", "localization.gps_bias_m=3.0"], 4, "gps_bias_m"),
        (["--topic", "/image"], 4, "is no bag"),
        (["--crs", "EPSG:32608"], 4, "holds no fixes"),
        (["--set", "planner.swaths=4"], 4, "localize takes only localization"),
    ],
)
def test_wrong_options_are_refused_before_any_image_is_read(
    street: Path, tmp_path: Path, words: list[str], code: int, sentence: str
) -> None:
    result = CliRunner().invoke(app, ["localize", str(street), *words, "-o", str(tmp_path / "o")])
    assert result.exit_code == code
    assert sentence in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "o").exists()


def test_the_help_has_examples_of_every_kind_of_recording() -> None:
    words = CliRunner().invoke(app, ["localize", "--help"]).stdout
    for word in ("recording", "KITTI", "--gps", "--camera", "--topic", ".bag", "--viewer"):
        assert word in words


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Thirty metres on a straight line, with recorded odometry, exact fixes and one landmark a metre."""
    n = 30
    times = np.arange(float(n))
    place = np.column_stack([times, np.zeros(n), np.zeros(n)]) + [5e5, 6e6, 100.0]
    odometry = Odometry(times, np.tile([1.0, 0.0, 0.0], (n - 1, 1)), np.zeros((n, 3)))
    ahead = np.tile([3.0, 1.0, -0.1], (n, 1))
    sightings = Sightings(np.arange(n), ahead, np.tile(1e-4 * np.eye(3), (n, 1, 1)), np.full(n, 8.0))
    made = Recording(
        crs=CRS.from_epsg(32608),
        start=place[0],
        gps=GpsFixes(times, place),
        odometry=odometry,
        sightings=sightings,
    )
    made.write(tmp_path / "recording")
    return tmp_path / "recording"


def test_a_replacement_that_fails_leaves_the_old_folder_whole(recording: Path, tmp_path: Path) -> None:
    words = ["localize", str(recording), "-o", str(tmp_path / "out"), "-q", "--force"]
    assert CliRunner().invoke(app, words).exit_code == 0
    before = {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(
        resource.RLIMIT_FSIZE, (1000, limits[1])
    )  # files end after 1000 bytes, as on a full disk
    try:
        result = CliRunner().invoke(app, words)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert result.exit_code == 3, result.output
    assert {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()} == before
    assert sorted(item.name for item in tmp_path.iterdir()) == ["out", "recording"]


def test_files_of_others_in_the_output_folder_are_never_deleted(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("mine")
    result = CliRunner().invoke(
        app, ["localize", str(recording), "-o", str(tmp_path / "out"), "-q", "--force"]
    )
    assert result.exit_code == 3
    assert (tmp_path / "out" / "thesis.txt").read_text() == "mine"


def test_refused_fixes_are_counted_and_printed(recording: Path, tmp_path: Path) -> None:
    fixes = GpsFixes.read(recording / "gps.csv")
    jumped = fixes.position + np.isin(np.arange(30), [12, 13])[:, None] * [40.0, 0.0, 0.0]
    (recording / "gps.csv").unlink()
    GpsFixes(fixes.time_s, jumped).write(recording / "gps.csv")
    result = CliRunner().invoke(
        app, ["localize", str(recording), "-o", str(tmp_path / "out"), "-q", "--json"]
    )
    printed = json.loads(result.stdout)
    assert (printed["fixes"], printed["fixes_refused"]) == (30, 2)


@pytest.mark.pictures
def test_localizes_an_own_recording(recording: Path, tmp_path: Path) -> None:
    n = 30
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["localize", str(recording), "-o", str(out), "-q", "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["landmarks"] == n
    thinned = [
        *("localize", str(recording), "-o", str(out), "-q", "--json", "--force"),
        *(
            "--set",
            'localization.landmark_thinning="information"',
            "--set",
            "localization.landmarks_per_m=0.5",
        ),
    ]
    summary = json.loads(CliRunner().invoke(app, thinned).stdout)
    assert summary["landmarks"] == round(0.5 * summary["length_m"])
    names = {file.name for file in out.iterdir()}
    assert {"trajectory.tum", "trajectory.csv", "track.gpkg", "landmarks.csv", "map.png"} <= names
    wrong = CliRunner().invoke(
        app, ["localize", str(recording), "--crs", "EPSG:32608", "-o", str(tmp_path / "o")]
    )
    assert wrong.exit_code == 4
    assert "of its own" in wrong.stderr


@pytest.mark.pictures
def test_no_landmarks_are_written_where_the_path_is_that_of_the_fixes(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def contradicted(*words: Any, **options: Any) -> Localization:
        return replace(localize(*words, **options), landmarks_hold=False)

    words = ["localize", str(recording), "-o", str(tmp_path / "out"), "-q", "--force"]
    before = CliRunner().invoke(app, words)
    assert "firnline reconstruct" in before.output
    monkeypatch.setattr(recorded_drive, "localize", contradicted)
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "reconstruct" not in result.output
    assert "correct calibration or times" in result.output
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert {"trajectory.csv", "track.gpkg", "map.png"} <= names
    assert not {"landmarks.csv", "landmarks.gpkg"} & names


@pytest.mark.pictures
def test_photographs_of_a_phone_are_localized_from_their_own_exif(street: Path, tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    for k in range(5):
        exif = Image.Exif()
        taken = {36867: "2024:06:12 12:00:00", 37521: f"{k}0", 36881: "+02:00", 41989: 32}
        exif.get_ifd(0x8769).update(taken)
        picture = Image.open(street / "image_0" / f"{k:06d}.png")
        picture.save(photos / f"IMG_20240612_120000_{k + 8}.jpg", quality=95, exif=exif)  # 8, 9, 10, 11, 12
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["localize", str(photos), "-o", str(out), "-q"])
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "times are those of EXIF" in said
    assert "pixels from EXIF (equivalent of 32 mm on 35 mm film)" in said
    assert f"pictures {out / 'map.png'}, {out / 'tracks.png'}" in said
    assert "next name fixes with --gps" in said
    times = np.loadtxt(out / "trajectory.tum")[:, 0]
    np.testing.assert_allclose(np.diff(times), 0.1, atol=1e-3)
