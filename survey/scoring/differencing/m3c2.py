r"""Distance between two point clouds along the local normal (M3C2), with its level of detection.

Lague, D., Brodu, N., Leroux, J. (2013): Accurate 3D comparison of complex topography with terrestrial laser scanner:
Application to the Rangitikei canyon (N-Z). ISPRS Journal of Photogrammetry and Remote Sensing 82, 10-26.

At each core point of the earlier cloud a plane through the points within a sphere of diameter D gives the normal; of several D,
that with the flattest points is taken. A cylinder of diameter d about the normal reaches L to each side, and cuts n points with
the standard deviation (roughness) s along the normal out of each cloud. The distance is the difference of their means, and its
95 % level of detection

.. math:: LoD = t_{0.975,\nu} \sqrt{s_1^2 / n_1 + s_2^2 / n_2} + 1.96 \, r

with the registration error r (1 sigma). The paper takes Student's t below 30 points; here t with Welch's degrees of freedom
is taken throughout, which becomes 1.96 for many points. Errors that neighbouring points of a cloud share do not show in the
roughness; they belong to r.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt
from numba import njit
from pyproj import CRS
from scipy.spatial import cKDTree
from scipy.stats import t as student_t

from survey.core import (
    DataObject,
    FloatArray,
    InputError,
    IntArray,
    check_types,
    same_crs,
    same_vertical_datum,
)
from survey.data.surface_points import SurfacePoints
from survey.scoring.differencing.volume_change import SIGNIFICANT

LEAST_POINTS, LEAST_PLANE = 4, 10
"""Points of each cloud that a distance needs, and points of the earlier one that a normal needs."""
ROUGHNESS_FACTOR = 25.0
"""A sphere of this many roughnesses gives a normal whose error does not matter (Lague et al. 2013, section 4.1)."""
# Points in a cylinder by default, and how often its diameter is doubled in search of the sphere for the normals.
_N_IN_CYLINDER, _N_DOUBLED = 30.0, 5
# Points from which spacing, roughness and depth are found, and neighbours that give the spacing.
_N_SAMPLE, _N_NEAR = 5000, 8
_MOST_COLUMNS = 20_000_000
_CHUNK = 100_000


class M3C2Scales(NamedTuple):
    """Lengths of a comparison [m].

    `normals_m`: diameters D of the spheres. `cylinder_m`: diameter d of the cylinder. `depth_m`: how far it reaches to each
    side of a core point. `spacing_m`: distance between core points.
    """

    normals_m: tuple[float, ...]
    cylinder_m: float
    depth_m: float
    spacing_m: float


@dataclass(frozen=True, eq=False, repr=False)
class CloudDistances(DataObject):
    """Distances between two point clouds at core points.

    Parameters
    ----------
    xyz, normals : (N, 3) ndarray
        Core points [m] and upward unit normals.
    distance_m : (N,) ndarray
        Distance along the normal, positive when the surface rose [m].
    sampling_std_m : (N,) ndarray
        Its standard deviation from roughnesses and numbers of points, without registration [m].
    lod_m : (N,) ndarray
        Level of detection at 95 % [m].
    n_later, n_earlier : (N,) ndarray of int
        Points of each cloud in the cylinder.
    normal_scale_m : (N,) ndarray
        Diameter of the sphere that gave the normal [m].
    scales : M3C2Scales
        Lengths of the comparison.
    registration_m : float
        Registration error, 1 σ [m].
    n_without : int
        Core points without a distance, because a cloud has too few points there.
    crs : pyproj.CRS
        Of the clouds.
    vertical_datum : str
        Of both clouds; empty when neither states it.
    """

    xyz: FloatArray
    normals: FloatArray
    distance_m: FloatArray
    sampling_std_m: FloatArray
    lod_m: FloatArray
    n_later: IntArray
    n_earlier: IntArray
    normal_scale_m: FloatArray
    scales: M3C2Scales
    registration_m: float
    n_without: int
    crs: CRS
    vertical_datum: str = ""

    @property
    def std_m(self) -> FloatArray:
        """Standard deviation of each distance with the registration error [m], (N,)."""
        found: FloatArray = np.hypot(self.sampling_std_m, self.registration_m)
        return found

    @property
    def significant(self) -> npt.NDArray[np.int8]:
        """1 where the surface rose by more than the level of detection (N,), -1 where it sank, 0 elsewhere."""
        beyond = np.abs(self.distance_m) > self.lod_m
        return np.where(beyond, np.sign(self.distance_m), 0.0).astype(np.int8)

    def registered(self, offset_m: float, registration_m: float) -> Self:
        """Return the distances with a vertical offset subtracted and another registration error.

        Parameters
        ----------
        offset_m : float
            Height by which the later cloud lies too high [m].
        registration_m : float
            Registration error that remains, 1 σ [m].

        Returns
        -------
        CloudDistances
            With levels of detection that follow from it.
        """
        lod_m = self.lod_m + SIGNIFICANT * (registration_m - self.registration_m)
        distance_m = self.distance_m - offset_m * self.normals[:, 2]
        return replace(self, distance_m=distance_m, lod_m=lod_m, registration_m=registration_m)

    def _summary(self) -> str:
        return f"{len(self.distance_m)} distances, median {np.median(self.distance_m):.3f} m"


@check_types
def m3c2(
    later: SurfacePoints,
    earlier: SurfacePoints,
    *,
    registration_m: float,
    normals_m: tuple[float, ...] = (),
    cylinder_m: float | None = None,
    depth_m: float | None = None,
    spacing_m: float | None = None,
) -> CloudDistances:
    """Compute the distance between two point clouds along local normals, with its 95 % level of detection.

    Parameters
    ----------
    later, earlier : SurfacePoints
        In one CRS and above one datum. Their standard deviations are not used: the scatter within the cylinders is.
    registration_m : float
        Error of the registration of the clouds, 1 σ [m].
    normals_m : tuple of float
        Diameters of the spheres for the normals [m]. By default the smallest doubling of `cylinder_m` that is 25 times the
        roughness or more, and two and four times that.
    cylinder_m : float, optional
        Diameter of the cylinders [m]; by default such that 30 points of the sparser cloud are expected in it.
    depth_m : float, optional
        How far the cylinders reach to each side [m]; by default two diameters and twice the distance between the clouds' nearest
        points where both have some (99 % of them).
    spacing_m : float, optional
        Distance between core points [m]; by default the diameter of the cylinders.

    Returns
    -------
    CloudDistances
        At the core points where each cloud has 4 points or more.

    Raises
    ------
    InputError
        Mixed systems or datums, a length that is not positive, or clouds that do not overlap.

    Notes
    -----
    Normals point upwards. Of overhanging ground, whose normals point downwards, the distance has the opposite sign.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> ground = rng.uniform(0.0, 20.0, (2, 4000, 2))
    >>> early, late = (np.column_stack([xy, rng.normal(level, 0.02, 4000)]) for xy, level in zip(ground, (0.0, 0.5)))
    >>> early, late = (SurfacePoints(xyz, sigma_m=0.02, crs="EPSG:32608") for xyz in (early, late))
    >>> found = m3c2(late, early, registration_m=0.01)
    >>> bool(abs(np.median(found.distance_m) - 0.5) < 0.01), found.significant.min()
    (True, np.int8(1))
    """
    same_crs(later.crs, earlier.crs, "the two clouds")
    same_vertical_datum(later.vertical_datum, earlier.vertical_datum, "the two clouds")
    _check_lengths(registration_m, (*normals_m, cylinder_m, depth_m, spacing_m))
    middle = earlier.xyz.mean(axis=0)
    new, old = later.xyz - middle, earlier.xyz - middle
    scales = _scales(new, old, M3C2Scales(normals_m, cylinder_m or 0.0, depth_m or 0.0, spacing_m or 0.0))
    places = core_points(earlier.xyz, scales.spacing_m)
    cores = places - middle
    clouds = [_Columns.of(cloud, scales.cylinder_m) for cloud in (new, old)]
    normals, scale_m = _normals(cores, clouds[1], scales.normals_m)
    size = scales.cylinder_m / 2.0, scales.depth_m
    (n_new, mean_new, var_new), (n_old, mean_old, var_old) = (
        _cut_out(cores, normals, cloud, size) for cloud in clouds
    )
    known = (n_new >= LEAST_POINTS) & (n_old >= LEAST_POINTS) & np.isfinite(scale_m)
    if not known.any():
        raise InputError(
            f"the clouds have no place in common where each has {LEAST_POINTS} points within {scales.cylinder_m:.3g} m across and "
            f"{scales.depth_m:.3g} m deep; check that they overlap, or enlarge --cylinder and --depth."
        )
    parts = var_new[known] / n_new[known], var_old[known] / n_old[known]
    std_m, t = _sampling(parts, (n_new[known], n_old[known]))
    return CloudDistances(
        places[known],
        normals[known],
        (mean_new - mean_old)[known],
        std_m,
        t * std_m + SIGNIFICANT * registration_m,
        n_new[known],
        n_old[known],
        scale_m[known],
        scales,
        registration_m,
        int((~known).sum()),
        earlier.crs,
        earlier.vertical_datum or later.vertical_datum,
    )


def _check_lengths(registration_m: float, lengths_m: tuple[float | None, ...]) -> None:
    if not (np.isfinite(registration_m) and registration_m >= 0.0):
        raise InputError(f"the registration error is {registration_m} m; 0 or more was expected.")
    for length in lengths_m:
        if length is not None and not (np.isfinite(length) and length > 0.0):
            raise InputError(f"a length of the comparison is {length} m; a positive one was expected.")


def _sampling(
    variances_m2: tuple[FloatArray, FloatArray], n: tuple[IntArray, IntArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of differences of means [m] and Student's t for 95 %, by the means' variances (N,)."""
    (new, old), (n_new, n_old) = variances_m2, n
    total = np.maximum(new + old, np.finfo(np.float64).tiny)
    shares = (new / total) ** 2 / (n_new - 1) + (old / total) ** 2 / (n_old - 1)
    freedom = 1.0 / np.maximum(shares, 1e-12)
    return np.sqrt(new + old), np.asarray(student_t.ppf(0.975, freedom))


