"""Coordinate reference systems and vertical datums: refused when they do not fit.

firnline computes in one projected CRS in metres per survey. Degrees are refused, so are
two surveys in different systems and heights above different vertical datums.
"""

import re
import warnings
from typing import Any

import numpy as np
from pyproj import CRS, Transformer, datadir
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from survey.core.arrays import FloatArray, frozen
from survey.core.errors import InputError
from survey.core.text import printable

FARTHEST_M = 1e8
"""Largest easting or northing of a place on Earth in any projected CRS, zone numbers in front included."""
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
        unit = _unit(vertical)
        if unit not in ("metre", "meter", "m"):
            raise InputError(
                f"the heights count in {vertical.name}, whose unit is the {unit}; metres are needed, convert them first."
            )
        return str(vertical.name)
    return ELLIPSOIDAL if len(full.axis_info) > 2 else UNSTATED


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


def equal_crs(a: CRS, b: CRS) -> bool:
    """Return whether two systems place every point alike; the order of axes does not count.

    A datum without a name of its own is compared by its ellipsoid, for file formats rename it.

    Parameters
    ----------
    a, b : pyproj.CRS
        The systems.

    Returns
    -------
    bool
        True where coordinates of one can be used in the other.

    Examples
    --------
    >>> own = CRS("+proj=tmerc +lat_0=46 +lon_0=10.5 +ellps=GRS80 +units=m")
    >>> equal_crs(own, CRS(own.to_wkt("WKT1_ESRI")))
    True
    >>> equal_crs(own, CRS("EPSG:32608"))
    False
    """
    if a.equals(b, ignore_axis_order=True):
        return True
    if not (_has_unnamed_datum(a) and _has_unnamed_datum(b)):
        return False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PROJ text loses the names, which is what it is used for here
        return a.to_proj4() == b.to_proj4()


def _has_unnamed_datum(crs: CRS) -> bool:
    return crs.datum is not None and "unknown" in crs.datum.name.lower()


def same_crs(a: CRS, b: CRS, what: str) -> None:
    """Refuse two different horizontal systems; `what` names the two things that meet.

    Parameters
    ----------
    a, b : pyproj.CRS
        Projected systems.
    what : str
        The two things that meet, for the message.
    """
    _refuse_one_local(a, b, what)
    if not equal_crs(a, b):
        raise InputError(
            f"{what} are in different systems, {a.name} and {b.name}; reproject one of them to the other."
        )


def agreed_crs(stated: Any, named: Any, where: str) -> CRS:
    """Return the projected CRS of a file: the stated one, else the one that a user named.

    Parameters
    ----------
    stated, named : str, pyproj.CRS or None
        Of the file and of the request. A local CRS (LOCAL_CS) of the file counts as none where one is named.
    where : str
        Name of the file, for the message.

    Returns
    -------
    pyproj.CRS
        Projected, in metres.

    Raises
    ------
    InputError
        Neither is given, the two differ, or as `projected_crs` does.

    Examples
    --------
    >>> agreed_crs('LOCAL_CS["site grid",UNIT["metre",1]]', "EPSG:32608", "the map").to_epsg()
    32608
    """
    if stated is None or named is None:
        return projected_crs(named if stated is None else stated, where)
    if is_local(stated):
        return projected_crs(named, where)
    of_file, wanted = projected_crs(stated, where), projected_crs(named, "the request")
    if not equal_crs(of_file, wanted):
        raise InputError(
            f"{where} is in {of_file.name}, but {wanted.name} was named; leave the CRS out or correct it."
        )
    return of_file


def is_local(crs: Any) -> bool:
    """Return whether a CRS is a local (engineering) one, which no transformation ties to the Earth.

    Examples
    --------
    >>> is_local('LOCAL_CS["site grid",UNIT["metre",1]]'), is_local("EPSG:32608")
    (True, False)
    """
    return bool(known_crs(crs, "the data").is_engineering)


def _refuse_one_local(a: CRS, b: CRS, what: str) -> None:
    """Refuse a local system beside a geodetic one: it can be assigned a CRS, not reprojected."""
    local = [crs for crs in (a, b) if crs.is_engineering]
    if len(local) == 1:
        raise InputError(
            f"{what} are in different systems, and {local[0].name} is a local one (LOCAL_CS) that cannot be reprojected; "
            "assign its file the CRS that it was surveyed in, with --crs or gdal_edit.py -a_srs."
        )


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


