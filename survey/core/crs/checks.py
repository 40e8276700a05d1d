"""Checks of coordinate reference systems: projected, in metres, with coordinates on Earth.

firnline computes in one projected CRS in metres per survey; a geographic CRS is refused.
"""

import re
from typing import Any

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from survey.core.errors import InputError
from survey.core.text import printable

FARTHEST_M = 1e8
"""Largest easting or northing of a place on Earth in any projected CRS, zone numbers in front included."""


# A CRS that names a file by its path would have PROJ open it; plain names stand for PROJ's own grids.
_PATH_IN_CRS = re.compile(
    r"""(?:grids|file|init|catalog)\s*=\s*[^\s"]*[/\\]|(?:PARAMETERFILE|PROJ4_GRIDS)[^\]]*[/\\]|\.(?:gsb|gtx|tif)"[^"]*://""",
    re.IGNORECASE,
)
_LONGEST_NAME = 80


def known_crs(crs: Any, where: str) -> CRS:
    """Return a CRS that PROJ knows, of whatever kind, or refuse.

    Parameters
    ----------
    crs : str, int or pyproj.CRS
        An EPSG code, WKT, PROJ text or PROJJSON.
    where : str
        What carries the CRS, for the message.

    Returns
    -------
    pyproj.CRS
        The CRS as it was stated.

    Raises
    ------
    InputError
        No CRS, one that PROJ does not know, or one that names files by their paths or addresses.
    """
    if crs is None or crs == "":
        raise InputError(f"{where} carries no coordinate reference system; name it, e.g. crs=EPSG:32608.")
    if isinstance(crs, CRS):
        return crs
    shown = printable(str(crs))[:_LONGEST_NAME]
    if isinstance(crs, str) and _PATH_IN_CRS.search(crs):
        raise InputError(
            f"{where} names the CRS {shown!r}, which leads to files by their paths; give an EPSG code, or the names of PROJ's own grids."
        )
    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        raise InputError(
            f"{where} names the CRS {shown!r}, which PROJ does not know; give an EPSG code."
        ) from error


def crs_text(crs: CRS) -> str:
    """Return a text of one line from which a CRS comes back unchanged.

    Parameters
    ----------
    crs : pyproj.CRS
        Of any kind, with or without a code.

    Returns
    -------
    str
        ``AUTHORITY:CODE`` where the CRS is exactly that of the code, else WKT 2 (2019).

    Examples
    --------
    >>> crs_text(CRS("EPSG:32608"))
    'EPSG:32608'
    >>> own = CRS("+proj=tmerc +lat_0=46 +lon_0=10.5 +ellps=GRS80 +units=m")
    >>> CRS(crs_text(own)) == own
    True
    """
    authority = crs.to_authority(min_confidence=100)
    if authority is not None:
        code = ":".join(authority)
        if CRS(code).equals(crs):
            return code
    return crs.to_wkt("WKT2_2019", pretty=False)


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
    full = known_crs(crs, where)
    horizontal = full.sub_crs_list[0] if full.is_compound else full
    if horizontal.is_geographic or horizontal.is_geocentric:
        raise InputError(
            f"{where} is in {horizontal.name} ({unit_name(horizontal)}s), but distances are needed in metres; "
            "reproject it to a projected CRS such as its UTM zone."
        )
    if unit_name(horizontal) not in ("metre", "meter", "m"):
        raise InputError(
            f"{where} is in {horizontal.name}, whose unit is the {unit_name(horizontal)}; metres are needed, reproject it."
        )
    return horizontal.to_2d() if len(horizontal.axis_info) > 2 else horizontal


def unit_name(crs: CRS) -> str:
    """Return the name of the unit of the first axis of a CRS."""
    return str(crs.axis_info[0].unit_name) if crs.axis_info else "unknown unit"


def refuse_far(xy: Any, where: str) -> None:
    """Refuse coordinates that no projected CRS has anywhere on Earth.

    Parameters
    ----------
    xy : array_like
        Eastings and northings [m], of any shape.
    where : str
        What carries them, for the message.

    Raises
    ------
    InputError
        One of them is beyond `FARTHEST_M`.
    """
    values = np.abs(np.asarray(xy, dtype=np.float64))
    if values.size and float(values.max()) > FARTHEST_M:
        raise InputError(
            f"{where} has the coordinate {values.max():.3g} m, and none on Earth is beyond {FARTHEST_M:.0e} m; correct it."
        )
