"""Vertical datums: names, codes and agreement."""

from typing import Any

from survey.core.crs.checks import known_crs, unit_name
from survey.core.errors import InputError

UNSTATED = ""
"""The vertical datum of a file that does not say which one it uses."""
ELLIPSOIDAL = "ellipsoidal height"
VERTICAL_CRS = {
    "EGM96 height": "EPSG:5773",
    "EGM2008 height": "EPSG:3855",
    "NAVD88 height": "EPSG:5703",
    "EGM84 height": "EPSG:5798",
}
"""Vertical datums that are known by name, with their codes."""


def vertical_datum_of(crs: Any) -> str:
    """Return the name of the vertical part of a CRS, or ``""`` when it has none.

    Parameters
    ----------
    crs : str, int or pyproj.CRS
        A horizontal, compound or three-dimensional CRS.

    Returns
    -------
    str
        Name of the vertical datum.

    Examples
    --------
    >>> vertical_datum_of("EPSG:32608+5773")
    'EGM96 height'
    >>> vertical_datum_of("EPSG:32608")
    ''
    """
    full = known_crs(crs, "the file")
    if full.is_compound:
        vertical = full.sub_crs_list[1]
        unit = unit_name(vertical)
        if unit not in ("metre", "meter", "m"):
            raise InputError(
                f"the heights count in {vertical.name}, whose unit is the {unit}; metres are needed, convert them first."
            )
        if vertical.axis_info and vertical.axis_info[0].direction.lower() == "down":
            raise InputError(
                f"the CRS counts {vertical.name} downwards; elevations upwards are needed, change the sign and the CRS first."
            )
        return str(vertical.name)
    return ELLIPSOIDAL if len(full.axis_info) > 2 else UNSTATED


def same_vertical_datum(a: str, b: str, what: str) -> None:
    """Refuse heights above two different datums; an unstated datum agrees with any.

    Parameters
    ----------
    a, b : str
        Names of datums, ``""`` for an unstated one.
    what : str
        The two things that meet, for the message.
    """
    if a != b and UNSTATED not in (a, b):
        raise InputError(
            f"{what} have heights above different vertical datums, {a!r} and {b!r}; they differ by tens of metres, "
            "transform one of them first."
        )


def datum_of_file(stated: str, crs: Any, where: str) -> str:
    """Return the vertical datum of a file: its own, or that of the CRS that was named for it.

    Parameters
    ----------
    stated : str
        Name of the file's datum, ``""`` for an unstated one.
    crs : str, int or pyproj.CRS, optional
        CRS that was named for the file; None for none.
    where : str
        The file, for the message.

    Returns
    -------
    str
        Name of the datum, ``""`` where neither states one.

    Raises
    ------
    InputError
        Both state one, and they differ.

    Examples
    --------
    >>> datum_of_file("", "EPSG:32608+5773", "dem.tif")
    'EGM96 height'
    """
    named = UNSTATED if crs is None else vertical_datum_of(crs)
    same_vertical_datum(stated, named, f"{where} and the CRS that was named for it")
    return stated or named
