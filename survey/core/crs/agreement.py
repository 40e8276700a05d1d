"""Comparison of coordinate reference systems."""

import warnings
from typing import Any

from pyproj import CRS

from survey.core.crs.checks import known_crs, projected_crs
from survey.core.errors import InputError


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
