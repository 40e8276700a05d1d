"""Transformation between coordinate reference systems, and choice of a projected CRS for places in degrees.

Coordinates and heights are transformed by PROJ. Grids that an operation needs and that are not installed are named. The
chosen CRS is the UTM zone of the places, or polar stereographic near the poles.
"""

import warnings
from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS, ProjectedCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from survey.core.arrays import FloatArray, frozen
from survey.core.crs import VERTICAL_CRS, known_crs, projected_crs
from survey.core.errors import InputError


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
        group = _operations(horizontal, datum)
        found[datum] = [] if group.best_available and group.transformers else missing_grids(group)
    return found


def _operations(crs: CRS, datum: str) -> TransformerGroup:
    """Return every operation from the ellipsoid to a vertical datum; ballpark ones that leave heights as they are do not count."""
    target = CompoundCRS(f"{crs.name} + {datum}", [crs, CRS.from_user_input(VERTICAL_CRS[datum])])
    with warnings.catch_warnings():
        # pyproj warns where the best operation lacks its grid; that is what is asked here.
        warnings.simplefilter("ignore")
        return TransformerGroup(crs.to_3d(), target, always_xy=True, allow_ballpark=False)


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
