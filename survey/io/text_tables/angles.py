"""Angles in text tables: decimal degrees, degrees and minutes, or degrees, minutes and seconds, with hemispheres."""

import re
from typing import Literal

Axis = Literal["longitude", "latitude"]

_LETTERS = {"longitude": "EW", "latitude": "NS"}
_LIMITS = {"longitude": 360.0, "latitude": 90.0}
_DEGREES = r"(?P<degrees>\d{1,3}(?:\.\d+)?)\s*(?:[°º˚d]|deg)?"
_MINUTES = r"(?P<minutes>\d{1,2}(?:\.\d+)?)\s*(?:['′’‘´m]|min)?"
_SECONDS = r"(?P<seconds>\d{1,2}(?:\.\d+)?)\s*(?:[\"″”“]|''|′′|’’|sec)?"
# The letter s marks no seconds: it stands for the south. A mark or a blank has to part the numbers.
_PARTED = r"(?:(?<=[^\d.])\s*|\s+|[:-])"
_ANGLE = re.compile(
    rf"(?P<before>[NSEW])?\s*(?P<sign>[+-])?\s*{_DEGREES}(?:{_PARTED}{_MINUTES}(?:{_PARTED}{_SECONDS})?)?\s*(?P<after>[NSEW])?",
    re.IGNORECASE,
)


def degrees(text: str, axis: Axis) -> float | None:
    r"""Return an angle in degrees, negative to the south and the west; None for what is none, or could be another one.

    Parameters
    ----------
    text : str
        Such as ``46°30'12.5"N``, ``46 30 12.5 N``, ``S 46 30.208``, ``46-30-12.5``, ``46:30:12.5`` or ``-46.5035°``, decimal points alone.
    axis : {"longitude", "latitude"}
        Which angle it is: one with the letter of the other axis is none.

    Returns
    -------
    float or None
        Degrees. A sign and a letter exclude one another, as do two letters; minutes and seconds are below 60, and
        what stands before them has no decimals.

    Examples
    --------
    >>> round(degrees("46 30 12.5 N", "latitude"), 6), degrees("7 15 0 W", "longitude"), degrees("46 75 0", "latitude")
    (46.503472, -7.25, None)
    """
    found = _ANGLE.fullmatch(text.strip())
    if found is None:
        return None
    letters = [letter.upper() for letter in found.group("before", "after") if letter]
    if len(letters) + (found["sign"] is not None) > 1 or any(one not in _LETTERS[axis] for one in letters):
        return None
    parts = [part for part in found.group("degrees", "minutes", "seconds") if part is not None]
    values = [float(part) for part in parts]
    if any("." in part for part in parts[:-1]) or any(value >= 60.0 for value in values[1:]):
        return None
    angle = sum(value / 60.0**k for k, value in enumerate(values))
    if angle > _LIMITS[axis]:
        return None
    return -angle if found["sign"] == "-" or (letters and letters[0] in "SW") else angle
