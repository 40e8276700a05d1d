"""Coordinate reference systems and vertical datums: checks and agreement.

firnline computes in one projected CRS in metres per survey; a geographic CRS is refused. The functions refuse a CRS that
is unknown or does not agree with another, coordinates that are not on Earth, and eastings and northings that are
exchanged or in degrees. They transform nothing; `survey.core.transformation` does.

Importing this module keeps PROJ from downloading grids, whatever ``PROJ_NETWORK`` says, because a data file decides by
its CRS which grids are requested. ``FIRNLINE_PROJ_NETWORK=ON`` in the environment allows it.
"""

import os
import re
import warnings
from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError
from pyproj.network import set_network_enabled  # type: ignore[attr-defined]  # pyproj lists no exports

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.text import printable

NETWORK_VARIABLE = "FIRNLINE_PROJ_NETWORK"
"""Environment variable that allows PROJ to download grids when it is ``ON``."""

if os.environ.get(NETWORK_VARIABLE) != "ON":
    os.environ["PROJ_NETWORK"] = "OFF"  # for the copies of PROJ within GDAL's bindings
    set_network_enabled(False)


FARTHEST_M = 1e8
"""Largest easting or northing of a place on Earth in any projected CRS, zone numbers in front included."""


# A CRS that names a file by its path would have PROJ open it; plain names stand for PROJ's own grids.
_PATH_IN_CRS = re.compile(
    r"""(?:grids|file|init|catalog)\s*=\s*[^\s"]*[/\\]|(?:PARAMETERFILE|PROJ4_GRIDS)[^\]]*[/\\]|\.(?:gsb|gtx|tif)"[^"]*://""",
    re.IGNORECASE,
)
_LONGEST_NAME = 80


def known_crs(crs: Any, where: str) -> CRS:
    """Return a CRS that PROJ knows, of whatever kind, or refuse."""
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

    Returns: ``AUTHORITY:CODE`` where the CRS is exactly that of the code, else WKT 2 (2019).

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
            f"{where} is in {horizontal.name}, whose unit is the {unit_name(horizontal)}; metres are needed, reproject it (gdalwarp -t_srs, ogr2ogr -t_srs)."
        )
    return horizontal.to_2d() if len(horizontal.axis_info) > 2 else horizontal


def unit_name(crs: CRS) -> str:
    """Return the name of the unit of the first axis of a CRS."""
    return str(crs.axis_info[0].unit_name) if crs.axis_info else "unknown unit"


def refuse_far(xy: Any, where: str) -> None:
    """Refuse coordinates that no projected CRS has anywhere on Earth.

    `xy`: eastings and northings [m], of any shape.
    """
    values = np.abs(np.asarray(xy, dtype=np.float64))
    if values.size and float(values.max()) > FARTHEST_M:
        raise InputError(
            f"{where} has the coordinate {values.max():.3g} m, and none on Earth is beyond {FARTHEST_M:.0e} m; correct it."
        )


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


# Spellings of the datums that are known by name, and of names that say nothing.
_SPELLED_DATUMS = {
    ELLIPSOIDAL: r"^ellipsoid|^wgs ?84 (ellipsoid|height)|ellipsoidal? (height|ht)",
    "NAVD88 height": r"navd ?(19)?88|north american vertical datum (of )?1988|geoid ?(20)?(03|06|09|12|18)|\bg20(03|06|09|12|18)",
    "EGM96 height": r"egm ?(19)?96",
    "EGM2008 height": r"egm ?(20)?08",
    "EGM84 height": r"egm ?(19)?84",
}
_SAYS_NOTHING = re.compile(
    r"^(unknown|unnamed|undefined|unstated|not specified|none)\b|^(vertical|height|up)?$"
)
_UNIT_OF_DATUM = re.compile(
    r"\s*\((ft|ftUS|US survey foot|US survey feet|ft intl|foot|feet|m|metre|meter|metres|meters)\)$", re.I
)


