"""Other people's recordings: what is read, and what is refused and how."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from survey.errors import InputError
from vision_slam.gps_files import read_gps
from vision_slam.motion import MotionSensors
from vision_slam.readers import read_any_image, read_sequence
from vision_slam.sequence import scaled_by_first

UTM = "EPSG:32608"


def _sentence(body: str) -> str:
    total = 0
    for letter in body:
        total ^= ord(letter)
    return f"${body}*{total:02X}"


def _kitti(folder: Path, n: int = 3, calib: str = "P0: 200 0 20 0 0 200 15 0 0 0 1 0") -> Path:
    (folder / "image_0").mkdir(parents=True)
    for k in range(n):
        cv2.imwrite(str(folder / "image_0" / f"{k:06d}.png"), np.full((30, 40), 100 + k, np.uint8))
    (folder / "calib.txt").write_text(calib)
    return folder


def test_kitti_layout_with_poses_without_a_last_line_break(tmp_path: Path) -> None:
    folder = _kitti(tmp_path / "seq")
    rows = [f"1 0 0 0 0 1 0 0 0 0 1 {1.2 * k}" for k in range(3)]
    (folder / "poses.txt").write_text("\n".join(rows))
    sequence = read_sequence(folder)
    assert sequence.camera.matrix[0, 0] == 200.0
    assert np.allclose(sequence.frames.time_s, [0.0, 0.1, 0.2])
    assert sequence.reference is not None
    # KITTI's camera looks along z, the body along x.
    assert np.allclose(sequence.reference[:, :3, 3], [[0, 0, 0], [1.2, 0, 0], [2.4, 0, 0]])


def test_the_scale_comes_from_the_first_metres_only(tmp_path: Path) -> None:
    folder = _kitti(tmp_path / "seq", n=4)
    rows = [f"1 0 0 0 0 1 0 0 0 0 1 {1.2 * k}" for k in range(4)]
    (folder / "poses.txt").write_text("\n".join(rows) + "\n")
    sensors = MotionSensors(scaled_by_first(read_sequence(folder), 1.0))
    assert sensors.between(0.0, 0.1).travel_m == pytest.approx(1.2)
    assert sensors.between(0.1, 0.2).travel_m is None
    with pytest.raises(InputError, match="cannot give the scale"):
        scaled_by_first(read_sequence(folder), 10.0)


def test_tum_layout(tmp_path: Path) -> None:
    (tmp_path / "rgb").mkdir()
    for k in range(2):
        cv2.imwrite(str(tmp_path / "rgb" / f"{k}.png"), np.zeros((4, 6, 3), np.uint8))
    (tmp_path / "rgb.txt").write_text("# time file\n1.0 rgb/0.png\n1.5 rgb/1.png\n")
    with pytest.raises(InputError, match=r"no camera\.toml"):
        read_sequence(tmp_path)
    _camera(tmp_path)
    sequence = read_sequence(tmp_path)
    assert sequence.frames.time_s.tolist() == [1.0, 1.5]
    assert sequence.frames[1].shape == (4, 6, 3)


def test_euroc_layout(tmp_path: Path) -> None:
    place = tmp_path / "mav0" / "cam0"
    (place / "data").mkdir(parents=True)
    cv2.imwrite(str(place / "data" / "a.png"), np.zeros((4, 6), np.uint8))
    (place / "data.csv").write_text("#timestamp [ns],filename\n1000000000,a.png\n")
    (place / "sensor.yaml").write_text(
        "intrinsics: [5.0, 5.0, 3.0, 2.0]\nresolution: [6, 4]\ndistortion_coefficients: [0, 0, 0, 0]\n"
        "T_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
    )
    assert read_sequence(tmp_path).frames.time_s.tolist() == [1.0]
    (place / "sensor.yaml").write_text("intrinsics: [5.0]\n")
    with pytest.raises(InputError, match="no EuRoC calibration"):
        read_sequence(tmp_path)


def _camera(folder: Path) -> None:
    (folder / "camera.toml").write_text(
        'model = "pinhole"\nwidth = 6\nheight = 4\nmatrix = [[5.0, 0.0, 3.0], [0.0, 5.0, 2.0], [0.0, 0.0, 1.0]]\n'
        "distortion = [0.0, 0.0, 0.0, 0.0, 0.0]\nT_body_camera = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], "
        "[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]\n"
    )


def test_times_that_run_backwards_are_refused(tmp_path: Path) -> None:
    folder = _kitti(tmp_path / "seq")
    (folder / "times.txt").write_text("0.0\n0.2\n0.1\n")
    with pytest.raises(InputError, match="do not increase"):
        read_sequence(folder)


def test_unequal_lengths_are_refused(tmp_path: Path) -> None:
    folder = _kitti(tmp_path / "seq")
    (folder / "times.txt").write_text("0.0\n0.1\n")
    with pytest.raises(InputError, match="2 lines and 3 images"):
        read_sequence(folder)


@pytest.mark.parametrize("calib", ["", "P0: 200 0 20", "P0: a b"])
def test_a_calibration_that_is_none_is_refused(tmp_path: Path, calib: str) -> None:
    with pytest.raises(InputError, match="12 numbers"):
        read_sequence(_kitti(tmp_path / "seq", calib=calib))


def test_a_folder_without_a_known_layout_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no layout that is known"):
        read_sequence(tmp_path)
    with pytest.raises(InputError, match="is no folder"):
        read_sequence(tmp_path / "nowhere")


def test_images_of_16_bits_keep_their_upper_byte(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "deep.png"), np.full((4, 6), 0xABCD, np.uint16))
    assert read_any_image(tmp_path / "deep.png").max() == 0xAB


@pytest.mark.parametrize("share", [0.0, 0.5, 0.97])
def test_truncated_images_are_refused(tmp_path: Path, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (30, 40), dtype=np.uint8)
    whole = cv2.imencode(".png", noise)[1].tobytes()
    (tmp_path / "cut.png").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"no whole image|empty"):
        read_any_image(tmp_path / "cut.png")


def test_nmea_leaves_out_sentences_without_a_fix_and_counts_over_midnight(tmp_path: Path) -> None:
    lines = [
        "GPGGA,235958.00,5824.0000,N,13433.0000,W,1,08,0.9,100.0,M,0,M,,",
        "GPGGA,235959.00,,,,,0,00,,,M,,M,,",
        "GPRMC,235959.00,V,,,,,,,010126,,,N",
        "GPGGA,000000.50,5824.0060,N,13433.0000,W,1,08,0.9,101.0,M,0,M,,",
    ]
    (tmp_path / "log.nmea").write_text("\n".join(map(_sentence, lines)))
    fixes = read_gps(tmp_path / "log.nmea", UTM)
    assert np.diff(fixes.time_s).tolist() == [2.5]
    # 0.006 minutes of latitude are 11.1 m, times the scale of the projection (0.9996 to 1.0004 here).
    assert np.diff(fixes.position[:, 1])[0] == pytest.approx(11.14, abs=0.02)
    assert fixes.position[:, 2].tolist() == [100.0, 101.0]


def test_nmea_without_any_fix_or_with_a_wrong_checksum_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "log.nmea"
    file.write_text(_sentence("GPGGA,235959.00,,,,,0,00,,,M,,M,,"))
    with pytest.raises(InputError, match="no GGA sentence with a fix"):
        read_gps(file, UTM)
    file.write_text("$GPGGA,235958.00,5824.0000,N,13433.0000,W,1,08,0.9,100.0,M,0,M,,*00")
    with pytest.raises(InputError, match="line 1: the checksum"):
        read_gps(file, UTM)


def test_tables_of_fixes_in_degrees_and_in_metres(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(
        "time_s,easting_m,northing_m,height_m\n0,500000,6470000,5\n1,500001,6470000,5\n"
    )
    (tmp_path / "d.csv").write_text(
        "time_s,latitude_deg,longitude_deg,height_m\n0,58.4,-135,5\n1,58.4001,-135,5\n"
    )
    assert read_gps(tmp_path / "m.csv", UTM).position[1].tolist() == [500001.0, 6470000.0, 5.0]
    assert read_gps(tmp_path / "d.csv", UTM).position[0, 0] == pytest.approx(500000.0, abs=1e-3)


def test_tum_layout_brings_its_reference_poses(tmp_path: Path) -> None:
    (tmp_path / "rgb").mkdir()
    cv2.imwrite(str(tmp_path / "rgb" / "0.png"), np.zeros((4, 6, 3), np.uint8))
    (tmp_path / "rgb.txt").write_text("1.0 rgb/0.png\n")
    (tmp_path / "groundtruth.txt").write_text("# header\n1.0 1 2 3 0 0 0 1\n2.0 2 2 3 0 0 0 1\n")
    _camera(tmp_path)
    sequence = read_sequence(tmp_path)
    assert sequence.reference is not None
    assert sequence.reference[1, :3, 3].tolist() == [2.0, 2.0, 3.0]
