"""Photographs of phones and cameras: times, calibration and positions from file names and EXIF.

`times_in_names` finds dates in file names such as ``IMG_20240612_101502.jpg``; `read_photo` reads size, orientation, time,
focal length and position from the EXIF header. `photo_times`, `photo_camera` and `photo_fixes` combine them over a folder.
Times without an offset from UTC count as UTC, or follow the times of GPS positions.
"""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from survey import Camera, InputError
from survey.core import FloatArray, refusing_damage
from vision_slam.readers.sequence import ReceiverFixes, axis_sigma_m

_STAMP = re.compile(
    r"(?<!\d)((?:19|20)\d{2})[-_.]?(\d{2})[-_.]?(\d{2})[-_T. ]?(\d{2})[-_.h]?(\d{2})[-_.m]?(\d{2})[-_.]?(\d{3})?(?!\d)"
)

_NUMBERED = re.compile(r"(.*?)(\d+)")
_DECIMAL_SECONDS = re.compile(r"\d+\.\d+")
# No time since 1970 is as small, and no video has as many frames.
_FIRST_TIME = 1e8
_MILLIS_DIGITS = 3
# No camera takes images at such an interval.
_LEAST_STEP_MS = 5.0


def natural_key(file: Path) -> tuple[tuple[int, int, str], ...]:
    """Return the key of a file's natural order: numbers in its name count as numbers.

    >>> [file.name for file in sorted(map(Path, ["f10.png", "f9.png", "F1.png"]), key=natural_key)]
    ['F1.png', 'f9.png', 'f10.png']
    """
    parts = re.split(r"(\d+)", file.name.lower())
    key = tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part)
    return (*key, (2, 0, file.name))


def times_in_names(files: Sequence[Path]) -> FloatArray | None:
    """Return the times (N,) that all names state, as Unix times of UTC [s]; None where one does not.

    Frames of a video that have its date and a number of their own state no times.

    >>> times_in_names([Path("IMG_20240612_101502.jpg"), Path("PXL_20240612_101502500.jpg")]).tolist()
    [1718187302.0, 1718187302.5]
    >>> times_in_names([Path("DSC_0001.JPG")]) is None
    True
    >>> times_in_names([Path("VID_20240612_101502_0001.png"), Path("VID_20240612_101502_0002.png")]) is None
    True
    """
    if _has_dated_numbers(files):
        return None
    times = [_time_in(file.stem) for file in files]
    return None if any(time is None for time in times) else np.array(times, dtype=np.float64)


def frame_numbers(files: Sequence[Path]) -> FloatArray | None:
    """Return the numbers (N,) that names differ in alone, where they count frames; None where they do not.

    >>> frame_numbers([Path("f8.png"), Path("f9.png"), Path("f11.png")]).tolist()
    [8.0, 9.0, 11.0]
    >>> frame_numbers([Path("1403636579763555584.png")]) is None
    True
    >>> frame_numbers([Path("7.25.png"), Path("7.50.png")]) is None  # Decimal numbers are times.
    True
    """
    if all(_DECIMAL_SECONDS.fullmatch(file.stem) for file in files):
        return None
    found = [_NUMBERED.fullmatch(file.stem) for file in files]
    if not all(found) or len({match[1] for match in found if match}) > 1:
        return None
    numbers = np.array([float(match[2]) for match in found if match])
    return numbers if (np.diff(numbers) > 0.0).all() and numbers[-1] < _FIRST_TIME else None


def _has_dated_numbers(files: Sequence[Path]) -> bool:
    """Return whether all names have the same date and end in numbers that count frames, not milliseconds."""
    numbers = frame_numbers(files)
    first = _NUMBERED.fullmatch(files[0].stem)
    if numbers is None or len(files) < 2 or first is None or _time_in(first[1]) is None:
        return False
    has_millis = all(len(file.stem) == len(first[1]) + _MILLIS_DIGITS for file in files)
    return not has_millis or bool(np.median(np.diff(numbers)) < _LEAST_STEP_MS)


def _time_in(name: str) -> float | None:
    found = _STAMP.search(name)
    if found is None:
        return None
    *parts, millis = found.groups()
    try:
        date = datetime(*map(int, parts), tzinfo=UTC)  # type: ignore[misc, arg-type]  # six numbers
    except ValueError:
        return None
    return date.timestamp() + 1e-3 * int(millis or 0)


