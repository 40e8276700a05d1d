"""Folders of photographs: their times, calibration and positions from names and EXIF."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from vision_slam.io.photos.exif import Photo, read_photo
from vision_slam.io.photos.names import times_in_names
from vision_slam.io.receivers.rows import ReceiverFixes, axis_sigma_m

# Diagonal of 35 mm film, and the accuracy of an equivalent focal length: it is rounded to millimetres, and makers
# take it across the diagonal or across the width of their frame.
_DIAGONAL_MM, _FOCAL_SHARE = 43.27, 0.03
_SENSOR_SHARE = 0.02
# Positions of phones are some seconds old; a smaller offset of the clocks is not noted [s].
_LEAST_NOTED_S = 10.0
_QUARTER_HOUR_S = 900.0
_PHONE_RADIUS_M = 5.0
_CHANGED_DEG = 1e-9


class PhotoTimes(NamedTuple):
    """Times (N,) [s] of images, their order in the list of files, and how they were found."""

    time_s: FloatArray
    order: list[int]
    note: str


def photo_times(photos: Sequence[Photo]) -> PhotoTimes | None:
    """Return the times of photographs by their EXIF, else by their names; None where neither has them.

    Raises
    ------
    InputError
        Some photographs have an EXIF time and others have not.
    """
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
    spread, note = _spread(times[order], has_subseconds=bool((times % 1.0).any()))
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
    spread, spread_note = _spread(times[order], has_subseconds=all(photo.has_subseconds for photo in photos))
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


def _spread(times: FloatArray, *, has_subseconds: bool) -> tuple[FloatArray, str]:
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


def photo_fixes(photos: Sequence[Photo], times: PhotoTimes) -> ReceiverFixes | None:
    """Return the positions in EXIF as fixes at the times of the images; None where fewer than two differ.

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
    if len(rows) < 2:
        return None
    table = np.array(rows)
    stated = all(photo.radius_m is not None for photo in photos if photo.place is not None)
    note = f"{len(rows)} fixes from EXIF" + (
        "" if stated else f", of {_PHONE_RADIUS_M:g} m where EXIF states no error"
    )
    note += f"; {n_repeated} that repeat the one before are left out" if n_repeated else ""
    return ReceiverFixes(table[:, 0], table[:, 1:4], axis_sigma_m(table[:, 4]), notes=(note,))


def checked_photos(files: Sequence[Path]) -> list[Photo]:
    """Read the headers of images; refuse sizes or orientations that differ.

    Raises
    ------
    InputError
        Names the first image that differs from the first one.
    """
    photos = [read_photo(file) for file in files]
    first = photos[0]
    for photo in photos:
        if photo.upright_size != first.upright_size:
            (width, height), (other, lower) = first.upright_size, photo.upright_size
            raise InputError(
                f"{photo.file} has {other} × {lower} pixels and {first.file.name} {width} × {height}; "
                "put images of one size and orientation into the folder."
            )
    return photos