def known_datum(name: str) -> str | None:
    """Return the name that a vertical datum has here by any of its spellings; None for one that is not known.

    >>> known_datum("NAVD88 - Geoid12A (ftUS)"), known_datum("us_nga_egm96_15.tif"), known_datum("DVR90 height")
    ('NAVD88 height', 'EGM96 height', None)
    """
    plain = re.sub(r"[\W_]+", " ", name).lower().strip()
    return next((known for known, spelled in _SPELLED_DATUMS.items() if re.search(spelled, plain)), None)


def datum_named(name: str, grids: str = "") -> str:
    """Return the vertical datum of a name that a file states, and of the grids of its geoid; ``""`` where they say nothing.

    PROJ calls every surface that it has no name for ``unknown``; two of them need not be one.

    >>> datum_named("unknown"), datum_named("unknown", "egm96_15.gtx"), datum_named("NAVD88 height (ftUS)")
    ('', 'EGM96 height', 'NAVD88 height')
    """
    plain = re.sub(r"[\W_]+", " ", name).lower().strip()
    if _SAYS_NOTHING.search(plain):
        return UNSTATED if not grids else known_datum(grids) or f"height above {grids}"
    return _UNIT_OF_DATUM.sub("", name)


def vertical_datum_of(crs: Any) -> str:
    """Return the name of the vertical part of a CRS, or ``""`` when it has none or one that says nothing.

    >>> vertical_datum_of("EPSG:32608+5773")
    'EGM96 height'
    >>> vertical_datum_of("EPSG:32608"), vertical_datum_of("+proj=utm +zone=8 +geoidgrids=egm96_15.gtx +type=crs")
    ('', 'EGM96 height')
    """
    full = known_crs(crs, "the file")
    if full.is_compound:
        vertical = full.sub_crs_list[1]
        unit = unit_name(vertical)
        if unit not in ("metre", "meter", "m"):
            raise InputError(
                f"the heights count in {vertical.name}, whose unit is the {unit}; metres are needed, name the horizontal CRS alone with --crs, and the "
                "unit of the heights with --units ft or us-ft where the command has that option."
            )
        if vertical.axis_info and vertical.axis_info[0].direction.lower() == "down":
            raise InputError(
                f"the CRS counts {vertical.name} downwards; elevations upwards are needed, change the sign and the CRS first."
            )
        way = vertical.coordinate_operation
        grids = "" if way is None else ", ".join(str(each.short_name) for each in way.grids)
        return datum_named(str(vertical.name), grids)
    return ELLIPSOIDAL if len(full.axis_info) > 2 else UNSTATED


def same_vertical_datum(a: str, b: str, what: str) -> None:
    """Refuse heights above two different datums; an unstated datum agrees with any, and spellings of one with each other.

    >>> same_vertical_datum("NAVD88 height", "NAVD88 - Geoid12A (Meters)", "the two surveys")
    """
    names = datum_named(a), datum_named(b)
    known = [known_datum(name) or name for name in names]
    if UNSTATED in names or known[0] == known[1]:
        return
    by = "how much these differ is not known here"
    if set(known) <= set(_SPELLED_DATUMS):
        by = "they differ by decimetres to some metres"
        if ELLIPSOIDAL in known:
            by = "they differ by up to a hundred metres"
    raise InputError(
        f"{what} have heights above different vertical datums, {a!r} and {b!r}; {by}, transform one of them first "
        "(gdalwarp -s_srs … -t_srs … for a raster, cs2cs for points)."
    )


def datum_of_file(stated: str, crs: Any, where: str) -> str:
    """Return the vertical datum of a file: its own, or that of the CRS that was named for it.

    Returns: name of the datum, ``""`` where neither states one.

    >>> datum_of_file("", "EPSG:32608+5773", "dem.tif")
    'EGM96 height'
    """
    named = UNSTATED if crs is None else vertical_datum_of(crs)
    same_vertical_datum(stated, named, f"{where} and the CRS that was named for it")
    return stated or named


