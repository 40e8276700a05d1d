"""Choice of a projected CRS for places in degrees: UTM zone, or polar stereographic near the poles."""

from typing import Any

import numpy as np
from pyproj import CRS
from pyproj.crs import ProjectedCRS

from survey.core.arrays import FloatArray
from survey.core.crs.checks import known_crs
from survey.core.errors import InputError

NORTHERN_LIMIT_DEG, SOUTHERN_LIMIT_DEG = 84.0, -80.0
"""Latitudes between which UTM is defined."""
_WGS84 = CRS("EPSG:4326")


def chosen_crs(longitude_deg: FloatArray, latitude_deg: FloatArray, geographic: Any = _WGS84) -> CRS:
    """Return the projected CRS of places in degrees, on their own geodetic datum.

    Parameters
    ----------
    longitude_deg, latitude_deg : (N,) ndarray
        Places, or the corners of what holds them [deg].
    geographic : str, int or pyproj.CRS
        The geographic CRS of the places.

    Returns
    -------
    pyproj.CRS
        The UTM zone of their middle. Beyond 84° N and 80° S the polar stereographic system of
        EPSG:3413 or EPSG:3031, whose scale is 1 at 70° N or 71° S and up to 3 % less at the pole.

    Raises
    ------
    InputError
        A latitude beyond the poles.

    Examples
    --------
    >>> chosen_crs(np.array([-135.2, -134.9]), np.array([58.4, 58.5])).to_epsg()
    32608
    >>> chosen_crs(np.array([10.0]), np.array([-85.0])).to_epsg()
    3031
    >>> chosen_crs(np.array([-135.0]), np.array([58.4]), "EPSG:4269").name
    'NAD83 / UTM zone 8N'
    """
    angles = np.deg2rad(longitude_deg)
    mean = float(np.rad2deg(np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())))
    beside = (np.asarray(longitude_deg) - mean + 180.0) % 360.0 - 180.0
    longitude = mean + float(0.5 * (beside.min() + beside.max()))
    latitude = float(0.5 * (latitude_deg.min() + latitude_deg.max()))
    if not (abs(latitude) <= 90.0 and np.isfinite(longitude)):
        raise InputError(
            f"the place {latitude:.6g}° N, {longitude:.6g}° E is not on Earth; check the order of the coordinates."
        )
    return _on_datum(CRS.from_epsg(_wgs84_code(longitude, latitude)), geographic_of(geographic))


def geographic_of(crs: Any) -> CRS:
    """Return the horizontal part of a geographic CRS: longitude and latitude without heights.

    Parameters
    ----------
    crs : str, int or pyproj.CRS
        Geographic; compound and three-dimensional ones give their horizontal part.

    Returns
    -------
    pyproj.CRS
        Two-dimensional.

    Examples
    --------
    >>> geographic_of("EPSG:4326+5773").to_epsg(), geographic_of("EPSG:4979").to_epsg()
    (4326, 4326)
    """
    full = known_crs(crs, "the data")
    horizontal = full.sub_crs_list[0] if full.is_compound else full
    return horizontal.to_2d()


def is_geographic(crs: Any) -> bool:
    """Return whether the horizontal part of a CRS is geographic, its coordinates being degrees.

    Parameters
    ----------
    crs : str, int, pyproj.CRS or None
        None stands for an unknown system.

    Returns
    -------
    bool
        False for an unknown system.

    Examples
    --------
    >>> is_geographic("EPSG:4326+5773"), is_geographic("EPSG:32608"), is_geographic(None)
    (True, False, False)
    """
    return crs is not None and bool(known_crs(crs, "the data").is_geographic)


def coded_crs(crs: CRS) -> CRS | None:
    """Return the registered CRS that equals `crs`, or ``None``.

    Examples
    --------
    >>> coded_crs(CRS("+proj=utm +zone=8 +datum=WGS84 +units=m")).to_epsg()
    32608
    >>> coded_crs(CRS("+proj=lcc +lat_1=60 +lat_2=62 +lon_0=-123 +datum=WGS84")) is None
    True
    """
    authority = crs.to_authority(min_confidence=70)
    if authority is None:
        return None
    registered = CRS.from_authority(*authority)
    return registered if registered.equals(crs, ignore_axis_order=True) else None


def _wgs84_code(longitude_deg: float, latitude_deg: float) -> int:
    """Return the code of the projected CRS of a place on WGS 84."""
    if latitude_deg > NORTHERN_LIMIT_DEG:
        return 3413
    if latitude_deg < SOUTHERN_LIMIT_DEG:
        return 3031
    return (32600 if latitude_deg >= 0.0 else 32700) + int((longitude_deg + 180.0) // 6.0) % 60 + 1


def _on_datum(model: CRS, geographic: CRS) -> CRS:
    """Return a projection of WGS 84 on another datum; registered systems by their code."""
    if geographic.equals(_WGS84, ignore_axis_order=True):
        return model
    projection = model.name.removeprefix("WGS 84 / ")
    name = f"{geographic.name} / {projection}"
    made = ProjectedCRS(model.coordinate_operation, name=name, geodetic_crs=geographic)
    return coded_crs(made) or made
