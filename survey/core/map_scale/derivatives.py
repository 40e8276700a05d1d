"""Derivatives of a projection: how far a step on the map leads over the ellipsoid."""

from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from survey.core.arrays import FloatArray
from survey.core.crs.checks import projected_crs
from survey.core.errors import InputError

# Half of the distance over which the inverse projection is differentiated.
_HALF_STEP_M = 10.0


def ground_jacobian(crs: Any, xy: Any) -> FloatArray:
    """Return the derivatives (N, 2, 2) of ground east and north [m] by grid easting and northing [m]."""
    places = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    horizontal = _unbound(projected_crs(crs, "the map"))
    geodetic = horizontal.geodetic_crs
    if geodetic is None or not horizontal.is_projected:
        return np.broadcast_to(np.eye(2), (len(places), 2, 2))
    steps = _HALF_STEP_M * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    lon, lat = _inverse(horizontal, geodetic, (places + steps[:, None]).reshape(-1, 2))
    radius_m, flattening = _ellipsoid(geodetic)
    position = _geocentric(lon, lat, radius_m, flattening).reshape(5, -1, 3)
    tangents = np.stack([position[1] - position[2], position[3] - position[4]], axis=-1) / (
        2.0 * _HALF_STEP_M
    )
    return _east_north(lon[: len(places)], lat[: len(places)]) @ tangents


def _unbound(crs: CRS) -> CRS:
    return crs.source_crs if crs.is_bound and crs.source_crs is not None else crs


def _ellipsoid(geodetic: CRS) -> tuple[float, float]:
    geod = geodetic.get_geod()
    if geod is None:
        raise InputError(f"{geodetic.name} states no ellipsoid; assign a CRS that does.")
    return float(geod.a), float(geod.f)


def _inverse(crs: CRS, geodetic: CRS, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return longitude and latitude (N,) [rad]."""
    try:
        transformer = Transformer.from_crs(crs, geodetic.to_2d(), always_xy=True)
        lon, lat = transformer.transform(xy[:, 0], xy[:, 1])
    except ProjError as error:
        raise InputError(
            f"the scale of {crs.name} cannot be computed ({error}); reproject the data."
        ) from error
    angles = np.deg2rad(np.stack([lon, lat]))
    if not np.isfinite(angles).all():
        raise InputError(
            f"a place lies outside what {crs.name} can show; check the coordinates and their CRS."
        )
    return angles[0], angles[1]


def _geocentric(lon: FloatArray, lat: FloatArray, radius_m: float, flattening: float) -> FloatArray:
    """Return geocentric coordinates (N, 3) [m] on the ellipsoid."""
    squared = flattening * (2.0 - flattening)
    normal = radius_m / np.sqrt(1.0 - squared * np.sin(lat) ** 2)
    across = normal * np.cos(lat)
    return np.column_stack(
        [across * np.cos(lon), across * np.sin(lon), normal * (1.0 - squared) * np.sin(lat)]
    )


def _east_north(lon: FloatArray, lat: FloatArray) -> FloatArray:
    """Return the unit vectors to the east and north (N, 2, 3) in geocentric coordinates."""
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=-1)
    north = np.stack([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)], axis=-1)
    return np.stack([east, north], axis=1)