_DATED, _SUBSECONDS, _OFFSETS = (36867, 36868, 306), (37521, 37522, 37520), (36881, 36882, 36880)
_EXIF_FOLDER, _GPS_FOLDER = 0x8769, 0x8825
_ORIENTATION, _FOCAL_MM, _FOCAL_35_MM = 274, 37386, 41989
_PLANE_X, _PLANE_UNIT, _WIDTH = 41486, 41488, 40962
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}
_GPS_SIGMA, _GPS_DATUM = 31, 18
_DATUMS = ("", "WGS84", "WGS1984", "ETRS89", "UNKNOWN")
_SIGNS = {1: {"N": 1.0, "S": -1.0}, 3: {"E": 1.0, "W": -1.0}}
_ABOVE = {0: 1.0, 1: -1.0}  # the sea, by GPSAltitudeRef
_MOST_LATITUDE_DEG, _MOST_LONGITUDE_DEG, _MOST_ALTITUDE_M = 90.0, 180.0, 1e4
_PLACES_IN_XMP = (b"GPSLatitude", b"GpsLatitude")
_NO_POSITION, _IN_XMP = "no latitude, longitude and altitude", "a position in XMP alone, which is not read"
_OFFSET = re.compile(r"([+-])(\d{2}):?(\d{2})")


