"""Names of image files: natural order, and times in the names that phones and cameras give."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray

_STAMP = re.compile(
    r"(?<!\d)((?:19|20)\d{2})[-_.]?(\d{2})[-_.]?(\d{2})[-_T. ]?(\d{2})[-_.h]?(\d{2})[-_.m]?(\d{2})[-_.]?(\d{3})?(?!\d)"
)

_NUMBERED = re.compile(r"(.*?)(\d+)")
_SECONDS = re.compile(r"\d+\.\d+")
# No time since 1970 is as small, and no video has as many frames.
_FIRST_TIME = 1e8
_MILLIS_DIGITS = 3
# No camera takes images at such an interval.
_LEAST_STEP_MS = 5.0


def natural_key(file: Path) -> tuple[tuple[int, int, str], ...]:
    """Return the key of a file's natural order: numbers in its name count as numbers.

    Examples
    --------
    >>> [file.name for file in sorted(map(Path, ["f10.png", "f9.png", "F1.png"]), key=natural_key)]
    ['F1.png', 'f9.png', 'f10.png']
    """
    parts = re.split(r"(\d+)", file.name.lower())
    key = tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part)
    return (*key, (2, 0, file.name))


def times_in_names(files: Sequence[Path]) -> FloatArray | None:
    """Return the times (N,) that all names state, as Unix times of UTC [s]; None where one does not.

    Frames of a video that have its date and a number of their own state no times.

    Examples
    --------
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

    Examples
    --------
    >>> frame_numbers([Path("f8.png"), Path("f9.png"), Path("f11.png")]).tolist()
    [8.0, 9.0, 11.0]
    >>> frame_numbers([Path("1403636579763555584.png")]) is None
    True
    >>> frame_numbers([Path("7.25.png"), Path("7.50.png")]) is None  # Decimal numbers are times.
    True
    """
    if all(_SECONDS.fullmatch(file.stem) for file in files):
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
