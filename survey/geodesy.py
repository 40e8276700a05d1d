"""Coordinate reference systems and vertical datums: refused when they do not fit.

firnline computes in one projected CRS in metres per survey. Degrees are refused, so are
two surveys in different systems and heights above different vertical datums.
"""

from typing import Any

from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from survey.arrays import FloatArray, frozen
from survey.errors import InputError

UNSTATED = ""
"""The vertical datum of a file that does not say which one it uses."""


def projected_crs(crs: Any, where: str) -> CRS:
    """Return the horizontal, projected, metric CRS, or refuse.

    Parameters
    ----------
    crs : str, int or pyproj.CRS
        Anything that PROJ understands. A compound CRS gives its horizontal part.
    where : str
        What carries the CRS, for the message.

    Returns
    -------
    pyproj.CRS
        Two-dimensional, axes in metres.

    Raises
    ------
    InputError
        No CRS, an unknown one, one in degrees or one in feet.

    Examples
    --------
    >>> projected_crs("EPSG:32608", "the site").name
    'WGS 84 / UTM zone 8N'
    """
    if crs is None or crs == "":
        raise InputError(f"{where} carries no coordinate reference system; name it, e.g. crs=EPSG:32608.")
    try:
        full = CRS.from_user_input(crs)
    except CRSError as error:
        raise InputError(
            f"{where} names the CRS {crs!r}, which PROJ does not know; give an EPSG code."
        ) from error
    horizontal = full.sub_crs_list[0] if full.is_compound else full
    if horizontal.is_geographic or horizontal.is_geocentric:
        raise InputError(
            f"{where} is in {horizontal.name} ({_unit(horizontal)}s), but distances are needed in metres; "
            "reproject it to a projected CRS such as its UTM zone."
        )
    if _unit(horizontal) not in ("metre", "meter", "m"):
        raise InputError(
            f"{where} is in {horizontal.name}, whose unit is the {_unit(horizontal)}; metres are needed, reproject it."
        )
    return horizontal.to_2d() if len(horizontal.axis_info) > 2 else horizontal


def _unit(crs: CRS) -> str:
    return str(crs.axis_info[0].unit_name) if crs.axis_info else "unknown unit"


def vertical_datum_of(crs: Any) -> str:
    """Return the name of the vertical part of a CRS, or ``""`` when it has none.

    Examples
    --------
    >>> vertical_datum_of("EPSG:32608+5773")
    'EGM96 height'
    >>> vertical_datum_of("EPSG:32608")
    ''
    """
    full = CRS.from_user_input(crs)
    if full.is_compound:
        return str(full.sub_crs_list[1].name)
    return "ellipsoidal height" if len(full.axis_info) > 2 else UNSTATED


def same_crs(a: CRS, b: CRS, what: str) -> None:
    """Refuse two different horizontal systems; `what` names the two things that meet."""
    if not a.equals(b, ignore_axis_order=True):
        raise InputError(
            f"{what} are in different systems, {a.name} and {b.name}; reproject one of them to the other."
        )


def same_vertical_datum(a: str, b: str, what: str) -> None:
    """Refuse heights above two different datums; an unstated datum agrees with any."""
    if a != b and UNSTATED not in (a, b):
        raise InputError(
            f"{what} have heights above different vertical datums, {a!r} and {b!r}; they differ by tens of metres, "
            "transform one of them first."
        )


def transformed(xy: FloatArray, source: Any, target: CRS, where: str) -> FloatArray:
    """Transform easting/northing or longitude/latitude (N, 2) into the target CRS.

    Refuses when PROJ has no path, or places a point outside what the target can show.
    """
    try:
        transformer = Transformer.from_crs(source, target, always_xy=True)
        east, north = transformer.transform(xy[:, 0], xy[:, 1], errcheck=True)
    except (CRSError, ProjError) as error:
        raise InputError(f"{where} cannot be transformed to {target.name}: {error}.") from error
    result: FloatArray = frozen(list(zip(east, north, strict=True)))
    return result.reshape(-1, 2)