class Photo(NamedTuple):
    """What the header of an image file states.

    ``width`` and ``height`` [pixels] are those of the stored image, before it is turned by
    ``orientation`` (EXIF 1 to 8). ``time_s`` is Unix time, of UTC where ``has_offset`` or where
    a position states it; ``focal_px`` is from the sensor's resolution, ``focal_35_mm`` the
    equivalent of 35 mm film; ``place`` is longitude, latitude [deg] and altitude [m], with
    ``radius_m`` around it. ``lacks`` is why there is no place, and empty where the header has no position at all.
    """

    file: Path
    width: int
    height: int
    orientation: int = 1
    time_s: float | None = None
    has_offset: bool = False
    has_subseconds: bool = False
    gps_time_s: float | None = None
    focal_px: float | None = None
    focal_35_mm: float | None = None
    place: tuple[float, float, float] | None = None
    radius_m: float | None = None
    lacks: str = ""

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height [pixels] after turning."""
        return (self.height, self.width) if self.orientation >= 5 else (self.width, self.height)


def read_photo(file: Path) -> Photo:
    """Read the header of an image file."""
    from PIL import Image

    with refusing_damage(str(file), "image that can be read"), Image.open(file) as image:
        width, height = image.size
        exif = image.getexif()
        with refusing_damage(f"the EXIF of {file}", "EXIF", "strip it and add frames.csv"):
            inner, gps = dict(exif.get_ifd(_EXIF_FOLDER)), dict(exif.get_ifd(_GPS_FOLDER))
            in_xmp = any(mark in bytes(image.info.get("xmp", b"")) for mark in _PLACES_IN_XMP)
            return _photo(file, (width, height), {**dict(exif), **inner}, gps, in_xmp)


def _photo(
    file: Path, size: tuple[int, int], tags: dict[int, Any], gps: dict[int, Any], in_xmp: bool
) -> Photo:
    place, lacks = _gps_place(gps)
    radius_m = _gps_number(gps.get(_GPS_SIGMA))
    time_s, has_offset, has_subseconds = _exposure_time(tags)
    orientation = int(tags.get(_ORIENTATION, 1))
    focal_35 = float(tags.get(_FOCAL_35_MM, 0.0) or 0.0)
    return Photo(
        file,
        *size,
        orientation if 1 <= orientation <= 8 else 1,
        time_s,
        has_offset,
        has_subseconds,
        _gps_time(gps),
        _focal_px(tags, size[0]),
        focal_35 if focal_35 > 0.0 else None,
        place,
        radius_m if radius_m > 0.0 else None,
        _IN_XMP if in_xmp and lacks in ("", _NO_POSITION) and place is None else lacks,
    )


def _exposure_time(tags: dict[int, Any]) -> tuple[float | None, bool, bool]:
    """Return the time of exposure, whether it states its offset from UTC, and whether it has sub-seconds."""
    for date_tag, sub_tag, offset_tag in zip(_DATED, _SUBSECONDS, _OFFSETS, strict=True):
        text = str(tags.get(date_tag, "")).strip("\0 ")
        if not text or not text.strip(": 0"):
            continue
        date = datetime.strptime(re.sub("[-/T]", _exif_mark, text[:19]), "%Y:%m:%d %H:%M:%S").replace(
            tzinfo=UTC
        )
        digits = str(tags.get(sub_tag, "")).strip("\0 ")
        part = float(f"0.{digits}") if digits.isdigit() else 0.0
        ahead_s = _offset_s(str(tags.get(offset_tag, "")).strip("\0 "))
        return date.timestamp() + part - (ahead_s or 0.0), ahead_s is not None, digits.isdigit()
    return None, False, False


def _exif_mark(found: re.Match[str]) -> str:
    """Return the mark of EXIF for one that some cameras write instead: 2024-06-12T10:15:02."""
    return " " if found[0] == "T" else ":"


def _offset_s(text: str) -> float | None:
    """Return seconds of an offset from UTC such as ``+02:00``; None for none, and for the blanks of an unknown one."""
    if text == "Z":
        return 0.0
    found = _OFFSET.fullmatch(text)
    if found is None:
        return None
    ahead = timedelta(hours=int(found[2]), minutes=int(found[3])).total_seconds()
    return -ahead if found[1] == "-" else ahead


def _focal_px(tags: dict[int, Any], width: int) -> float | None:
    """Return the focal length by the sensor's resolution; None for an image of another size than the sensor's."""
    focal, per_unit = float(tags.get(_FOCAL_MM, 0.0) or 0.0), float(tags.get(_PLANE_X, 0.0) or 0.0)
    unit_mm = _UNIT_MM.get(int(tags.get(_PLANE_UNIT, 2)))
    if focal <= 0.0 or per_unit <= 0.0 or unit_mm is None or int(tags.get(_WIDTH, 0) or 0) != width:
        return None
    return focal * per_unit / unit_mm


def _gps_place(gps: dict[int, Any]) -> tuple[tuple[float, float, float] | None, str]:
    """Return longitude, latitude [deg] and altitude [m], or None and what the position lacks."""
    if not gps:
        return None, ""
    (latitude, longitude), altitude_m = map(_gps_degrees, (gps.get(2), gps.get(4))), _gps_number(gps.get(6))
    north, east = (
        marks.get(str(gps.get(tag, "")).strip("\0 ").upper()[:1], math.nan) for tag, marks in _SIGNS.items()
    )
    # Cameras that state no reference mean heights above the sea, as EXIF has it.
    reference = int.from_bytes(gps[5]) if isinstance(gps.get(5), bytes) else gps.get(5, 0)
    above = _ABOVE.get(reference, math.nan)
    datum = str(gps.get(_GPS_DATUM, "")).strip("\0 ")
    on_earth = 0.0 <= latitude <= _MOST_LATITUDE_DEG and 0.0 <= longitude <= _MOST_LONGITUDE_DEG
    faults = {
        _NO_POSITION: not {2, 4, 6} & gps.keys(),
        "no latitude and longitude on the Earth": not on_earth,
        "no hemisphere (GPSLatitudeRef N or S, GPSLongitudeRef E or W)": math.isnan(north + east),
        f"a position in the datum {datum[:40]!r}, not WGS 84": re.sub(r"[\W_]", "", datum.upper())
        not in _DATUMS,
        "a position of 0° N 0° E, which means none": latitude == longitude == 0.0,  # phones before a fix
        "no altitude on the Earth": not abs(altitude_m) <= _MOST_ALTITUDE_M,
        "an altitude above something else than the sea": math.isnan(above),
    }
    lacks = next((words for words, is_so in faults.items() if is_so), "")
    return None if lacks else (east * longitude, north * latitude, above * altitude_m), lacks


def _gps_degrees(parts: Any) -> float:
    """Return an angle of degrees, or of degrees, minutes and seconds; NaN where it is none."""
    values = [_gps_number(part) for part in (parts if isinstance(parts, tuple | list) else (parts,))]
    return sum(value / 60.0**k for k, value in enumerate(values)) if 1 <= len(values) <= 3 else math.nan


def _gps_number(value: Any) -> float:
    """Return a number of EXIF; NaN where it is missing or none, such as a ratio to 0."""
    try:
        return float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return math.nan


def _gps_time(gps: dict[int, Any]) -> float | None:
    """Return the Unix time of the position; None where date or time is missing."""
    text = str(gps.get(29, "")).strip("\0 :0")
    if not text or 7 not in gps:
        return None
    day = datetime.strptime(re.sub("[-/]", ":", str(gps[29]).strip("\0 ")), "%Y:%m:%d").replace(tzinfo=UTC)
    hours, minutes, seconds = (float(part) for part in gps[7])
    time_s = day.timestamp() + 3600.0 * hours + 60.0 * minutes + seconds
    return time_s if math.isfinite(time_s) else None


# Diagonal of 35 mm film, and the accuracy of an equivalent focal length: it is rounded to millimetres, and makers
# take it across the diagonal or across the width of their frame.
_DIAGONAL_MM, _FOCAL_SHARE = 43.27, 0.03
_SENSOR_SHARE = 0.02
# Positions of phones are some seconds old; a smaller offset of the clocks is not noted [s].
_LEAST_NOTED_S = 10.0
_QUARTER_HOUR_S = 900.0
_PHONE_RADIUS_M = 5.0
_CHANGED_DEG = 1e-9


def is_jpeg(file: Path) -> bool:
    """Return whether a file is a JPEG image by its suffix.

    >>> is_jpeg(Path("DSC_0001.JPG")), is_jpeg(Path("1.png"))
    (True, False)
    """
    return file.suffix.lower() in {".jpg", ".jpeg"}


class PhotoTimes(NamedTuple):
    """Times (N,) [s] of images, their order in the list of files, and how they were found."""

    time_s: FloatArray
    order: list[int]
    note: str


def photo_times(photos: Sequence[Photo]) -> PhotoTimes | None:
    """Return the times of photographs by their EXIF, else by their names; None where neither has them."""
    dated = [photo.time_s is not None for photo in photos]
    if any(dated) and not all(dated):
        missing = photos[dated.index(False)].file
        raise InputError(
            f"{missing} has no EXIF time, and {sum(dated)} of {len(photos)} images beside it have one; "
            "remove it, or add frames.csv with the columns time_s,file."
        )
    if all(dated):
        return _by_exif(photos)
    times = times_in_names([photo.file for photo in photos])
    if times is None:
        return None
    order = np.argsort(times, kind="stable")
    spread, note = _spread_times(times[order], has_subseconds=bool((times % 1.0).any()))
    return PhotoTimes(
        spread, order.tolist(), f"times are those in the names of the files, taken for UTC{note}"
    )


def _by_exif(photos: Sequence[Photo]) -> PhotoTimes:
    times = np.array([photo.time_s for photo in photos], dtype=np.float64)
    note = "times are those of EXIF"
    if not all(photo.has_offset for photo in photos):
        offset_s = _whole_zones_s(_ahead_s([photo for photo in photos if not photo.has_offset]))
        times = times - offset_s
        note += f", {offset_s / 3600.0:+g} h from UTC by the clock of their positions" if offset_s else ""
        note += "" if offset_s else ", whose zone is not stated and taken for UTC"
    ahead_s = _ahead_s(photos)
    rest_s = ahead_s - _whole_zones_s(ahead_s)
    if abs(rest_s) >= _LEAST_NOTED_S:
        note += (
            f"; the camera's clock is about {abs(rest_s):.0f} s {'ahead of' if rest_s > 0.0 else 'behind'} that of its positions, "
            "which is not corrected: write corrected times into frames.csv"
        )
    order = np.argsort(times, kind="stable")
    spread, spread_note = _spread_times(
        times[order], has_subseconds=all(photo.has_subseconds for photo in photos)
    )
    return PhotoTimes(spread, order.tolist(), note + spread_note)


def _ahead_s(photos: Sequence[Photo]) -> float:
    """Return by how much the images' clock is ahead of that of their positions [s], zones included; 0 without positions."""
    ahead = [
        photo.time_s - photo.gps_time_s
        for photo in photos
        if photo.time_s is not None and photo.gps_time_s is not None
    ]
    return float(np.median(ahead)) if ahead else 0.0


