"""Lengths and areas on the ground of what is drawn in a projected CRS."""

from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core.arrays import FloatArray, lattice_places
from survey.core.map_scale.derivatives import ground_jacobian
from survey.core.map_scale.factors import scale_factors

# Factors of a raster are interpolated between this many nodes along each side; at 1000 km errors stay below 1e-6.
_N_NODES = 65
# A polygon is cut along this many lines each way, and each piece measured with the factor of its centroid.
_N_CUTS = 9


def ground_lengths_m(crs: Any, xy: Any) -> FloatArray:
    """Return the lengths on the ground of the segments between waypoints.

    Parameters
    ----------
    crs : str or pyproj.CRS
        Projected, in metres.
    xy : (N, 2) array_like
        Easting and northing of the waypoints [m].

    Returns
    -------
    (N - 1,) ndarray
        Lengths on the ellipsoid [m]. The scale is taken at the middle of a segment and in its direction:
        segments longer than some 100 km should be divided first.

    Raises
    ------
    InputError
        As `scale_factors` does.

    Examples
    --------
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

    Parameters
    ----------
    crs : str or pyproj.CRS
        Projected, in metres.
    xy : (N, 2) array_like
        Easting and northing of the waypoints [m].

    Returns
    -------
    float
        Sum of `ground_lengths_m` [m].

    Raises
    ------
    InputError
        As `scale_factors` does.

    Examples
    --------
    >>> round(ground_length_m("EPSG:32608", [[500_000.0, 6.7e6], [500_000.0, 6.701e6]]), 1)
    1000.4
    """
    return float(ground_lengths_m(crs, xy).sum())


def areal_factors(crs: Any, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the areal scale factor of every cell of a raster.

    Parameters
    ----------
    crs : str or pyproj.CRS
        Projected, in metres.
    x, y : (W,) and (H,) ndarray
        Easting of the columns and northing of the rows [m].

    Returns
    -------
    (H, W) ndarray
        Grid area over ground area, interpolated linearly between at most 65 × 65 nodes.

    Raises
    ------
    InputError
        As `scale_factors` does.

    Examples
    --------
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

    Parameters
    ----------
    crs : str or pyproj.CRS
        Projected, in metres.
    polygon : shapely.Polygon or shapely.MultiPolygon
        With edges that are straight in the CRS [m].

    Returns
    -------
    float
        Area on the ellipsoid [m²].

    Raises
    ------
    InputError
        As `scale_factors` does.

    Examples
    --------
    >>> round(ground_area_m2("EPSG:3857", shapely.box(0.0, 8_399_238.0, 1000.0, 8_400_238.0)), -3)
    251000.0
    """
    nodes, areas_m2 = _quadrature(polygon)
    return float((areas_m2 / scale_factors(crs, nodes).areal).sum())


def _quadrature(polygon: Polygon | MultiPolygon) -> tuple[FloatArray, FloatArray]:
    """Return the centroids of a polygon's pieces on a lattice of 8 × 8 (M, 2) [m] and their areas (M,) [m²]."""
    xmin, ymin, xmax, ymax = polygon.bounds
    x, y = np.linspace(xmin, xmax, _N_CUTS), np.linspace(ymin, ymax, _N_CUTS)
    west, south = (edges.ravel() for edges in np.meshgrid(x[:-1], y[:-1]))
    east, north = (edges.ravel() for edges in np.meshgrid(x[1:], y[1:]))
    pieces = shapely.intersection(polygon, shapely.box(west, south, east, north))
    pieces = pieces[shapely.area(pieces) > 0.0]
    return shapely.get_coordinates(shapely.centroid(pieces)), shapely.area(pieces)


def _nodes(values: FloatArray) -> FloatArray:
    low, high = float(values.min()), float(values.max())
    return np.linspace(low, high, _N_NODES) if high > low else np.array([low])
