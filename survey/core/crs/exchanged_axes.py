"""Detection of coordinates that are not those of their CRS: easting and northing exchanged, or degrees."""

from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

# Zones are used beyond their limits, but not by this much [deg].
_BEYOND_DEG = 5.0
# A CRS of larger areas has places of so few metres as well.
_LARGEST_AREA_DEG2 = 360.0 * 180.0 / 5.0
# A survey of more degrees is none, and one of fewer metres neither.
_LARGEST_EXTENT_DEG = 2.0


def refuse_exchanged(xy: FloatArray, crs: CRS, where: str) -> None:
    """Refuse places that lie far outside the area of use of their CRS, and within it with exchanged coordinates.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Eastings and northings [m].
    crs : pyproj.CRS
        Projected. Without an area of use nothing is refused.
    where : str
        What carries the places, for the message.

    Raises
    ------
    InputError
        Easting and northing are exchanged.

    Examples
    --------
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

    Parameters
    ----------
    xy : (N, 2) ndarray
        Eastings and northings [m].
    crs : pyproj.CRS
        Projected. Without an area of use, or with one of more than a fifth of the Earth, nothing is refused.
    where : str
        What carries the places, for the message.

    Raises
    ------
    InputError
        All places are a longitude and a latitude of the area of use, within 2 degrees of each other.

    Examples
    --------
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