def _whole_zones_s(ahead_s: float) -> float:
    """Return the part of an offset between clocks that is a time zone [s]."""
    return float(_QUARTER_HOUR_S * np.round(ahead_s / _QUARTER_HOUR_S))


def _spread_times(times: FloatArray, *, has_subseconds: bool) -> tuple[FloatArray, str]:
    """Spread images of the same whole second evenly over it; say so."""
    _, counts = np.unique(times, return_counts=True)
    if has_subseconds or counts.max(initial=1) == 1:
        return times, ""
    within = np.concatenate([np.arange(count) / count for count in counts])
    n_spread = int(counts[counts > 1].sum())
    return times + within, f"; {n_spread} images state whole seconds alone and are spread over them"


def photo_camera(photos: Sequence[Photo], mounted: FloatArray) -> tuple[Camera, str] | None:
    """Return a camera by the focal length that EXIF states, and a note; None where it states none.

    The principal point is the middle of the image, and the distortion is taken for zero.
    """
    first = photos[0]
    width, height = first.upright_size
    if first.focal_35_mm is not None:
        focal, share = first.focal_35_mm * float(np.hypot(width, height)) / _DIAGONAL_MM, _FOCAL_SHARE
        source = f"equivalent of {first.focal_35_mm:g} mm on 35 mm film"
    elif first.focal_px is not None:
        focal, share, source = first.focal_px, _SENSOR_SHARE, "by the sensor's resolution"
    else:
        return None
    matrix = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    camera = Camera("pinhole", width, height, matrix, np.zeros(5), mounted, distortion_is_assumed=True)
    return camera, (
        f"focal length {focal:.0f} ± {share * focal:.0f} pixels from EXIF ({source}), distortion not stated, "
        "camera assumed level and forward; firnline calibrate gives a calibration"
    )


