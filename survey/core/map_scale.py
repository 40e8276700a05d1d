"""Local scale factors of a map projection, and lengths and areas on the ground.

Coordinates, steps and geometry stay in the metres of the survey's CRS (grid metres). What is reported as a length, area
or volume counts on the ground: lengths are divided by the linear scale factor, areas by the areal one. The factors come
from the Jacobian of the projection; lengths and areas are integrated by quadrature. The ground is the ellipsoid of the
CRS's datum; the height above it changes a length by 0.016 % per kilometre and is left out.

`pyproj.Proj.get_factors` is not used: it has no factor for the direction of a segment, and for EPSG:3857 it measures on the
sphere of the projection's formula and not on the ellipsoid (`scale_factors`).
"""

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
import shapely
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError
from shapely import MultiPolygon, Polygon

from survey.core.arrays import Bounds, FloatArray, lattice_places
from survey.core.crs import projected_crs
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


@lru_cache(maxsize=16)
def _ellipsoid(geodetic: CRS) -> tuple[float, float]:
    geod = geodetic.get_geod()
    if geod is None:
        raise InputError(f"{geodetic.name} states no ellipsoid; assign a CRS that does.")
    return float(geod.a), float(geod.f)


@lru_cache(maxsize=16)
def _to_degrees(crs: CRS, geodetic: CRS) -> Transformer:
    """Return the inverse of a projection; PROJ takes milliseconds to find it, and steered paths ask for each step."""
    return Transformer.from_crs(crs, geodetic.to_2d(), always_xy=True)


