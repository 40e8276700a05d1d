"""Linear interpolation in Delaunay triangles (tin): the baseline of the glacier paper (II.E)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt
from pyproj import CRS
from scipy.spatial import Delaunay, cKDTree

from survey.core import UNSTATED, FloatArray, InputError, same_crs
from survey.data import Dem, Grid, SurfacePoints
from survey.io.arrays_file import read_arrays, write_arrays
from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod
from survey.reconstruction.observations import Observations
from survey.reconstruction.terrain_map import ELEVATION, INTERPOLATED, MEASURED, UNSEEN, Reconstruction
from survey.reconstruction.terrain_model import Capabilities, TerrainModel, local_datum_m, not_fitted

_FORMAT = "firnline triangulated terrain 1"
_NEAR_M = 1.0
# Places at once, which bounds the memory of their weights.
_AT_ONCE = 500_000
# Points whose width is a smaller share of their length lie on one line.
_NARROWEST = 1e-3
_NOTE = (
    "the standard deviation carries the points' own errors through the linear interpolation; what the surface "
    "does between the points is not in it"
)


def triangulate(points: SurfacePoints, grid: Grid, *, quantity: str = ELEVATION) -> Reconstruction:
    r"""Map the points by linear interpolation within their Delaunay triangles.

    .. math::  z = \sum_{k=1}^3 b_k z_k, \qquad \sigma^2 = \sum_{k=1}^3 b_k^2 \sigma_k^2

    with the barycentric coordinates b of the node.

    Returns: NaN outside the points' convex hull.

    The standard deviation is that of the points' errors alone: between the points the
    surface may do what it likes, so it is too small there.

    >>> corners = SurfacePoints([[0, 0, 0], [4, 0, 4], [0, 4, 0]], sigma_m=0.1, crs="EPSG:32608")
    >>> result = triangulate(corners, Grid((0.0, 0.0, 2.0, 2.0), 1.0))
    >>> result.mean.elevation[2]
    array([0., 1., 2.])
    """
    return TriangulatedTerrain(quantity).fit(points).grid(grid)


@dataclass(eq=False)
class TriangulatedTerrain(TerrainModel):
    """Linear interpolation in Delaunay triangles, as a terrain model; silent beyond the points' hull.

    `quantity`: a sampled quantity to map instead of the elevation.

    An update triangulates all points again. A place is measured when a point lies within
    half the diagonal of the grid's cell, or a metre when no grid is given.

    >>> corners = SurfacePoints([[0, 0, 0], [4, 0, 4], [0, 4, 0]], sigma_m=0.1, crs="EPSG:32608")
    >>> TriangulatedTerrain().fit(corners).predict([[1.0, 1.0], [9.0, 9.0]])
    array([ 1., nan])
    """

    capabilities: ClassVar = Capabilities(samples=False, online=False)

    quantity: str = ELEVATION
    crs_: CRS | None = field(default=None, init=False, repr=False)
    vertical_datum_: str = field(default=UNSTATED, init=False, repr=False)
    _surface: "Triangles | None" = field(default=None, init=False, repr=False)

    def fit(self, points: SurfacePoints) -> Self:
        """Triangulate points; refuse fewer than three places or ones on one line."""
        self.crs_, self.vertical_datum_ = points.crs, points.vertical_datum
        self._surface = Triangles.of(Observations.of(points, self.quantity).merged())
        return self

    def update(self, points: SurfacePoints) -> Self:
        """Add points, and triangulate all again."""
        if self._surface is None or self.crs_ is None:
            return self.fit(points)
        same_crs(self.crs_, points.crs, "the map and the points")
        old, new = self._surface.data, Observations.of(points, self.quantity)
        columns = (np.concatenate(pair) for pair in zip(_columns(old), _columns(new), strict=True))
        self._surface = Triangles.of(Observations(*columns).merged())
        return self

    def grid(self, grid: Grid) -> Reconstruction:
        """Return the map on the nodes of a grid, NaN beyond the hull; refuse a grid that lies outside it."""
        surface = self._known
        mean, std = surface.at(grid.xy)
        if not np.isfinite(mean).any():
            raise InputError(
                "no node of the grid lies between the points; check that both are in the same place and CRS."
            )
        near = surface.distance_m(grid.xy) <= grid.step_m / np.sqrt(2.0)
        support = np.where(np.isfinite(mean), np.where(near, MEASURED, INTERPOLATED), UNSEEN)
        return Reconstruction(
            Dem.on(grid, mean.reshape(grid.shape), self.vertical_datum_),
            Dem.on(grid, std.reshape(grid.shape), self.vertical_datum_),
            support.reshape(grid.shape),
            "tin",
            {"n_points": len(surface.data)},
            quantity=self.quantity,
            diagnostics={"standard_deviation": _NOTE},
        )

    def sample(self, grid: Grid, n: int, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Refuse: triangles state no distribution of what lies between the points."""
        raise InputError("a TriangulatedTerrain has no distribution to draw from; take a Gaussian process.")

    def save(self, path: str | Path) -> None:
        """Write the model to one ``.npz`` file."""
        data = self._known.data
        crs = self.crs_.to_wkt() if self.crs_ is not None else ""
        facts = {"quantity": self.quantity, "crs": crs, "datum": self.vertical_datum_}
        write_arrays(path, _FORMAT, facts, {"xy": data.xy, "z": data.z, "variance": data.variance})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote."""
        facts, arrays = read_arrays(path, _FORMAT)
        model = cls(facts["quantity"])
        model.crs_, model.vertical_datum_ = CRS.from_wkt(facts["crs"]), facts["datum"]
        model._surface = Triangles.of(Observations(arrays["xy"], arrays["z"], arrays["variance"]))
        return model

    @property
    def _known(self) -> "Triangles":
        if self._surface is None:
            raise not_fitted()
        return self._surface

    def _height(self, xy: FloatArray) -> FloatArray:
        return self._known.at(xy)[0]

    def _std(self, xy: FloatArray) -> FloatArray:
        return self._known.at(xy)[1]

    def _support(self, xy: FloatArray) -> npt.NDArray[np.uint8]:
        surface = self._known
        inside = np.isfinite(surface.at(xy)[0])
        near = np.where(surface.distance_m(xy) <= _NEAR_M, MEASURED, INTERPOLATED)
        return np.where(inside, near, UNSEEN).astype(np.uint8)


@dataclass(frozen=True)
class Triangles:
    """Points about a local datum, and their Delaunay triangles."""

    data: Observations
    centre: FloatArray
    datum: float
    mesh: Delaunay

    @classmethod
    def of(cls, data: Observations) -> "Triangles":
        """Triangulate observations of different places."""
        # About their centre: Qhull loses digits to large coordinates.
        centre = data.xy.mean(axis=0)
        return cls(data, centre, local_datum_m(data.z), _mesh(data.xy - centre))

    def at(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return value and standard deviation (N,) at places; NaN outside the hull."""
        parts = [self._at(xy[k : k + _AT_ONCE]) for k in range(0, len(xy), _AT_ONCE)]
        mean, std = zip(*parts, strict=True) if parts else ([xy[:, 0]], [xy[:, 0]])
        return np.concatenate(mean), np.concatenate(std)

    def _at(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return value and standard deviation (N,) at few places."""
        places = xy - self.centre
        triangle = self.mesh.find_simplex(places)
        inside = triangle >= 0
        to_barycentric = self.mesh.transform[triangle[inside]]
        two = np.einsum("nij,nj->ni", to_barycentric[:, :2], places[inside] - to_barycentric[:, 2])
        weight = np.column_stack([two, 1.0 - two.sum(axis=1)])
        corner = self.mesh.simplices[triangle[inside]]
        mean, std = np.full(len(xy), np.nan), np.full(len(xy), np.nan)
        mean[inside] = (weight * (self.data.z[corner] - self.datum)).sum(axis=1) + self.datum
        std[inside] = np.sqrt((weight**2 * self.data.variance[corner]).sum(axis=1))
        return mean, std

    def distance_m(self, xy: FloatArray) -> FloatArray:
        """Return the distance (N,) to the nearest point [m]."""
        return np.asarray(cKDTree(self.data.xy).query(xy)[0], dtype=np.float64)


def _mesh(xy: FloatArray) -> Delaunay:
    if len(xy) < 3:
        raise InputError(f"the points lie in {len(xy)} places; a triangulation needs at least 3.")
    along, across = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    if across <= _NARROWEST * along:
        raise InputError(f"the {len(xy)} points lie on one line; a triangulation needs some beside it.")
    return Delaunay(xy)


def _columns(data: Observations) -> tuple[FloatArray, FloatArray, FloatArray]:
    return data.xy, data.z, data.variance


def _run(task: MappingTask) -> MappedTerrain:
    return MappedTerrain(triangulate(task.points, task.grid, quantity=task.quantity))


TIN = ReconstructionMethod(
    "tin", "linear interpolation in Delaunay triangles", _run, uses_prior=False, maps_values=True
)