def photo_fixes(photos: Sequence[Photo], times: PhotoTimes) -> tuple[ReceiverFixes | None, tuple[str, ...]]:
    """Return the positions in EXIF as fixes at the times of the images, and what was left out.

    Returns: None where fewer than two positions differ, and notes.

    A position that repeats the one before is left out: phones go on writing the last one. The
    error that EXIF states counts as the radius of 68 %; without one, 5 m are taken.
    """
    rows: list[tuple[float, ...]] = []
    n_repeated = 0
    for time_s, index in zip(times.time_s, times.order, strict=True):
        photo = photos[index]
        if photo.place is None:
            continue
        if rows and np.abs(np.subtract(photo.place, rows[-1][1:4])).max() < _CHANGED_DEG:
            n_repeated += 1
            continue
        rows.append((time_s, *photo.place, photo.radius_m or _PHONE_RADIUS_M))
    left_out = _left_out(photos)
    if len(rows) < 2:
        alone = f"EXIF states one position for {1 + n_repeated} images, which is no path and not used"
        return None, (*left_out, alone) if rows else left_out
    table = np.array(rows)
    stated = all(photo.radius_m is not None for photo in photos if photo.place is not None)
    note = f"{len(rows)} fixes from EXIF" + (
        "" if stated else f", of {_PHONE_RADIUS_M:g} m where EXIF states no error"
    )
    note += f"; {n_repeated} that repeat the one before are left out" if n_repeated else ""
    return ReceiverFixes(table[:, 0], table[:, 1:4], axis_sigma_m(table[:, 4]), notes=(note,)), left_out


def _left_out(photos: Sequence[Photo]) -> tuple[str, ...]:
    """Return notes of the images whose position cannot be used, by what it lacks."""
    lacking: dict[str, list[Photo]] = {}
    for photo in photos:
        lacking.setdefault(photo.lacks, []).append(photo)
    n_none = sum(photo.place is None for photo in lacking.pop("", ()))
    notes = [
        f"{len(of)} images, the first {of[0].file.name}, state {lacks}: they are no fixes"
        for lacks, of in lacking.items()
    ]
    n_placed = sum(photo.place is not None for photo in photos)
    if n_none and n_placed:
        notes.append(f"{n_none} of {len(photos)} images state no position in EXIF")
    return tuple(notes)


def are_held_both_ways(photos: Sequence[Photo | None]) -> bool:
    """Return whether JPEG images of one size, with none of another kind, stand upright and across.

    Images of one camera that was held both ways are used as its sensor stores them.
    """
    known = [photo for photo in photos if photo is not None]
    n_sizes = len({(photo.width, photo.height) for photo in known})
    return len(known) == len(photos) and n_sizes == 1 and len({photo.upright_size for photo in known}) > 1


def checked_photos(files: Sequence[Path]) -> list[Photo]:
    """Read the headers of images; refuse sizes that differ. Those of a camera held both ways are left as they are stored."""
    photos = [read_photo(file) for file in files]
    if all(map(is_jpeg, files)) and are_held_both_ways(photos):
        return [photo._replace(orientation=1) for photo in photos]
    first = photos[0]
    for photo in photos:
        if photo.upright_size != first.upright_size:
            (width, height), (other, lower) = first.upright_size, photo.upright_size
            raise InputError(
                f"{photo.file} has {other} × {lower} pixels and {first.file.name} {width} × {height}; "
                "put images of one size into the folder."
            )
    return photos