def _inverse(crs: CRS, geodetic: CRS, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return longitude and latitude (N,) [rad]."""
    try:
        lon, lat = _to_degrees(crs, geodetic).transform(xy[:, 0], xy[:, 1])
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


NOTABLE = 0.01
"""A linear scale factor farther than this from 1 is warned of."""
_N_SUMMARY = 9


class ScaleFactors(NamedTuple):
    """Scale factors at N places: grid metres for each metre on the ground.

    `meridional`, `parallel` (N,): along the meridian and along the parallel. `areal` (N,): grid area over
    ground area. `least`, `largest` (N,): over all directions: the half axes of Tissot's ellipse. Equal for a
    conformal projection.
    """

    meridional: FloatArray
    parallel: FloatArray
    areal: FloatArray
    least: FloatArray
    largest: FloatArray

    @property
    def linear(self) -> FloatArray:
        """Square root of the areal factor: the linear factor of a conformal projection, a mean of any other, (N,)."""
        return np.sqrt(self.areal)


def scale_factors(crs: Any, xy: Any) -> ScaleFactors:
    """Return the projection's local scale factors at places.

    The inverse projection is differentiated numerically and measured on the ellipsoid of the datum. For
    EPSG:3857 this differs from `pyproj.Proj.get_factors`, which measures on the sphere that the projection's
    formula uses, by up to 0.7 % in the areal factor.

    `xy` (N, 2): easting and northing [m], in this order whatever the axis order of the CRS.

    >>> scale_factors("EPSG:32608", [[500_000.0, 6_700_000.0]]).meridional.round(4)
    array([0.9996])
    """
    jacobian = ground_jacobian(crs, xy)
    grid_per_ground = np.linalg.inv(jacobian)
    half_axes = np.asarray(np.linalg.svd(grid_per_ground, compute_uv=False), dtype=np.float64)
    east, north = np.linalg.norm(grid_per_ground, axis=1).T
    largest, least = half_axes.T
    return ScaleFactors(north, east, largest * least, least, largest)


@dataclass(frozen=True)
class ScaleRange:
    """Least, mean and largest value of a scale factor over some ground.

    `min`, `mean`, `max`: least, mean and largest factor.
    """

    min: float
    mean: float
    max: float

    @classmethod
    def of(cls, least: FloatArray, middle: FloatArray, largest: FloatArray) -> Self:
        """Summarise factors at places (N,).

        `least`, `middle`, `largest` (N,): factors at places: the least over all directions, the mean and the
        largest.
        """
        return cls(float(least.min()), float(middle.mean()), float(largest.max()))


@dataclass(frozen=True)
class MapScale:
    """Scale factors of a projection over a survey: grid metres for each metre on the ground.

    `crs_name`: name of the CRS. `linear`, `areal`: of lengths and of areas. Where the projection is not
    conformal, the ends of `linear` are those over all directions.

    >>> scale = MapScale.over("EPSG:32608", (499_000.0, 6_700_000.0, 501_000.0, 6_701_000.0))
    >>> round(scale.linear.mean, 4), round(scale.areal.mean, 4), scale.warning
    (0.9996, 0.9992, '')
    """

    crs_name: str
    linear: ScaleRange
    areal: ScaleRange

    @classmethod
    def at(cls, crs: Any, xy: Any) -> Self:
        """Summarise the scale factors at places.

        `xy` (N, 2): easting and northing [m], N of at least 1.
        """
        found = scale_factors(crs, xy)
        name = projected_crs(crs, "the map").name
        linear = ScaleRange.of(found.least, found.linear, found.largest)
        return cls(name, linear, ScaleRange.of(*(found.areal,) * 3))

    @classmethod
    def over(cls, crs: Any, bounds: Bounds) -> Self:
        """Summarise the scale factors over a rectangle.

        `bounds` (4,): ``(xmin, ymin, xmax, ymax)`` [m].
        """
        xmin, ymin, xmax, ymax = bounds
        x, y = np.linspace(xmin, xmax, _N_SUMMARY), np.linspace(ymin, ymax, _N_SUMMARY)
        return cls.at(crs, lattice_places(x, y))

    @property
    def notable_factor(self) -> float:
        """Mean linear factor; 1 where it is within 1 % of 1, as in UTM zones and most national grids."""
        return 1.0 if abs(self.linear.mean - 1.0) <= NOTABLE else self.linear.mean

    @property
    def warning(self) -> str:
        """One sentence where a length differs by more than 1 % from that on the ground, else ``""``."""
        farthest = max((self.linear.min, self.linear.max), key=lambda k: abs(k - 1.0))
        if abs(farthest - 1.0) <= NOTABLE:
            return ""
        return (
            f"lengths in {self.crs_name} are {farthest:.3f} times those on the ground; lengths, areas and volumes "
            "are given on the ground, while steps and coordinates stay in the CRS (a UTM zone differs by less than 0.1 %)"
        )

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Return the factors as plain values for JSON.

        Returns: ``linear`` and ``areal``, each with ``min``, ``mean`` and ``max``.

        >>> sorted(MapScale.at("EPSG:3413", [[0.0, -2e6]]).to_dict())
        ['areal', 'linear']
        """
        return {"linear": asdict(self.linear), "areal": asdict(self.areal)}


# Factors of a raster are interpolated between this many nodes along each side; at 1000 km errors stay below 1e-6.
_N_NODES = 65
# A polygon is cut along this many lines each way, and each piece measured with the factor of its centroid.
_N_CUTS = 9


def ground_lengths_m(crs: Any, xy: Any) -> FloatArray:
    """Return the lengths on the ground of the segments between waypoints.

    `xy` (N, 2): easting and northing of the waypoints [m]. Returns (N - 1,): lengths on the ellipsoid [m].
    The scale is taken at the middle of a segment and in its direction: segments longer than some 100 km
    should be divided first.

    >>> ground_lengths_m("EPSG:3857", [[0.0, 8_399_737.89], [0.0, 8_400_737.89]]).round(1)
    array([500.4])
    """
    places = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    if len(places) < 2:
        return np.zeros(0)
    jacobian = ground_jacobian(crs, 0.5 * (places[1:] + places[:-1]))
    moved = np.einsum("nij,nj->ni", jacobian, np.diff(places, axis=0))
    lengths: FloatArray = np.hypot(*moved.T)
    return lengths


def ground_length_m(crs: Any, xy: Any) -> float:
    """Return the length on the ground of the line through waypoints.

    `xy` (N, 2): easting and northing of the waypoints [m]. Returns: sum of `ground_lengths_m` [m].

    >>> round(ground_length_m("EPSG:32608", [[500_000.0, 6.7e6], [500_000.0, 6.701e6]]), 1)
    1000.4
    """
    return float(ground_lengths_m(crs, xy).sum())


def areal_factors(crs: Any, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the areal scale factor of every cell of a raster.

    `x`, `y` (W,) and (H,): easting of the columns and northing of the rows [m]. Returns (H, W): grid area
    over ground area, interpolated linearly between at most 65 × 65 nodes.

    >>> areal_factors("EPSG:3857", np.array([0.0, 1.0]), np.array([8_399_738.0])).round(2)
    array([[3.99, 3.99]])
    """
    nodes_x, nodes_y = _nodes(x), _nodes(y)
    places = lattice_places(nodes_x, nodes_y)
    coarse = scale_factors(crs, places).areal.reshape(len(nodes_y), len(nodes_x))
    rows = np.stack([np.interp(x, nodes_x, row) for row in coarse])
    return np.stack([np.interp(y, nodes_y, column) for column in rows.T], axis=1)


def ground_area_m2(crs: Any, polygon: Polygon | MultiPolygon) -> float:
    """Return the area of a polygon on the ground.

    `polygon`: with edges that are straight in the CRS [m]. Returns: area on the ellipsoid [m²].

    >>> round(ground_area_m2("EPSG:3857", shapely.box(0.0, 8_399_238.0, 1000.0, 8_400_238.0)), -3)
    251000.0
    """
    nodes, areas_m2 = _quadrature(polygon)
    return float((areas_m2 / scale_factors(crs, nodes).areal).sum())


def _quadrature(polygon: Polygon | MultiPolygon) -> tuple[FloatArray, FloatArray]:
    """Return the centroids of a polygon's pieces on a lattice of 8 × 8 (M, 2) [m] and their areas (M,) [m²]."""
    xmin, ymin, xmax, ymax = polygon.bounds
    x, y = np.linspace(xmin, xmax, _N_CUTS), np.linspace(ymin, ymax, _N_CUTS)
    # First strips, then their pieces: so a long outline is cut eight times and not sixty-four times.
    strips = shapely.intersection(polygon, shapely.box(x[:-1], ymin, x[1:], ymax))
    pieces = shapely.intersection(strips, shapely.box(xmin, y[:-1], xmax, y[1:])[:, None]).ravel()
    pieces = pieces[shapely.area(pieces) > 0.0]
    return shapely.get_coordinates(shapely.centroid(pieces)), shapely.area(pieces)


def _nodes(values: FloatArray) -> FloatArray:
    low, high = float(values.min()), float(values.max())
    return np.linspace(low, high, _N_NODES) if high > low else np.array([low])