def core_points(xyz: FloatArray, spacing_m: float) -> FloatArray:
    """Return the point nearest to the middle of each cube that holds any, (M, 3), ordered by cubes.

    Parameters
    ----------
    xyz : (N, 3) ndarray
        Points [m].
    spacing_m : float
        Side of the cubes [m]; their corners lie at whole multiples of it.

    Returns
    -------
    (M, 3) ndarray
        Some of the points [m].
    """
    place = xyz / spacing_m
    cube = np.floor(place).astype(np.int64)
    off = ((place - cube - 0.5) ** 2).sum(axis=1)
    order = np.lexsort((off, *cube.T))
    is_first = np.ones(len(xyz), dtype=bool)
    is_first[1:] = (np.diff(cube[order], axis=0) != 0).any(axis=1)
    return xyz[order[is_first]]


def _scales(new: FloatArray, old: FloatArray, given: M3C2Scales) -> M3C2Scales:
    """Return the lengths that were given, and for zeros those that follow from spacing, roughness and distance of the clouds."""
    some_new, some_old = (cloud[:: max(1, len(cloud) // _N_SAMPLE)] for cloud in (new, old))
    cylinder_m = given.cylinder_m
    if not cylinder_m:
        apart_m = max(_spacing_m(new, some_new, "later"), _spacing_m(old, some_old, "earlier"))
        cylinder_m = _rounded(apart_m * np.sqrt(4.0 * _N_IN_CYLINDER / np.pi))
    normals_m = given.normals_m
    if not normals_m:
        smallest_m = _flat_scale_m(some_old, _Columns.of(old, cylinder_m), cylinder_m)
        normals_m = smallest_m, 2.0 * smallest_m, 4.0 * smallest_m
    depth_m = given.depth_m
    if not depth_m:
        beside, _ = cKDTree(new[:, :2]).query(some_old[:, :2], distance_upper_bound=cylinder_m)
        between = np.asarray(cKDTree(new).query(some_old[np.isfinite(beside)])[0])
        far_m = float(np.quantile(between, 0.99)) if between.size else 0.0
        depth_m = _rounded(2.0 * (cylinder_m + far_m))
    return M3C2Scales(tuple(sorted(normals_m)), cylinder_m, depth_m, given.spacing_m or cylinder_m)


def _rounded(length_m: float) -> float:
    """Return a length to two digits [m]."""
    return float(f"{length_m:.1e}")


def _spacing_m(xyz: FloatArray, sample: FloatArray, name: str) -> float:
    """Return the distance between points (N, 3) of the named cloud on a surface [m], by their median density about a sample."""
    if len(xyz) <= _N_NEAR:
        raise InputError(
            f"the {name} cloud has {len(xyz)} points; {_N_NEAR + 1} are needed at least, take a denser one."
        )
    far = np.asarray(cKDTree(xyz).query(sample, _N_NEAR + 1)[0])
    radius_m = float(np.median(far[:, -1]))
    if radius_m == 0.0:
        raise InputError(f"most points of the {name} cloud coincide; write each point once.")
    return radius_m * float(np.sqrt(np.pi / _N_NEAR))


def _flat_scale_m(sample: FloatArray, cloud: "_Columns", smallest_m: float) -> float:
    """Return the smallest doubling of a diameter that is `ROUGHNESS_FACTOR` times the roughness within it [m]; else the largest."""
    scale_m = smallest_m
    for _ in range(_N_DOUBLED):
        moments = _plane_moments(sample, cloud, np.array([scale_m / 2.0]))
        n, covariance = _covariances(moments)
        enough = n[:, 0] >= LEAST_PLANE
        if enough.any():
            least = np.linalg.eigvalsh(covariance[enough, 0])[:, 0]
            roughness_m = float(np.sqrt(max(np.median(least), 0.0)))
            if scale_m >= ROUGHNESS_FACTOR * roughness_m:
                return scale_m
        scale_m *= 2.0
    return scale_m / 2.0


def _normals(
    cores: FloatArray, cloud: "_Columns", diameters_m: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return upward normals (N, 3) by the flattest of the spheres, and its diameter (N,) [m]; NaN with too few points."""
    normals, scale_m = np.zeros_like(cores), np.full(len(cores), np.nan)
    for first in range(0, len(cores), _CHUNK):
        part = slice(first, first + _CHUNK)
        moments = _plane_moments(cores[part], cloud, np.array(diameters_m) / 2.0)
        n, covariance = _covariances(moments)
        values, vectors = np.linalg.eigh(covariance)
        flatness = values[..., 0] / np.maximum(values.sum(axis=-1), np.finfo(np.float64).tiny)
        flatness = np.where(n >= LEAST_PLANE, flatness, np.inf)
        best = np.argmin(flatness, axis=1)
        at = np.arange(len(best)), best
        normal = vectors[(*at, slice(None), 0)]
        normals[part] = np.where(normal[:, 2:] < 0.0, -normal, normal)
        scale_m[part] = np.where(np.isfinite(flatness[at]), np.array(diameters_m)[best], np.nan)
    return normals, scale_m


def _covariances(moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return numbers (N, K) and covariances (N, K, 3, 3) [m²] of points by their moments (N, K, 10)."""
    n = moments[..., 0]
    count = np.maximum(n, 1.0)[..., None]
    mean = moments[..., 1:4] / count
    square = moments[..., 4:][..., [0, 1, 2, 1, 3, 4, 2, 4, 5]] / count
    return n, square.reshape(*n.shape, 3, 3) - mean[..., :, None] * mean[..., None, :]


class _Columns(NamedTuple):
    """Points sorted by the column of ground that they lie in, and by height within it.

    `xyz` (N, 3) [m]. `first` (rows * columns + 1): where each column begins. `west_m`, `south_m`, `side_m`: corner and side of
    the columns. `rows`, `columns`: their numbers.
    """

    xyz: FloatArray
    first: IntArray
    west_m: float
    south_m: float
    side_m: float
    rows: int
    columns: int

    @classmethod
    def of(cls, xyz: FloatArray, side_m: float) -> Self:
        """Sort points (N, 3) [m] into columns of a side [m], or of a larger one where there were too many."""
        corner, extent = xyz[:, :2].min(axis=0), np.ptp(xyz[:, :2], axis=0)
        side_m = max(
            side_m, float(np.sqrt(extent.prod() / _MOST_COLUMNS)), float(extent.max()) / _MOST_COLUMNS
        )
        column, row = np.floor((xyz[:, :2] - corner) / side_m).astype(np.int64).T
        rows, columns = int(row.max()) + 1, int(column.max()) + 1
        cell = row * columns + column
        order = np.lexsort((xyz[:, 2], cell))
        first = np.zeros(rows * columns + 1, dtype=np.int64)
        np.cumsum(np.bincount(cell, minlength=rows * columns), out=first[1:])
        west, south = corner.tolist()
        return cls(np.ascontiguousarray(xyz[order]), first, west, south, side_m, rows, columns)


@njit(cache=True)
def _between(low: float, high: float, corner: float, side: float, n: int) -> tuple[int, int]:
    """Return the first cell between two places on an axis and that behind the last."""
    return max(0, int(np.floor((low - corner) / side))), min(n, int(np.floor((high - corner) / side)) + 1)


@njit(cache=True)
def _first_above(xyz: FloatArray, start: int, stop: int, height: float) -> int:
    """Return the first of points sorted by height, from `start` to `stop`, that is not below a height."""
    while start < stop:
        middle = (start + stop) // 2
        if xyz[middle, 2] < height:
            start = middle + 1
        else:
            stop = middle
    return start


@njit(cache=True)
def _plane_moments(
    cores: FloatArray,
    cloud: _Columns,
    radii: FloatArray,
) -> FloatArray:
    """Return number, sums and sums of products (N, K, 10) of the points within each radius [m], relative to the core points."""
    xyz, first, west, south, side, rows, columns = cloud
    moments = np.zeros((len(cores), len(radii), 10))
    reach = radii.max()
    for i in range(len(cores)):
        x, y, z = cores[i]
        row_0, row_1 = _between(y - reach, y + reach, south, side, rows)
        column_0, column_1 = _between(x - reach, x + reach, west, side, columns)
        for row in range(row_0, row_1):
            for column in range(column_0, column_1):
                cell = row * columns + column
                stop = first[cell + 1]
                for j in range(_first_above(xyz, first[cell], stop, z - reach), stop):
                    dz = xyz[j, 2] - z
                    if dz > reach:
                        break
                    dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                    square = dx * dx + dy * dy + dz * dz
                    for k in range(len(radii)):
                        if square <= radii[k] * radii[k]:
                            found = moments[i, k]
                            found[0] += 1.0
                            found[1] += dx
                            found[2] += dy
                            found[3] += dz
                            found[4] += dx * dx
                            found[5] += dx * dy
                            found[6] += dx * dz
                            found[7] += dy * dy
                            found[8] += dy * dz
                            found[9] += dz * dz
    return moments


@njit(cache=True)
def _cut_out(
    cores: FloatArray,
    normals: FloatArray,
    cloud: _Columns,
    size: tuple[float, float],
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return number, mean [m] and variance [m²] along the normals (N,) of the points within the cylinders.

    `size`: radius of the cylinders, and how far they reach to each side [m].
    """
    xyz, first, west, south, side, rows, columns = cloud
    radius, depth = size
    n = np.zeros(len(cores), dtype=np.int64)
    mean, variance = np.zeros(len(cores)), np.zeros(len(cores))
    for i in range(len(cores)):
        x, y, z = cores[i]
        a, b, c = normals[i]
        reach_x = depth * abs(a) + radius * np.sqrt(max(1.0 - a * a, 0.0))
        reach_y = depth * abs(b) + radius * np.sqrt(max(1.0 - b * b, 0.0))
        reach_z = depth * abs(c) + radius * np.sqrt(max(1.0 - c * c, 0.0))
        row_0, row_1 = _between(y - reach_y, y + reach_y, south, side, rows)
        column_0, column_1 = _between(x - reach_x, x + reach_x, west, side, columns)
        squares = 0.0
        for row in range(row_0, row_1):
            for column in range(column_0, column_1):
                cell = row * columns + column
                stop = first[cell + 1]
                for j in range(_first_above(xyz, first[cell], stop, z - reach_z), stop):
                    dz = xyz[j, 2] - z
                    if dz > reach_z:
                        break
                    dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                    along = a * dx + b * dy + c * dz
                    across = dx * dx + dy * dy + dz * dz - along * along
                    if abs(along) <= depth and across <= radius * radius:
                        n[i] += 1
                        off = along - mean[i]
                        mean[i] += off / n[i]
                        squares += off * (along - mean[i])
        if n[i] > 1:
            variance[i] = squares / (n[i] - 1)
    return n, mean, variance
