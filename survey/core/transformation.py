"""Transformation between coordinate reference systems, and choice of a projected CRS for places in degrees.

A CRS in feet has a twin in metres, in which every coordinate is its own times the metres of a foot. Coordinates and heights are transformed by PROJ. Grids that an operation needs and that are not installed are named. The
chosen CRS is the UTM zone of the places, or polar stereographic near the poles.
"""

import warnings
from typing import Any, NamedTuple

import numpy as np
from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS, ProjectedCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from survey.core.arrays import FloatArray, frozen
from survey.core.crs import VERTICAL_CRS, datum_named, known_crs, projected_crs
from survey.core.errors import InputError


class MetricCrs(NamedTuple):
    """A CRS in metres, and the metres in a unit of the system that it stands for.

    `crs`: the twin in metres; the system itself where that is in metres or degrees. `place_m`: of its eastings and
    northings. `height_m`: of its heights; None where it has none.
    """

    crs: CRS
    place_m: float = 1.0
    height_m: float | None = None


def metric_crs(crs: Any, where: str) -> MetricCrs:
    """Return the twin in metres of a system that counts in another unit of length, such as feet.

    >>> metric_crs("EPSG:2263+6360", "the points").crs.name
    'NAD83 / New York Long Island + NAVD88 height'
    """
    full = known_crs(crs, where)
    parts = full.sub_crs_list if full.is_compound else [full]
    height_m = None
    if full.is_compound or len(full.axis_info) > 2:
        height_m = float(full.axis_info[-1].unit_conversion_factor)
    place_m = 1.0 if parts[0].is_geographic else float(full.axis_info[0].unit_conversion_factor or 1.0)
    if place_m == 1.0 and height_m in (None, 1.0):
        return MetricCrs(full, 1.0, height_m)
    twins = [_in_metres(part) for part in parts]
    if len(twins) == 1:
        return MetricCrs(twins[0], place_m, height_m)
    return MetricCrs(CompoundCRS(" + ".join(twin.name for twin in twins), twins), place_m, height_m)


def _in_metres(crs: CRS) -> CRS:
    """Return a system with its axes in metres; a registered one where it equals one."""
    stated = crs.to_json_dict()
    if not _set_metres(stated):
        return crs
    made = CRS.from_json_dict(stated)
    return coded_crs(made) or made


def _set_metres(stated: dict[str, Any]) -> bool:
    """Count the lengths of the axes of a system in metres, within what it is made of; return whether any were others."""
    axes = stated.get("coordinate_system", {}).get("axis", [])
    lengths = [
        axis for axis in axes if isinstance(axis["unit"], dict) and axis["unit"]["type"] == "LinearUnit"
    ]
    for axis in lengths:
        axis["unit"] = "metre"
    if lengths:
        stated.pop("id", None)
        stated["name"] = datum_named(stated["name"]) or stated["name"]
    return bool(lengths) | (_set_metres(stated["source_crs"]) if "source_crs" in stated else False)


def transformed(xy: FloatArray, source: Any, target: CRS, where: str) -> FloatArray:
    """Transform easting/northing or longitude/latitude (N, 2) into the target CRS.

    Refuses when PROJ has no path, or places a point outside what the target can show.

    `xy` (N, 2): easting and northing [m], or longitude and latitude [deg]. Returns (N, 2): easting and
    northing, or longitude and latitude, in the target CRS.
    """
    origin = known_crs(source, where)
    try:
        transformer = Transformer.from_crs(origin, target, always_xy=True)
        east, north = transformer.transform(xy[:, 0], xy[:, 1], errcheck=True)
    except (CRSError, ProjError) as error:
        raise InputError(f"{where} does not fit into {target.name} ({error}); name another CRS.") from error
    result: FloatArray = frozen(list(zip(east, north, strict=True)))
    return result.reshape(-1, 2)


def missing_grids(group: TransformerGroup) -> list[str]:
    """Return the names of the grids without which the operations of a group cannot run."""
    names = {
        grid.short_name for way in group.unavailable_operations for grid in way.grids if not grid.available
    }
    return sorted(names)


def lacking_grids(crs: Any = "EPSG:32608") -> dict[str, list[str]]:
    """Return, for every known vertical datum, the grids that PROJ lacks to reach it from the ellipsoid.

    Returns: names of grids by vertical datum; empty lists where nothing lacks.

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
WGS84 = CRS("EPSG:4326")
"""Longitude and latitude in degrees, as GeoJSON, KML, GPX and receivers state them."""


def chosen_crs(longitude_deg: FloatArray, latitude_deg: FloatArray, geographic: Any = WGS84) -> CRS:
    """Return the projected CRS of places in degrees, on their own geodetic datum.

    `longitude_deg`, `latitude_deg` (N,): places, or the corners of what holds them [deg].

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

    >>> geographic_of("EPSG:4326+5773").to_epsg(), geographic_of("EPSG:4979").to_epsg()
    (4326, 4326)
    """
    full = known_crs(crs, "the data")
    horizontal = full.sub_crs_list[0] if full.is_compound else full
    return horizontal.to_2d()


def is_geographic(crs: Any) -> bool:
    """Return whether the horizontal part of a CRS is geographic, its coordinates being degrees.

    >>> is_geographic("EPSG:4326+5773"), is_geographic("EPSG:32608"), is_geographic(None)
    (True, False, False)
    """
    return crs is not None and bool(known_crs(crs, "the data").is_geographic)


def coded_crs(crs: CRS) -> CRS | None:
    """Return the registered CRS that equals `crs`, or ``None``.

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
    if geographic.equals(WGS84, ignore_axis_order=True):
        return model
    projection = model.name.removeprefix("WGS 84 / ")
    name = f"{geographic.name} / {projection}"
    made = ProjectedCRS(model.coordinate_operation, name=name, geodetic_crs=geographic)
    return coded_crs(made) or made
