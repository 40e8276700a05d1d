"""A folder of someone's images with a phone's fixes, from its files to path, pictures and viewer."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from survey.core.errors import ConfigError, InputError
from survey.data.camera import Camera
from survey.data.sensors.records import Wheels
from survey.data.trajectory import Trajectory
from survey.figures.style import write_pictures
from tests.printing import assert_printable
from vision_slam.plotting import tracks_on_frames
from vision_slam.recorded_drive import RecordedDrive
from vision_slam.recordings import open_recording
from vision_slam.results import (
    draw_localization,
    refuse_without_rerun,
    write_localization,
    write_rrd,
)

UTM = "EPSG:32608"
STEP_M, N = 0.5, 48
HEADING = np.radians(30.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, plane_world: object, camera: Camera) -> Path:
    """Forty-eight images, 0.5 m apart on a straight line that heads 30° north of east; a fix at every second one."""
    place = tmp_path_factory.mktemp("walk")
    camera.write(place / "camera.toml")
    (place / "images").mkdir()
    pose = np.eye(4)
    lines = ["time_s,easting_m,northing_m,height_m"]
    noise = np.random.default_rng(2)
    for k in range(N):
        pose[0, 3] = (
            0.25 * STEP_M * k
        )  # the ground's texture is 20 m long: draw a quarter of the world's size
        time_s = 1000.0 + 0.25 * k
        cv2.imwrite(str(place / "images" / f"{time_s:.2f}.png"), plane_world.image(pose))  # type: ignore[attr-defined]
        if k % 2 == 0:
            east, north = STEP_M * k * np.array([np.cos(HEADING), np.sin(HEADING)]) + noise.normal(
                0.0, 0.1, 2
            )
            lines.append(f"{time_s},{500000.0 + east},{6470000.0 + north},50.0")
    (place / "phone.csv").write_text("\n".join(lines) + "\n")
    return place


@pytest.fixture(scope="module")
def drive(folder: Path) -> RecordedDrive:
    return open_recording(folder, gps=folder / "phone.csv", crs=UTM)


def test_what_is_left_out_of_a_reference_of_fixes_is_logged(
    drive: RecordedDrive, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = ("1000,500000,6470000,5", "1001,500000,6470001,nan", "1002,500000,6470002,5")
    (tmp_path / "rtk.csv").write_text("\n".join(["time_s,easting_m,northing_m,height_m", *rows, ""]))
    reference = drive.read_reference(tmp_path / "rtk.csv")
    assert reference.time_s.tolist() == [1000.0, 1002.0]
    assert "rtk.csv: 1 fixes whose place or error is no finite number are left out" in caplog.text


def test_images_without_wheels_take_scale_and_heading_from_the_fixes(
    drive: RecordedDrive, tmp_path: Path
) -> None:
    localized = drive.localize()
    end = localized.position[-1] - [500000.0, 6470000.0, 50.0]
    length_m = STEP_M * (N - 1)
    # 24 fixes of 0.1 m on 24 m place the ends to a few centimetres; 0.5 m is what the smoother's own σ allows.
    assert np.linalg.norm(end[:2] - length_m * np.array([np.cos(HEADING), np.sin(HEADING)])) < 0.5
    assert localized.length_m == pytest.approx(length_m, rel=0.03)
    assert any("scale is that of the fixes" in note for note in drive.notes)
    judge = tmp_path / "other.tum"
    assert localized.trajectory is not None
    localized.trajectory.write(judge)
    compared = drive.compare(localized, drive.read_reference(judge))
    assert compared is not None
    assert compared.figures["worst_error_m"] == 0.0
    out = tmp_path / "out"
    out.mkdir()
    write_localization(out, localized)
    write_pictures(out, draw_localization(localized, drive.records, drive.gps, compared))
    names = {file.name for file in out.iterdir()}
    assert {"trajectory.tum", "track.gpkg", "landmarks.gpkg", "health.csv"} <= names
    assert {"map.png", "tracks.png", "errors.png"} <= names
    assert len(Trajectory.read(out / "trajectory.csv", UTM)) == N


def test_the_picture_of_tracks_can_be_printed(drive: RecordedDrive) -> None:
    assert_printable(tracks_on_frames(drive.records, n_places=1))


def test_a_table_of_fixes_is_a_reference(folder: Path, drive: RecordedDrive) -> None:
    reference = drive.read_reference(folder / "phone.csv")
    assert isinstance(reference, Trajectory)
    assert drive.gps is not None
    np.testing.assert_array_equal(reference.position, drive.gps.position)


def test_wheels_beside_the_images_give_the_scale(folder: Path, drive: RecordedDrive) -> None:
    rolled = 0.25 * STEP_M * np.arange(N)
    Wheels(drive.records.frames.time_s, rolled, rolled).write(folder / "wheels.csv")  # type: ignore[union-attr]
    sequence = open_recording(folder).records
    (folder / "wheels.csv").unlink()
    assert sequence.wheels is not None
    assert sequence.wheels.left_m[-1] == pytest.approx(rolled[-1])


def test_fixes_that_hardly_move_give_no_scale(folder: Path, tmp_path: Path) -> None:
    still = [f"{1000.0 + k},500000,6470000,50" for k in range(10)]
    (tmp_path / "still.csv").write_text("\n".join(["time_s,easting_m,northing_m,height_m", *still]) + "\n")
    with pytest.raises(InputError, match=r"spread over 0\.0 m"):
        open_recording(folder, gps=tmp_path / "still.csv", crs=UTM).localize()


def test_blank_images_are_no_motion(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_bytes((folder / "camera.toml").read_bytes())
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{0.5 * k}.png"), np.full((240, 320), 200, np.uint8))
    with pytest.raises(InputError, match="none of 3 images could be followed"):
        open_recording(tmp_path).localize()


def test_a_camera_that_stands_still_invents_no_motion(drive: RecordedDrive, tmp_path: Path) -> None:
    short = _first_images(drive, tmp_path / "still", 1)
    first = next(short.glob("*.png"))
    for k in range(1, 6):
        (short / f"{1000.0 + 0.25 * k:.2f}.png").write_bytes(first.read_bytes())
    standing = open_recording(short)
    assert standing.localize().length_m == 0.0
    assert any("lengths are no metres" in note for note in standing.notes)


def test_one_image_is_no_motion(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_bytes((folder / "camera.toml").read_bytes())
    first = min((folder / "images").iterdir())
    (tmp_path / "1.5.png").write_bytes(first.read_bytes())
    with pytest.raises(InputError, match="one image; motion needs at least two"):
        open_recording(tmp_path)


def test_the_viewers_file_holds_the_drive(drive: RecordedDrive, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun is not installed (firnline[viewer])")
    short = open_recording(_first_images(drive, tmp_path / "short", 6))
    localized = short.localize()
    write_rrd(tmp_path / "drive.rrd", localized, short.records)
    content = (tmp_path / "drive.rrd").read_bytes()
    assert content.startswith(b"RRF")
    # Six images are in it: JPEG keeps the speckles in more than a kilobyte each.
    assert len(content) > 6 * 1024


def _first_images(drive: RecordedDrive, place: Path, n: int) -> Path:
    place.mkdir()
    assert drive.records.camera is not None
    assert drive.records.frames is not None
    drive.records.camera.write(place / "camera.toml")
    for k in range(n):
        cv2.imwrite(str(place / f"{drive.records.frames.time_s[k]:.2f}.png"), drive.records.frames[k])
    return place


def test_a_missing_viewer_is_refused_before_any_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"install firnline\[viewer\]"):
        refuse_without_rerun()
