"""Other people's recordings: what is read, and what is refused and how."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from pyproj import CRS

from survey.core.errors import ConfigError, InputError
from survey.data.camera import Camera
from survey.data.sensors.records import GpsFixes
from survey.io.trajectory_files import write_track
from vision_slam.motion import MotionSensors
from vision_slam.readers.gps_files import read_gps
from vision_slam.readers.images import images_of, read_pixels
from vision_slam.readers.sequence import georeference, scale_by_reference
from vision_slam.recordings import read_sequence

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
    sensors = MotionSensors(scale_by_reference(read_sequence(folder), 1.0))
    assert sensors.between(0.0, 0.1).travel_m == pytest.approx(1.2)
    assert sensors.between(0.1, 0.2).travel_m is None
    with pytest.raises(InputError, match="cannot give the scale"):
        scale_by_reference(read_sequence(folder), 10.0)


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
    (tmp_path / "mav0" / "imu0").mkdir()
    (tmp_path / "mav0" / "imu0" / "data.csv").write_text(
        "#t\n1000000000,1,2,3,4,5,6\n1005000000,1,2,3,4,5,6\n"
    )
    sequence = read_sequence(tmp_path)
    assert sequence.frames.time_s.tolist() == [1.0]
    # The unit's axes are the camera's (x right, y down, z forward); the body's are forward, left, up.
    assert sequence.inertial is not None
    assert sequence.inertial.gyro_rad_s[0].tolist() == [3.0, -1.0, -2.0]
    assert sequence.inertial.specific_force_m_s2[0].tolist() == [6.0, -4.0, -5.0]
    assert sequence.camera.T_body_camera[:3, 2].tolist() == [1.0, 0.0, 0.0]
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
    with pytest.raises(InputError, match=r"12 numbers|is empty"):
        read_sequence(_kitti(tmp_path / "seq", calib=calib))


def test_a_folder_without_a_known_layout_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no layout that is known"):
        read_sequence(tmp_path)
    with pytest.raises(InputError, match="is no folder"):
        read_sequence(tmp_path / "nowhere")


def _stamped(folder: Path, stems: list[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for stem in stems:
        cv2.imwrite(str(folder / f"{stem}.png"), np.full((4, 6), 90, np.uint8))


def test_a_plain_folder_takes_its_times_from_a_table_a_list_or_the_names(tmp_path: Path) -> None:
    _camera(tmp_path)
    _stamped(tmp_path / "images", ["1403636579763555584", "1403636579813555456"])
    assert np.diff(read_sequence(tmp_path).frames.time_s) == pytest.approx([0.05], abs=1e-6)
    (tmp_path / "timestamps.txt").write_text("10.0\n10.5\n")
    assert read_sequence(tmp_path).frames.time_s.tolist() == [10.0, 10.5]
    (tmp_path / "frames.csv").write_text(
        "time_s,file\n3.0,images/1403636579763555584.png\n4.0,images/1403636579813555456.png\n"
    )
    assert read_sequence(tmp_path).frames.time_s.tolist() == [3.0, 4.0]


def test_names_that_differ_in_decimals_alone_are_times(tmp_path: Path) -> None:
    _camera(tmp_path)
    _stamped(tmp_path / "images", ["1000.25", "1000.50", "1000.75"])
    assert read_sequence(tmp_path).frames.time_s.tolist() == [1000.25, 1000.5, 1000.75]


@pytest.mark.parametrize("stems", [["0", "1"], ["a", "b"], ["frame000001", "frame000002"]])
def test_a_plain_folder_without_times_is_refused(tmp_path: Path, stems: list[str]) -> None:
    _camera(tmp_path)
    _stamped(tmp_path, stems)
    with pytest.raises(InputError, match="have no times in a list, in EXIF or in their names"):
        read_sequence(tmp_path)


def test_images_without_a_calibration_are_refused(tmp_path: Path) -> None:
    _stamped(tmp_path / "images", ["1403636579763555584", "1403636579813555456"])
    with pytest.raises(InputError, match=r"camera\.toml"):
        read_sequence(tmp_path)


def test_a_named_calibration_goes_before_the_layouts(tmp_path: Path) -> None:
    folder = _kitti(tmp_path / "seq")
    own = Camera(
        "pinhole", 40, 30, np.array([[50.0, 0, 20], [0, 50.0, 15], [0, 0, 1]]), np.zeros(5), np.eye(4)
    )
    assert read_sequence(folder, own).camera.matrix[0, 0] == 50.0
    with pytest.raises(InputError, match=r"000000\.png has 40 × 30 pixels, its calibration 20 × 15"):
        read_sequence(folder, own.scaled(0.5))


@pytest.mark.parametrize(
    ("wrong", "right", "words"),
    [
        ("matrix = [[5.0", "matrix = [[nan", "matrix"),
        ("matrix = [[5.0", 'matrix = [["long"', "matrix"),
        ("matrix = [[5.0", "matrix = [[-5.0", "must be above 0"),
        ("width = 6\n", "", "width"),
        ("distortion = [0.0, ", "distortion = [", "4 distortion coefficients; a pinhole lens has 5"),
    ],
)
def test_a_wrong_calibration_is_refused_with_its_file(
    tmp_path: Path, wrong: str, right: str, words: str
) -> None:
    _camera(tmp_path)
    file = tmp_path / "camera.toml"
    file.write_text(file.read_text().replace(wrong, right))
    with pytest.raises((InputError, ConfigError), match=words):
        Camera.read(file)


def test_deep_images_are_scaled_by_the_depth_in_use(tmp_path: Path) -> None:
    files = [tmp_path / "dark.png", tmp_path / "bright.png"]
    for file, value in zip(files, (0x0123, 0x0ABC), strict=True):
        cv2.imwrite(str(file), np.full((4, 6), value, np.uint16))
    images = images_of(files)
    assert [images[k].max() for k in (0, 1)] == [0x12, 0xAB]
    assert images.notes == ("images of 12 bits were divided by 16",)
    cv2.imwrite(str(files[1]), np.full((4, 6), 0xABCD, np.uint16))
    assert images_of(files)[1].max() == 0xAB


@pytest.mark.parametrize("share", [0.0, 0.5, 0.97])
def test_truncated_images_are_refused(tmp_path: Path, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (30, 40), dtype=np.uint8)
    whole = cv2.imencode(".png", noise)[1].tobytes()
    (tmp_path / "cut.png").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"cut off|decoded|empty"):
        images_of([tmp_path / "cut.png"])
    with pytest.raises(InputError, match=r"cut off|decoded|empty"):
        read_pixels(tmp_path / "cut.png")


def test_nmea_leaves_out_sentences_without_a_fix_and_counts_over_midnight(tmp_path: Path) -> None:
    lines = [
        "GPGGA,235958.00,5824.0000,N,13433.0000,W,1,08,0.9,100.0,M,0,M,,",
        "GPGGA,235959.00,,,,,0,00,,,M,,M,,",
        "GPRMC,235959.00,V,,,,,,,010126,,,N",
        "GPGGA,000000.50,5824.0060,N,13433.0000,W,1,08,0.9,101.0,M,0,M,,",
    ]
    (tmp_path / "log.nmea").write_text("\n".join(map(_sentence, lines)))
    log = read_gps(tmp_path / "log.nmea")
    fixes, _ = log.fixes(UTM)
    assert log.n_without_fix == 1
    assert not log.is_dated
    assert np.diff(fixes.time_s).tolist() == [2.5]
    # 0.006 minutes of latitude are 11.1 m, times the scale of the projection (0.9996 to 1.0004 here).
    assert np.diff(fixes.position[:, 1])[0] == pytest.approx(11.14, abs=0.02)
    assert fixes.position[:, 2].tolist() == [100.0, 101.0]


def test_nmea_without_any_fix_or_with_a_wrong_checksum_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "log.nmea"
    file.write_text(_sentence("GPGGA,235959.00,,,,,0,00,,,M,,M,,"))
    with pytest.raises(InputError, match="no GGA sentence with a fix"):
        read_gps(file)
    file.write_text("$GPGGA,235958.00,5824.0000,N,13433.0000,W,1,08,0.9,100.0,M,0,M,,*00")
    with pytest.raises(InputError, match="line 1: the checksum"):
        read_gps(file)
    file.write_text("$GPGGA,235958.00,5824.0000,N,13433.0000,W,1,08,0.9,100.0,M,0,M,,")
    with pytest.raises(InputError, match="line 1: the sentence has no checksum"):
        read_gps(file)


def _gga(second: int, quality: int = 1) -> str:
    return _sentence(f"GPGGA,1200{second:02d}.00,5824.0000,N,13433.0000,W,{quality},08,0.9,100.0,M,0,M,,")


def test_one_damaged_sentence_of_many_is_left_out_and_counted(tmp_path: Path) -> None:
    file = tmp_path / "log.nmea"
    sentences = [_gga(second) for second in range(20)]
    file.write_text(
        "\n".join(
            [*sentences[:5], sentences[5].replace("5824", "5834"), *sentences[6:-1], sentences[-1][:40]]
        )
    )
    log = read_gps(file)
    assert len(log.time_s) == 18
    assert log.notes == (
        f"2 of 20 sentences are damaged and left out; the first: {file}, line 6: the checksum of the sentence is wrong; "
        "it was cut off or damaged, remove it",
    )
    file.write_text("\n".join([*sentences[:5], *(sentence[:40] for sentence in sentences[5:])]))
    with pytest.raises(InputError, match=r"line 6: the sentence has no checksum.* 15 of 20"):
        read_gps(file)


def test_places_of_nmea_that_no_satellites_gave_are_left_out(tmp_path: Path) -> None:
    file = tmp_path / "log.nmea"
    file.write_text("\n".join(_gga(second, 6 if second >= 7 else 4) for second in range(10)))
    log = read_gps(file)
    assert len(log.time_s) == 7
    assert log.notes == ("3 places that are dead reckoned, entered by hand or simulated are left out",)
    file.write_text("\n".join(_gga(second, 7) for second in range(10)))
    with pytest.raises(InputError, match=r"no GGA sentence with a fix of satellites .*10 dead reckoned"):
        read_gps(file)


def test_tables_of_fixes_in_degrees_and_in_metres(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(
        "time_s,easting_m,northing_m,height_m\n0,500000,6470000,5\n1,500001,6470000,5\n"
    )
    (tmp_path / "d.csv").write_text(
        "time_s,latitude_deg,longitude_deg,height_m\n0,58.4,-135,5\n1,58.4001,-135,5\n"
    )
    metres, degrees = (read_gps(tmp_path / name) for name in ("m.csv", "d.csv"))
    assert metres.fixes(UTM)[0].position[1].tolist() == [500001.0, 6470000.0, 5.0]
    assert degrees.fixes(UTM)[0].position[0, 0] == pytest.approx(500000.0, abs=1e-3)
    assert degrees.fixes()[1].to_epsg() == 32608
    with pytest.raises(ConfigError, match="name one with --crs"):
        metres.fixes()


def test_dates_make_times_unix_times(tmp_path: Path) -> None:
    lines = [
        "GPGGA,235959.00,5824.0000,N,13433.0000,W,1,08,0.9,100.0,M,0,M,,",
        "GPGGA,000001.00,5824.0060,N,13433.0000,W,1,08,0.9,101.0,M,0,M,,",
        "GPRMC,000001.00,A,5824.0060,N,13433.0000,W,0.0,0.0,020170,,,A",
    ]
    (tmp_path / "log.txt").write_text("\n".join(f"NMEA,{_sentence(line)},1699400577561" for line in lines))
    log = read_gps(tmp_path / "log.txt")
    assert log.is_dated
    assert log.time_s.tolist() == [86399.0, 86401.0]
    xyz = np.array([[5e5, 6.47e6, 7.0], [5e5 + 1.0, 6.47e6, 8.0]])
    write_track(tmp_path / "track.gpx", np.array([0.0, 2.5]), xyz, CRS.from_user_input(UTM))
    track = read_gps(tmp_path / "track.gpx")
    assert track.is_dated
    assert (track.time_s - 946684800.0).tolist() == [0.0, 2.5]  # 2000-01-01
    assert track.fixes()[0].position[1] == pytest.approx([5e5 + 1.0, 6.47e6, 8.0], abs=1e-3)


def test_fixes_must_fall_into_the_time_of_the_images(tmp_path: Path) -> None:
    sequence = read_sequence(_kitti(tmp_path / "seq"))
    (tmp_path / "m.csv").write_text(
        "time_s,easting_m,northing_m,height_m\n99.9,500000,6470000,5\n100.1,500002,6470000,5\n100.15,500003,6470000,5\n"
    )
    log = read_gps(tmp_path / "m.csv")
    with pytest.raises(InputError, match=r"0 of 3 fixes \(99\.9 to 100\.[12] s\).*--gps-shift"):
        georeference(sequence, log, UTM)
    recording = georeference(sequence, log, UTM, shift_s=-100.0)
    assert recording.start.tolist() == pytest.approx([500001.0, 6470000.0, 5.0])


def test_a_phones_log_is_read(real_data: Path) -> None:
    file = real_data / "gnss_phone_google_smartloc" / "android" / "nmea" / "pixel6.nmea"
    if not file.is_file():
        pytest.skip(f"the phone's log {file} is not here; set FIRNLINE_DATA")
    log = read_gps(file)
    assert log.is_dated
    # Beside each sentence the phone wrote its own Unix time [ms]: 1699400577.561 s beside the first.
    assert log.time_s[0] == pytest.approx(1699400577.0)
    assert log.fixes()[1].to_epsg() == 32610


def test_tum_layout_brings_its_reference_poses(tmp_path: Path) -> None:
    (tmp_path / "rgb").mkdir()
    cv2.imwrite(str(tmp_path / "rgb" / "0.png"), np.zeros((4, 6, 3), np.uint8))
    (tmp_path / "rgb.txt").write_text("1.0 rgb/0.png\n")
    (tmp_path / "groundtruth.txt").write_text("# header\n1.0 1 2 3 0 0 0 1\n2.0 2 2 3 0 0 0 1\n")
    _camera(tmp_path)
    sequence = read_sequence(tmp_path)
    assert sequence.reference is not None
    assert sequence.reference[1, :3, 3].tolist() == [2.0, 2.0, 3.0]


def test_nmea_quality_and_gst_sentences_give_each_fix_its_error(tmp_path: Path) -> None:
    lines = [
        "GPGGA,120000.00,5824.0000,N,13433.0000,W,4,08,0.9,100.0,M,0,M,,",
        "GPGGA,120001.00,5824.0000,N,13433.0000,W,5,08,0.9,100.0,M,0,M,,",
        "GPGST,120002.00,,,,,3.0,4.0,5.0",
        "GPGGA,120002.00,5824.0000,N,13433.0000,W,1,08,0.9,100.0,M,0,M,,",
    ]
    file = tmp_path / "log.nmea"
    file.write_text("\n".join(map(_sentence, lines)))
    fixes, _ = read_gps(file).fixes()
    assert fixes.sigma_m is not None
    # Quality 4 is a fixed RTK solution, 5 a float one; the hypotenuse of 3 and 4 m is 5 m in both axes together.
    assert fixes.sigma_m.tolist() == pytest.approx([0.02, 0.3, 5.0 / np.sqrt(2.0)])
    file.write_text("\n".join(map(_sentence, [lines[-1]] * 2)))
    assert read_gps(file).sigma_m is None


def test_positions_of_rtklib_have_times_in_utc_and_an_error_each(tmp_path: Path) -> None:
    file = tmp_path / "rover.pos"
    header = "%  GPST          latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"
    row = " 77.679932054  -68.607229038    59.4639   {}   9   {}   {}   0.0010   0.0001   0.0001   0.0004   0.00   24.3"
    rows = [
        "2015/07/07 16:03:20.000" + row.format(1, 0.0003, 0.0002),
        "1852 230601.0" + row.format(2, 0.3, 0.4),
    ]
    file.write_text(header + "\n".join(rows) + "\n")
    log = read_gps(file)
    # GPS time was 17 s ahead of UTC from July 2015 on; 7 July is 230,600 s into GPS week 1852, as in the first row.
    assert log.time_s.tolist() == [1436284983.0, 1436284984.0]
    assert log.place[0].tolist() == [-68.607229038, 77.679932054, 59.4639]
    assert log.sigma_m is not None
    assert log.sigma_m.tolist() == pytest.approx([0.01, np.sqrt(0.125)])
    file.write_text(header + "2015/07/07 16:03:20.000 77.6 -68.6\n")
    with pytest.raises(InputError, match="line 2: 4 values"):
        read_gps(file)


def test_a_column_of_errors_in_a_table_of_fixes(tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    rows = "time_s,easting_m,northing_m,height_m,sigma_m\n0,500000,6470000,5,0.02\n1,500001,6470000,5,{}\n"
    file.write_text(rows.format(3.0))
    fixes = read_gps(file).fixes(UTM)[0]
    assert fixes.sigma_m is not None
    assert fixes.sigma_m.tolist() == [0.02, 3.0]
    fixes.write(tmp_path / "again.csv")
    assert GpsFixes.read(tmp_path / "again.csv").sigma_m.tolist() == [0.02, 3.0]  # type: ignore[union-attr]
    file.write_text(rows.format(-1.0))
    with pytest.raises(InputError, match="not above 0"):
        read_gps(file)
