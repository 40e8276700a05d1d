"""Folders of photographs as phones and cameras write them."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from survey.core.errors import ConfigError, InputError
from vision_slam.recordings import open_recording, read_sequence

NOON = 1718186400.0  # 2024-06-12 10:00:00 UTC


def photo(path, second=0, size=(64, 48), exif=True, gps=None, orientation=None, subseconds="50"):
    """Write a JPEG whose left half is dark, with EXIF."""
    pixels = np.full((size[1], size[0], 3), 200, np.uint8)
    pixels[:, : size[0] // 2] = 20
    header = exif_of(second, gps=gps, orientation=orientation, subseconds=subseconds, has_time=exif)
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(pixels).save(path, exif=header)


def exif_of(second=0, gps=None, orientation=None, subseconds="50", has_time=True):
    """Return EXIF of a photo: time with its offset and focal length, orientation, position."""
    header = Image.Exif()
    if orientation is not None:
        header[274] = orientation
    if has_time:
        folder = {36867: f"2024:06:12 12:00:{second:02d}", 36881: "+02:00", 41989: 26}
        if subseconds:
            folder[37521] = subseconds
        header.get_ifd(0x8769).update(folder)
    if gps is not None:
        header.get_ifd(0x8825).update(gps)
    return header


def position(latitude, longitude, height=500.0, radius=None):
    def dms(angle):
        seconds = IFDRational(round(abs(angle) * 3600 * 1000), 1000)
        return (IFDRational(0, 1), IFDRational(0, 1), seconds)

    tags = {
        1: "N" if latitude >= 0 else "S",
        2: dms(latitude),
        3: "E" if longitude >= 0 else "W",
        4: dms(longitude),
        5: b"\x00",
        6: IFDRational(round(height * 10), 10),
    }
    return tags if radius is None else {**tags, 31: IFDRational(round(radius * 10), 10)}


def test_exif_gives_times_with_subseconds_and_offset_and_a_focal_length(tmp_path):
    for k in range(3):
        photo(tmp_path / f"DSC_{k + 9}.JPG", second=k)  # 9, 10, 11 without leading zeros
    sequence = read_sequence(tmp_path)
    np.testing.assert_allclose(sequence.frames.time_s - NOON, [0.5, 1.5, 2.5])
    assert sequence.camera.matrix[0, 0] == pytest.approx(26.0 * 80.0 / 43.27)
    assert sequence.camera.distortion_is_assumed
    assert "48 ± 1 pixels from EXIF" in sequence.notes[1]


def test_a_calibration_beside_the_images_wins_over_exif(tmp_path):
    photo(tmp_path / "a.jpg", 0)
    photo(tmp_path / "b.jpg", 1)
    camera = read_sequence(tmp_path).camera
    camera.write(tmp_path / "camera.toml")
    assert len(read_sequence(tmp_path).notes) == 1  # the times alone


@pytest.mark.parametrize(
    "names",
    [
        ["IMG_20240612_100000.jpg", "IMG_20240612_100001.jpg"],
        ["PXL_20240612_100000000.jpg", "PXL_20240612_100001000.jpg"],
        ["2024-06-12 10.00.00.jpg", "2024-06-12 10.00.01.jpg"],
        ["DJI_20240612100000_0001.jpg", "DJI_20240612100001_0002.jpg"],
    ],
)
def test_names_of_phones_give_times(tmp_path, names):
    for name in names:
        photo(tmp_path / name, exif=False)
    camera_file(tmp_path)
    sequence = read_sequence(tmp_path)
    np.testing.assert_allclose(sequence.frames.time_s - NOON, [0.0, 1.0])
    assert "taken for UTC" in sequence.notes[0]


def camera_file(folder):
    other = folder / "other"
    photo(other / "a.jpg", 0)
    photo(other / "b.jpg", 1)
    read_sequence(other).camera.write(folder / "camera.toml")


def test_frames_of_a_video_need_a_rate(tmp_path):
    for k in (9, 10, 11):
        photo(tmp_path / f"frame{k}.png", exif=False)
    camera_file(tmp_path)
    with pytest.raises(InputError, match="name --frame-rate for those of a video"):
        read_sequence(tmp_path)
    sequence = read_sequence(tmp_path, frame_rate_hz=10.0)
    np.testing.assert_allclose(sequence.frames.time_s, [0.0, 0.1, 0.2])
    assert [file.stem for file in sequence.frames.images.files] == ["frame9", "frame10", "frame11"]


@pytest.mark.parametrize(
    ("names", "times", "n_missing"),
    [
        (["000000", "000005", "000010", "000015"], [0.0, 0.1, 0.2, 0.3], 0),
        (["000010", "000011", "000014", "000015"], [0.0, 0.1, 0.4, 0.5], 2),
        (["f0", "f2", "f8", "f10"], [0.0, 0.1, 0.4, 0.5], 2),
        (["a", "b", "c", "d"], [0.0, 0.1, 0.2, 0.3], 0),
        ([f"VID_20240612_101502_{k:04d}" for k in (1, 2, 4, 5)], [0.0, 0.1, 0.3, 0.4], 1),
        ([f"VID_20240612_101502_{k:03d}" for k in (1, 2, 3, 4)], [0.0, 0.1, 0.2, 0.3], 0),
    ],
)
def test_numbers_of_frames_are_no_seconds_and_count_deleted_frames(tmp_path, names, times, n_missing):
    for name in names:
        photo(tmp_path / f"{name}.png", exif=False)
    camera_file(tmp_path)
    with pytest.raises(InputError, match="name --frame-rate for those of a video"):
        read_sequence(tmp_path)
    sequence = read_sequence(tmp_path, frame_rate_hz=10.0)
    np.testing.assert_allclose(sequence.frames.time_s, times)
    stated = f"; {n_missing} that their numbers leave out count as images"
    assert sequence.notes[0].endswith(stated if n_missing else "in the order of the names")


def test_milliseconds_in_the_names_of_one_second_remain_times(tmp_path):
    for millis in (120, 153, 187):
        photo(tmp_path / f"20240612_100000_{millis}.png", exif=False)
    camera_file(tmp_path)
    np.testing.assert_allclose(read_sequence(tmp_path).frames.time_s - NOON, [0.12, 0.153, 0.187], atol=1e-6)


def test_a_rate_beside_times_is_refused(tmp_path):
    photo(tmp_path / "a.jpg", 0)
    photo(tmp_path / "b.jpg", 1)
    with pytest.raises(ConfigError, match="have times of their own; leave --frame-rate out"):
        read_sequence(tmp_path, frame_rate_hz=2.0)


def test_images_of_one_whole_second_are_spread_over_it(tmp_path):
    for k in range(4):
        photo(tmp_path / f"IMG_{k}.jpg", k // 2, subseconds=None)
    sequence = read_sequence(tmp_path)
    np.testing.assert_allclose(sequence.frames.time_s - NOON, [0.0, 0.5, 1.0, 1.5])
    assert "4 images state whole seconds alone" in sequence.notes[0]


def test_images_are_turned_upright(tmp_path):
    photo(tmp_path / "a.jpg", 0, orientation=6)
    photo(tmp_path / "b.jpg", 1, orientation=6)
    sequence = read_sequence(tmp_path)
    assert (sequence.camera.width, sequence.camera.height) == (48, 64)
    image = sequence.frames[0]
    assert image.shape[:2] == (64, 48)
    assert image[:30].max() < 60 < image[34:].min()  # the stored left half is the upper one
    assert "turned upright" in sequence.notes[-1]


def test_sizes_that_differ_are_refused_by_name(tmp_path):
    photo(tmp_path / "a.jpg", 0)
    photo(tmp_path / "b.jpg", 1, size=(48, 64))
    with pytest.raises(InputError, match=r"b\.jpg has 48 × 64 pixels and a\.jpg 64 × 48"):
        read_sequence(tmp_path)


def test_an_image_without_a_time_among_dated_ones_is_refused(tmp_path):
    photo(tmp_path / "a.jpg", 0)
    photo(tmp_path / "b.jpg", exif=False)
    with pytest.raises(InputError, match=r"b\.jpg has no EXIF time, and 1 of 2 images"):
        read_sequence(tmp_path)


def test_positions_become_fixes_with_their_own_error(tmp_path):
    for k, east in enumerate((0.0, 0.0, 1e-4, 2e-4)):  # the second repeats the first
        photo(tmp_path / f"{k}.jpg", k, gps=position(-46.0, 8.0 + east, radius=3.0))
    drive = open_recording(tmp_path)
    assert drive.records.crs.to_epsg() == 32732
    np.testing.assert_allclose(drive.gps.time_s - NOON, [0.5, 2.5, 3.5])
    np.testing.assert_allclose(drive.gps.sigma_m, 3.0 / 1.51, atol=1e-3)
    np.testing.assert_allclose(np.diff(drive.gps.position[:, 0]), 7.75, atol=0.05)
    assert any("3 fixes from EXIF; 1 that repeat" in note for note in drive.notes)


@pytest.mark.parametrize(
    ("name", "words"),
    [("a.heic", "convert the images to JPEG or PNG"), ("a.mp4", "extract its images .ffmpeg")],
)
def test_kinds_that_are_not_read_are_refused_with_the_remedy(tmp_path, name, words):
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=words):
        read_sequence(tmp_path)


@pytest.mark.parametrize("content", [b"", b"\xff\xd8\xff no image \xff\xd9"])
def test_a_damaged_image_is_refused_in_one_sentence(tmp_path, content):
    photo(tmp_path / "a.jpg", 0)
    Path(tmp_path / "b.jpg").write_bytes(content)
    with pytest.raises(InputError, match=r"b\.jpg"):
        read_sequence(tmp_path)


def test_a_damaged_date_is_refused_in_one_sentence(tmp_path):
    header = Image.Exif()
    header.get_ifd(0x8769)[36867] = "2024-99-12 12"
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "a.jpg", exif=header)
    with pytest.raises(InputError, match=r"the EXIF of .*a.jpg is damaged .* strip it"):
        read_sequence(tmp_path)


@pytest.mark.parametrize(("behind_s", "is_noted"), [(25, True), (3, False)])
def test_a_clock_that_differs_from_that_of_the_positions_is_noted(tmp_path, behind_s, is_noted):
    for k in range(3):
        tags = position(58.4, -134.6) | {7: (10.0, 0.0, float(behind_s + k)), 29: "2024:06:12"}
        photo(tmp_path / f"{k}.jpg", second=k, gps=tags, subseconds="")
    notes = " ".join(read_sequence(tmp_path).notes)
    assert ("the camera's clock is about 25 s behind that of its positions" in notes) == is_noted


def altered(tags, **changes):
    """Return GPS tags with some replaced, or left out where None; names are t and the number of the tag."""
    given = {int(name[1:]): value for name, value in changes.items()}
    return {tag: value for tag, value in {**tags, **given}.items() if value is not None}


NO_NUMBER, ZERO = IFDRational(0, 0), IFDRational(0, 1)


@pytest.mark.parametrize(
    ("changes", "lacks"),
    [
        ({"t1": None, "t3": None}, "no hemisphere"),
        ({"t3": "N"}, "no hemisphere"),
        ({"t1": ""}, "no hemisphere"),
        ({"t6": None}, "no altitude"),
        ({"t6": NO_NUMBER}, "no altitude"),
        ({"t6": IFDRational(4294967295, 1)}, "no altitude"),
        ({"t5": b"\x02"}, "an altitude above something else"),
        ({"t2": None}, "no latitude and longitude on the Earth"),
        ({"t2": (NO_NUMBER, NO_NUMBER, NO_NUMBER)}, "no latitude and longitude on the Earth"),
        ({"t4": (IFDRational(200, 1), ZERO, ZERO)}, "no latitude and longitude on"),
        ({"t2": (ZERO,) * 3, "t4": (ZERO,) * 3}, "a position of 0° N 0° E"),
        (
            {"t1": None, "t2": None, "t3": None, "t4": None, "t5": None, "t6": None, "t29": "2024:06:12"},
            "no latitude, longitude and altitude",
        ),
    ],
)
def test_a_position_that_cannot_be_used_is_counted_and_named(tmp_path, changes, lacks):
    for k in range(5):
        tags = position(58.4 + 1e-4 * k, -134.6)
        photo(tmp_path / f"{k}.jpg", second=k, gps=tags if k not in (1, 3) else altered(tags, **changes))
    sequence = read_sequence(tmp_path)
    assert len(sequence.gps.time_s) == 3
    assert any(note.startswith(f"2 images, the first 1.jpg, state {lacks}") for note in sequence.notes), (
        sequence.notes
    )


def test_positions_that_cannot_be_used_are_named_where_none_is_left(tmp_path):
    for k in range(3):
        photo(tmp_path / f"{k}.jpg", second=k, gps=altered(position(58.4, -134.6), t1=None))
    sequence = read_sequence(tmp_path)
    assert sequence.gps is None
    assert any("3 images, the first 0.jpg, state no hemisphere" in note for note in sequence.notes)


def test_images_without_and_with_a_position_in_xmp_alone_are_named(tmp_path):
    for k in range(4):
        photo(tmp_path / f"{k}.jpg", second=k, gps=position(58.4 + 1e-4 * k, -134.6) if k < 2 else None)
    with Image.open(tmp_path / "3.jpg") as stored:
        pixels = stored.copy()
    pixels.save(tmp_path / "3.jpg", exif=exif_of(3), xmp=b'<x:xmpmeta drone-dji:GpsLatitude="58.4"/>')
    notes = read_sequence(tmp_path).notes
    assert any("1 of 4 images state no position in EXIF" in note for note in notes)
    assert any("1 images, the first 3.jpg, state a position in XMP alone" in note for note in notes)


def test_an_altitude_below_the_sea_or_without_a_reference_is_used(tmp_path):
    for k, changes in enumerate(({"t5": b"\x01"}, {"t5": None}, {"t5": 1}, {})):
        photo(tmp_path / f"{k}.jpg", second=k, gps=altered(position(58.4 + 1e-4 * k, -134.6, 7.0), **changes))
    np.testing.assert_allclose(read_sequence(tmp_path).gps.place[:, 2], [-7.0, 7.0, -7.0, 7.0])


@pytest.mark.parametrize(
    ("heights", "used"),
    [
        ([700, 0, 0, 701], [700, 701]),
        ([0, 700, 701, 0], [700, 701]),
        ([3, 0, 0, -2], [3, 0, 0, -2]),
        ([0, 0, 5, 40], [0, 0, 5, 40]),
    ],
)
def test_an_altitude_of_zero_among_others_far_from_it_is_no_fix(tmp_path, heights, used):
    for k, height in enumerate(heights):
        tags = altered(position(58.4 + 1e-4 * k, -134.6, abs(height)), t5=b"\x01" if height < 0 else b"\x00")
        photo(tmp_path / f"{k}.jpg", second=k, gps=tags)
    log = read_sequence(tmp_path).gps
    assert log.place[:, 2].tolist() == used
    assert any("2 fixes at a height of 0 m" in note for note in log.notes) == (len(used) < 4)


def test_positions_count_where_the_times_are_listed(tmp_path):
    for k in range(3):
        photo(tmp_path / f"{k}.jpg", second=k, gps=position(58.4 + 1e-4 * k, -134.6))
    (tmp_path / "times.txt").write_text("0.0\n0.5\n1.0\n")
    assert read_sequence(tmp_path).gps.time_s.tolist() == [0.0, 0.5, 1.0]


def test_images_of_a_camera_held_both_ways_are_used_as_its_sensor_stores_them(tmp_path):
    for second, orientation in enumerate((1, 6, 1, 8)):
        photo(tmp_path / "photos" / f"IMG_{second}.jpg", second, orientation=orientation)
    sequence = read_sequence(tmp_path / "photos")
    assert (sequence.camera.width, sequence.camera.height) == (64, 48)
    assert [sequence.frames[k].shape[:2] for k in range(4)] == [(48, 64)] * 4
    assert any("some images stand upright and others across" in note for note in sequence.notes)


def test_images_of_other_sizes_are_refused_however_they_are_turned(tmp_path):
    photo(tmp_path / "photos" / "IMG_0.jpg", 0)
    photo(tmp_path / "photos" / "IMG_1.jpg", 1, size=(80, 48), orientation=6)
    with pytest.raises(InputError, match=r"IMG_1.jpg has 48 × 80 pixels and IMG_0.jpg 64 × 48"):
        read_sequence(tmp_path / "photos")