def equal_crs(a: CRS, b: CRS) -> bool:
    """Return whether two systems place every point alike; the order of axes does not count.

    A datum without a name of its own is compared by its ellipsoid, for file formats rename it.

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
    """Refuse two different horizontal systems; `what` names the two things that meet."""
    _refuse_one_local(a, b, what)
    if not equal_crs(a, b):
        raise InputError(
            f"{what} are in different systems, {a.name} and {b.name}; reproject one of them to the other."
        )


def agreed_crs(stated: Any, named: Any, where: str) -> CRS:
    """Return the projected CRS of a file: the stated one, else the one that a user named.

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


# Zones are used beyond their limits, but not by this much [deg].
_BEYOND_DEG = 5.0
# A CRS of larger areas has places of so few metres as well.
_LARGEST_AREA_DEG2 = 360.0 * 180.0 / 5.0
# A survey of more degrees is none, and one of fewer metres neither.
_LARGEST_EXTENT_DEG = 2.0


def refuse_exchanged(xy: FloatArray, crs: CRS, where: str) -> None:
    """Refuse places that lie far outside the area of use of their CRS, and within it with exchanged coordinates.

    `xy` (N, 2): eastings and northings [m].

    >>> refuse_exchanged(np.array([[5e5, 6.7e6]]), CRS("EPSG:32608"), "the area")
    >>> refuse_exchanged(np.array([[6.7e6, 5e5]]), CRS("EPSG:32608"), "the area")
    Traceback (most recent call last):
    survey.core.errors.InputError: the area lies at easting 6700000 m and northing 500000 m, ...
    """
    places = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    if not len(places) or crs.area_of_use is None or not np.isfinite(places).all():
        return
    east, north = places.mean(axis=0).tolist()
    if _is_in_use(east, north, crs, _BEYOND_DEG) or not _is_in_use(north, east, crs, 0.0):
        return
    raise InputError(
        f"{where} lies at easting {east:.0f} m and northing {north:.0f} m, far outside the area of {crs.name}, and within "
        "it when the two are exchanged; exchange them, or name the CRS that is meant."
    )


def refuse_degrees(xy: FloatArray, crs: CRS, where: str) -> None:
    """Refuse places that are degrees within the area of use of a projected CRS, in metres.

    `xy` (N, 2): eastings and northings [m].

    >>> refuse_degrees(np.array([[-135.0, 60.4], [-134.9, 60.5]]), CRS("EPSG:32608"), "the area")
    Traceback (most recent call last):
    survey.core.errors.InputError: the area has coordinates such as -135, 60.4, which are degrees and no metres of ...
    """
    places = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    area: Any = crs.area_of_use
    if len(places) < 2 or area is None or not crs.is_projected or not np.isfinite(places).all():
        return
    width, height = (area.east - area.west) % 360.0 or 360.0, area.north - area.south
    lon, lat = places.T
    is_within = ((lon - area.west) % 360.0 <= width).all() and (abs(lon) <= 180.0).all()
    is_within &= (lat >= area.south).all() and (lat <= area.north).all()
    extent = np.ptp(places, axis=0)
    if is_within and width * height <= _LARGEST_AREA_DEG2 and 0.0 < extent.max() < _LARGEST_EXTENT_DEG:
        raise InputError(
            f"{where} has coordinates such as {lon[0]:.7g}, {lat[0]:.7g}, which are degrees and no metres of {crs.name}; "
            "name the columns lon and lat, or save the file in its own CRS (EPSG:4326)."
        )


def _is_in_use(east: float, north: float, crs: CRS, beyond_deg: float) -> bool:
    """Return whether a place lies in the area of use of a CRS, or by so many degrees beyond it."""
    area: Any = crs.area_of_use
    try:
        lon, lat = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True).transform(
            east, north, errcheck=True
        )
    except ProjError:
        return False
    if not np.isfinite([lon, lat]).all():
        return False
    from_west, width = (lon - area.west) % 360.0, (area.east - area.west) % 360.0 or 360.0
    is_between = from_west <= width + beyond_deg or from_west >= 360.0 - beyond_deg
    return bool(is_between and area.south - beyond_deg <= lat <= area.north + beyond_deg)
