"""EXIF of image files: size, orientation, time, focal length, position."""

import math
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from survey.core.errors import InputError
from survey.core.files.library_messages import first_line

_DATED, _SUBSECONDS, _OFFSETS = (36867, 36868, 306), (37521, 37522, 37520), (36881, 36882, 36880)
_EXIF_FOLDER, _GPS_FOLDER = 0x8769, 0x8825
_ORIENTATION, _FOCAL_MM, _FOCAL_35_MM = 274, 37386, 41989
_PLANE_X, _PLANE_UNIT, _WIDTH = 41486, 41488, 40962
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}
_GPS_SIGMA = 31
_OFFSET = re.compile(r"([+-])(\d{2}):?(\d{2})")


class Photo(NamedTuple):
    """What the header of an image file states.

    ``width`` and ``height`` [pixels] are those of the stored image, before it is turned by
    ``orientation`` (EXIF 1 to 8). ``time_s`` is Unix time, of UTC where ``has_offset`` or where
    a position states it; ``focal_px`` is from the sensor's resolution, ``focal_35_mm`` the
    equivalent of 35 mm film; ``place`` is longitude, latitude [deg] and altitude [m], with
    ``radius_m`` around it.
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

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height [pixels] after turning."""
        return (self.height, self.width) if self.orientation >= 5 else (self.width, self.height)


def read_photo(file: Path) -> Photo:
    """Read the header of an image file.

    Raises
    ------
    InputError
        The file is no image, or its EXIF is damaged.
    """
    from PIL import Image

    try:
        with Image.open(file) as image:
            width, height = image.size
            exif = image.getexif()
            inner, gps = dict(exif.get_ifd(_EXIF_FOLDER)), dict(exif.get_ifd(_GPS_FOLDER))
            return _photo(file, width, height, {**dict(exif), **inner}, gps)
    except (OSError, Image.DecompressionBombError) as error:
        raise InputError(
            f"{file} is no image that can be read ({first_line(error)}); it may be cut off, get it again."
        ) from error
    except (ValueError, TypeError, KeyError, SyntaxError, ZeroDivisionError, OverflowError) as error:
        raise InputError(
            f"{file} has damaged EXIF ({first_line(error)}); get it again, or strip the EXIF and add frames.csv."
        ) from error


def _photo(file: Path, width: int, height: int, tags: dict[int, Any], gps: dict[int, Any]) -> Photo:
    time_s, has_offset, has_subseconds = _time(tags)
    orientation = int(tags.get(_ORIENTATION, 1))
    focal_35 = float(tags.get(_FOCAL_35_MM, 0.0) or 0.0)
    return Photo(
        file,
        width,
        height,
        orientation if 1 <= orientation <= 8 else 1,
        time_s,
        has_offset,
        has_subseconds,
        _gps_time(gps),
        _focal_px(tags, width),
        focal_35 if focal_35 > 0.0 else None,
        _place(gps),
        float(gps[_GPS_SIGMA]) if float(gps.get(_GPS_SIGMA, 0.0)) > 0.0 else None,
    )


def _time(tags: dict[int, Any]) -> tuple[float | None, bool, bool]:
    """Return the time of exposure, whether it states its offset from UTC, and whether it has sub-seconds."""
    for date_tag, sub_tag, offset_tag in zip(_DATED, _SUBSECONDS, _OFFSETS, strict=True):
        text = str(tags.get(date_tag, "")).strip("\0 ")
        if not text or not text.strip(": 0"):
            continue
        date = datetime.strptime(re.sub("[-/T]", _mark, text[:19]), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
        digits = str(tags.get(sub_tag, "")).strip("\0 ")
        part = float(f"0.{digits}") if digits.isdigit() else 0.0
        ahead_s = _offset_s(str(tags.get(offset_tag, "")).strip("\0 "))
        return date.timestamp() + part - (ahead_s or 0.0), ahead_s is not None, digits.isdigit()
    return None, False, False


def _mark(found: re.Match[str]) -> str:
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


def _place(gps: dict[int, Any]) -> tuple[float, float, float] | None:
    """Return longitude, latitude [deg] and altitude [m]; None where one is missing."""
    if not {1, 2, 3, 4, 6} <= gps.keys():
        return None
    latitude = _degrees(gps[2]) * (-1.0 if str(gps[1]).upper().startswith("S") else 1.0)
    longitude = _degrees(gps[4]) * (-1.0 if str(gps[3]).upper().startswith("W") else 1.0)
    below = gps.get(5, 0) in (1, b"\x01")
    place = longitude, latitude, -float(gps[6]) if below else float(gps[6])
    # Phones write zeros, and cameras 0/0, before the first fix.
    return place if all(map(math.isfinite, place)) and (latitude, longitude) != (0.0, 0.0) else None


def _degrees(parts: Any) -> float:
    degrees, minutes, seconds = (float(part) for part in parts)
    return degrees + minutes / 60.0 + seconds / 3600.0


def _gps_time(gps: dict[int, Any]) -> float | None:
    """Return the Unix time of the position; None where date or time is missing."""
    text = str(gps.get(29, "")).strip("\0 :0")
    if not text or 7 not in gps:
        return None
    day = datetime.strptime(re.sub("[-/]", ":", str(gps[29]).strip("\0 ")), "%Y:%m:%d").replace(tzinfo=UTC)
    hours, minutes, seconds = (float(part) for part in gps[7])
    time_s = day.timestamp() + 3600.0 * hours + 60.0 * minutes + seconds
    return time_s if math.isfinite(time_s) else None
