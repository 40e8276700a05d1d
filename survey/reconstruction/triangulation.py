"""Linear interpolation in Delaunay triangles: the baseline of the glacier paper (II.E)."""

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from survey.arrays import FloatArray
from survey.dem import Dem
from survey.errors import InputError
from survey.grid import Grid
from survey.reconstruction.base import ELEVATION, INTERPOLATED, MEASURED, UNSEEN, Reconstruction
from survey.reconstruction.observations import Observations
from survey.surface_points import SurfacePoints

_NOTE = (
    "the standard deviation carries the points' own errors through the linear interpolation; what the surface "
    "does between the points is not in it"
)


def triangulate(points: SurfacePoints, grid: Grid, *, quantity: str = ELEVATION) -> Reconstruction:
    r"""Map the points by linear interpolation within their Delaunay triangles.

    .. math::  z = \sum_{k=1}^3 b_k z_k, \qquad \sigma^2 = \sum_{k=1}^3 b_k^2 \sigma_k^2

    with the barycentric coordinates b of the node.

    Parameters
    ----------
    points : SurfacePoints
        At least three that do not lie on one line; several at one place are first
        averaged by their weights 1/σ².
    grid : Grid
        Where to map.
    quantity : str
        A sampled quantity to map instead of the elevation.

    Returns
    -------
    Reconstruction
        NaN outside the points' convex hull.

    Raises
    ------
    InputError
        Fewer than three places, all on one line, or no node of the grid within them.

    Notes
    -----
    The standard deviation is that of the points' errors alone: between the points the
    surface may do what it likes, so it is too small there.

    Examples
    --------
    >>> corners = SurfacePoints([[0, 0, 0], [4, 0, 4], [0, 4, 0]], sigma_m=0.1, crs="EPSG:32608")
    >>> result = triangulate(corners, Grid((0.0, 0.0, 2.0, 2.0), 1.0))
    >>> result.mean.elevation[2]
    array([0., 1., 2.])
    """
    data = Observations.of(points, quantity).merged()
    # About their centre: Qhull loses digits to large coordinates.
    centre = data.xy.mean(axis=0)
    xy, nodes = data.xy - centre, grid.xy - centre
    mesh = _mesh(xy)
    triangle = mesh.find_simplex(nodes)
    inside = triangle >= 0
    if not inside.any():
        raise InputError(
            "no node of the grid lies between the points; check that both are in the same place and CRS."
        )
    to_barycentric = mesh.transform[triangle[inside]]
    two = np.einsum("nij,nj->ni", to_barycentric[:, :2], nodes[inside] - to_barycentric[:, 2])
    weight = np.column_stack([two, 1.0 - two.sum(axis=1)])
    corner = mesh.simplices[triangle[inside]]
    mean, std = np.full(len(nodes), np.nan), np.full(len(nodes), np.nan)
    mean[inside] = (weight * data.z[corner]).sum(axis=1)
    std[inside] = np.sqrt((weight**2 * data.variance[corner]).sum(axis=1))
    near = cKDTree(xy).query(nodes)[0] <= grid.step_m / np.sqrt(2.0)
    support = np.where(inside, np.where(near, MEASURED, INTERPOLATED), UNSEEN)
    return Reconstruction(
        _on(grid, mean, points),
        _on(grid, std, points),
        support.reshape(grid.shape),
        "tin",
        {"n_points": len(xy)},
        quantity=quantity,
        diagnostics={"standard_deviation": _NOTE},
    )


def _mesh(xy: FloatArray) -> Delaunay:
    if len(xy) < 3:
        raise InputError(f"the points lie in {len(xy)} places; a triangulation needs at least 3.")
    try:
        return Delaunay(xy)
    except QhullError as error:
        raise InputError(
            f"the {len(xy)} points lie on one line; a triangulation needs some beside it."
        ) from error


def _on(grid: Grid, values: FloatArray, points: SurfacePoints) -> Dem:
    return Dem.on(grid, values.reshape(grid.shape), points.vertical_datum)