def transformed(xy: FloatArray, source: Any, target: CRS, where: str) -> FloatArray:
    """Transform easting/northing or longitude/latitude (N, 2) into the target CRS.

    Refuses when PROJ has no path, or places a point outside what the target can show.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Easting and northing [m], or longitude and latitude [deg].
    source : str, int or pyproj.CRS
        Of `xy`.
    target : pyproj.CRS
        Of the result.
    where : str
        What carries the places, for the message.

    Returns
    -------
    (N, 2) ndarray
        Easting and northing, or longitude and latitude, in the target CRS.
    """
    origin = known_crs(source, where)
    try:
        transformer = Transformer.from_crs(origin, target, always_xy=True)
        east, north = transformer.transform(xy[:, 0], xy[:, 1], errcheck=True)
    except (CRSError, ProjError) as error:
        raise InputError(f"{where} cannot be transformed to {target.name}: {error}.") from error
    result: FloatArray = frozen(list(zip(east, north, strict=True)))
    return result.reshape(-1, 2)


class MissingGridError(InputError):
    """A change of vertical datum for which PROJ lacks its grids."""


def heights_transformed(
    xyz: FloatArray, crs: CRS, source_datum: str, target_datum: str, where: str
) -> FloatArray:
    """Transform heights (N, 3) from one vertical datum to another at places of a projected CRS [m].

    Parameters
    ----------
    xyz : (N, 3) ndarray
        Easting, northing, height [m].
    crs : pyproj.CRS
        Of easting and northing.
    source_datum, target_datum : str
        ``ellipsoidal height`` or a name of `VERTICAL_CRS`.
    where : str
        What carries the heights, for the message.

    Returns
    -------
    (N,) ndarray
        Heights above the target datum [m].

    Raises
    ------
    InputError
        An unknown datum; the grids that PROJ needs and does not have are named. Heights are
        never passed through unchanged instead.
    """
    if source_datum == target_datum:
        return xyz[:, 2]
    group = _operations(crs, source_datum, target_datum, where)
    missing = missing_grids(group)
    if not group.best_available or not group.transformers:
        place = datadir.get_user_data_dir()  # type: ignore[attr-defined]  # public, but not listed
        raise MissingGridError(
            f"{where}: heights cannot be taken from {source_datum!r} to {target_datum!r}, for PROJ lacks "
            f"{', '.join(missing) or 'an operation between them'}; install it into {place}."
        )
    east, north, up = xyz.T
    heights: FloatArray = frozen(group.transformers[0].transform(east, north, up)[2])
    if not np.isfinite(heights).all():
        raise InputError(
            f"{where}: {int((~np.isfinite(heights)).sum())} places lie outside the grid between {source_datum!r} and {target_datum!r}; cut them off."
        )
    return heights


def missing_grids(group: TransformerGroup) -> list[str]:
    """Return the names of the grids without which the operations of a group cannot run.

    Parameters
    ----------
    group : pyproj.transformer.TransformerGroup
        Operations between two systems.

    Returns
    -------
    list of str
        File names.
    """
    names = {
        grid.short_name for way in group.unavailable_operations for grid in way.grids if not grid.available
    }
    return sorted(names)


def lacking_grids(crs: Any = "EPSG:32608") -> dict[str, list[str]]:
    """Return, for every known vertical datum, the grids that PROJ lacks to reach it from the ellipsoid.

    Parameters
    ----------
    crs : str, int or pyproj.CRS
        A projected CRS of the region in question.

    Returns
    -------
    dict of str to list of str
        Names of grids by vertical datum; empty lists where nothing lacks.

    Examples
    --------
    >>> sorted(lacking_grids()) == sorted(VERTICAL_CRS)
    True
    """
    horizontal = projected_crs(crs, "the CRS")
    found = {}
    for datum in VERTICAL_CRS:
        group = _operations(horizontal, ELLIPSOIDAL, datum, "the check")
        found[datum] = [] if group.best_available and group.transformers else missing_grids(group)
    return found


def _operations(crs: CRS, source_datum: str, target_datum: str, where: str) -> TransformerGroup:
    """Return every way between two datums; rough guesses that leave heights as they are do not count."""
    source, target = (_with_datum(crs, datum, where) for datum in (source_datum, target_datum))
    with warnings.catch_warnings():
        # pyproj warns where the best way lacks its grid; that is what is asked here.
        warnings.simplefilter("ignore")
        return TransformerGroup(source, target, always_xy=True, allow_ballpark=False)


def _with_datum(crs: CRS, datum: str, where: str) -> CRS:
    if datum == ELLIPSOIDAL:
        return crs.to_3d()
    if datum not in VERTICAL_CRS:
        raise InputError(
            f"{where} names the vertical datum {datum!r}; one of {ELLIPSOIDAL}, {', '.join(VERTICAL_CRS)} can be transformed."
        )
    return CompoundCRS(f"{crs.name} + {datum}", [crs, CRS.from_user_input(VERTICAL_CRS[datum])])
