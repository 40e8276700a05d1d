"""Lattice whose nodes are free in x, y and z: overhangs, serac edges and undercut walls, with standard deviations.

The EMap paper (Lock, Camara and Fox, section 7) leaves nodes that move in x and y to further work. `free_lattice` extracts a first mesh
(`survey.reconstruction.lattice.surface_net`) and moves its nodes to the points (`survey.reconstruction.lattice.free_nodes`).
The standard deviation along the normal has three parts: the posterior of the linearised problem, scaled by points that are left out
in blocks, one by one, and with their scans; the roughness about a node: the scatter of its points that noise does not explain and that scans share; and errors that all
points of a scan share, from where scans overlap.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import diags_array

from survey.core import BoolArray, FloatArray, InputError, IntArray, stream
from survey.data import SurfacePoints
from survey.reconstruction.lattice.calibration import left_out_blocks
from survey.reconstruction.lattice.free_nodes import (
    N_DRAWS_ROUGH,
    FreeNodes,
    LinearDistances,
    NodeMoves,
    RayPoints,
)
from survey.reconstruction.lattice.free_surface import FreeSurface
from survey.reconstruction.lattice.surface_net import cell_numbers, surface_net
from survey.reconstruction.terrain_map import SIGMAS_95

_N_STEPS, _CELL_IN_STEPS, _N_DRAWS = 4, 0.4, 64
# Points with a smaller weight of Huber do not support a node.
_LEAST_TRUST = 0.3
# The roughness about a node is that of all points, unless more points than these differ.
_PRIOR_POINTS = 6.0
_N_FOLDS, _BLOCK_SHARE, _SINGLE_SHARE, _BLOCK_IN_STEPS = 2, 0.15, 0.05, 4.0
_PAIRS_IN_STEPS = 0.25
# With fewer predictions nothing is calibrated; with fewer points of a scan about a node their mean is too noisy.
_N_LEAST, _LEAST_OF_SCAN = 40, 3.0
# A scanner that moves has more places; its points count as one scan.
_MOST_SCANS = 64


def beam_covariance(
    xyz: npt.ArrayLike, origins: npt.ArrayLike, range_sigma_m: float, beam_sigma_deg: float
) -> FloatArray:
    """Return the covariance of each point of a scan (P, 3, 3) [m²] from the errors along and across its ray.

    Parameters
    ----------
    xyz, origins : (P, 3) array_like
        Points and places of the scanner [m].
    range_sigma_m : float
        Standard deviation of a range [m].
    beam_sigma_deg : float
        Standard deviation of the direction within the beam [deg]; about a quarter of the width of a beam.

    Returns
    -------
    (P, 3, 3) ndarray
        Covariances [m²], as `survey.SurfacePoints` has them.

    Examples
    --------
    >>> beam_covariance([[10.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], 0.02, 0.1)[0].diagonal().round(5)
    array([0.0004, 0.0003, 0.0003])
    """
    ray = np.asarray(xyz, dtype=np.float64) - np.asarray(origins, dtype=np.float64)
    range_m = np.linalg.norm(ray, axis=1)
    unit = ray / range_m[:, None]
    across = range_m * np.radians(beam_sigma_deg)
    along = unit[:, :, None] * unit[:, None, :]
    covariance: FloatArray = range_sigma_m**2 * along + (across**2)[:, None, None] * (np.eye(3) - along)
    return covariance


def free_lattice(points: SurfacePoints, step_m: float = 0.25, reach_m: float | None = None) -> FreeSurface:
    """Estimate a surface that may overhang on nodes that are free in x, y and z.

    Parameters
    ----------
    points : SurfacePoints
        Points with their covariances and with the places of the scanner (`SurfacePoints.origins`); see `beam_covariance`. Where
        they carry an `own_covariance`, the rest of their covariance is of errors that all points of a scan share, as of its pose.
    step_m : float
        Distance between the nodes [m].
    reach_m : float, optional
        Greatest distance of a node from points [m], so that gaps twice as wide are closed; six steps when left out.

    Returns
    -------
    FreeSurface
        Nodes, triangles and standard deviations.

    Raises
    ------
    InputError
        Points without origins or at them, too few points, or steps that are too small for their extent.

    Notes
    -----
    Sharp edges are rounded over about one step; the roughness holds the error. Walls thinner than two steps may be merged, and
    small pieces, such as twigs, are left out. Errors that all points of a scan share are estimated where scans overlap, with one scan
    they are those that the points state. Where nothing was seen within `reach_m` there is no surface.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> y, t = rng.uniform(0.0, 4.0, 6000), rng.uniform(0.0, 6.0, 6000)
    >>> x, z = np.where(t < 3.0, -t, 3.6 - 1.2 * t), np.where(t < 3.0, 0.0, t - 3.0)  # ground below a face that overhangs
    >>> xyz = np.column_stack([x, y, z]) + 0.01 * rng.standard_normal((6000, 3))
    >>> points = SurfacePoints(xyz, sigma_m=0.01, origins=np.full((6000, 3), [-6.0, 2.0, 1.5]), crs="EPSG:32608")
    >>> surface = free_lattice(points)
    >>> bool(abs(surface.distances([[-1.8, 2.0, 1.5]]).distance_m[0]) < 0.03)
    True
    """
    if points.origins is None:
        raise InputError(
            "the points do not state where the scanner stood; add the columns origin_x_m, origin_y_m and origin_z_m."
        )
    if not step_m > 0.0:
        raise InputError(f"nodes {step_m:g} m apart are impossible; give a step above 0.")
    datum = np.floor(points.xyz.min(axis=0))
    xyz, origins = points.xyz - datum, points.origins - datum
    rays = xyz - origins
    range_m = np.linalg.norm(rays, axis=1)
    if (range_m == 0.0).any():
        raise InputError(
            f"{int((range_m == 0.0).sum())} points lie where the scanner stood; leave them out or correct the origins."
        )
    rays = rays / range_m[:, None]
    nodes, triangles = surface_net(xyz, origins, step_m, 6.0 * step_m if reach_m is None else reach_m)
    covariance = (
        points.covariance if points.covariance is not None else (points.sigma_z**2)[:, None, None] * np.eye(3)
    )
    own = covariance if points.own_covariance is None else points.own_covariance
    data = RayPoints(xyz, rays, own, covariance - own, _scans(origins))
    lattice, thinned = FreeNodes(nodes, triangles, step_m), data.one_per_cell(_CELL_IN_STEPS * step_m)
    for _ in range(_N_STEPS):
        lattice.step(thinned)
    return _surface(lattice, data, datum)


def _scans(origins: FloatArray) -> IntArray:
    """Return the number of each point's scan (P,), by the place of the scanner."""
    places, scan = np.unique(origins, axis=0, return_inverse=True)
    return scan.ravel() if len(places) <= _MOST_SCANS else np.zeros(len(origins), dtype=np.int64)


class _Factors(NamedTuple):
    """Factors on the posterior's standard deviation in gaps and near points."""

    gaps: float
    near: float


def _surface(lattice: FreeNodes, data: RayPoints, datum: FloatArray) -> FreeSurface:
    """Solve once more with all points, and return nodes, standard deviations and support, in the frame of the datum (3,) [m]."""
    linear = lattice.linearised(data)
    posterior = lattice.solved(linear, lattice.weights(linear), _N_DRAWS)
    rough_m2 = _roughness(lattice, linear, posterior)
    of_surface = _share_of_surface(lattice, data, linear, posterior)
    factors = _calibrated(lattice, data, linear, rough_m2)
    shared_m2 = _shared_by_scans(data, linear, posterior)
    supported = _supported(linear, linear.trust > _LEAST_TRUST)
    factor = np.where(supported, factors.near, factors.gaps)
    variance = (
        factor**2 * (posterior.draws**2).mean(axis=1) + factors.near**2 * of_surface * rough_m2 + shared_m2
    )
    normals = lattice.normals()
    nodes = lattice.nodes + posterior.mean[:, None] * normals + datum
    scales = lattice.step_m, lattice.bending_m, lattice.roughness_m, (factors.near, factors.gaps)
    return FreeSurface(nodes, lattice.triangles, normals, np.sqrt(variance), supported, *scales)


def _supported(linear: LinearDistances, is_used: BoolArray) -> BoolArray:
    """Return which nodes (N,) have points on a facet."""
    supported: BoolArray = linear.shares.T @ is_used.astype(np.float64) > 0.0
    return supported


def _roughness(lattice: FreeNodes, linear: LinearDistances, posterior: NodeMoves) -> FloatArray:
    """Return the variance about each node (N,) that the noise of the points does not explain [m²]."""
    left = linear.residual - linear.rows @ posterior.mean
    share = linear.shares.T @ diags_array(linear.trust)
    excess = share @ (left**2 - linear.noise_m2) + _PRIOR_POINTS * lattice.roughness_m**2
    count = share.sum(axis=1) + _PRIOR_POINTS
    near = lattice.mean_of_neighbours
    smooth: FloatArray = (excess + near @ excess) / (count + near @ count)
    return np.maximum(smooth, 0.0)


def _share_of_surface(
    lattice: FreeNodes, data: RayPoints, linear: LinearDistances, posterior: NodeMoves
) -> float:
    """Return the share of the scatter beyond the noise that is of the surface: two scans share its roughness, and no error.

    It is the mean product of the distances of two points of different scans in the same cell of a quarter of a step, over the mean
    excess of their squares; 1 where scans do not overlap.
    """
    left = linear.residual - linear.rows @ posterior.mean
    cells = cell_numbers(data.xyz, _PAIRS_IN_STEPS * lattice.step_m)
    order = np.argsort(cells, kind="stable")
    a, b = order[:-1], order[1:]
    paired = (
        (cells[a] == cells[b])
        & (data.scan[a] != data.scan[b])
        & (linear.trust[a] == 1.0)
        & (linear.trust[b] == 1.0)
    )
    a, b = a[paired], b[paired]
    excess = float((left[a] ** 2 + left[b] ** 2 - linear.noise_m2[a] - linear.noise_m2[b]).sum()) / 2.0
    if len(a) < _N_LEAST or excess <= 0.0:
        return 1.0
    return min(max(float((left[a] * left[b]).sum()) / excess, 0.0), 1.0)


def _shared_by_scans(data: RayPoints, linear: LinearDistances, posterior: NodeMoves) -> FloatArray:
    """Return the variance about each node (N,) of errors that all points of a scan share [m²].

    It is the variance between the means of scans about the same node, less what the scatter of their points explains (analysis of
    variance), averaged over the nodes that several scans saw, or what the points state where that is more. It is divided by the number
    of scans that saw the node.
    """
    left = linear.residual - linear.rows @ posterior.mean
    means, of_means = [], []
    for k in range(int(data.scan.max()) + 1):
        share = linear.shares.T @ diags_array(np.where(data.scan == k, linear.trust, 0.0))
        count = np.maximum(share.sum(axis=1), 1e-9)
        mean, loss = share @ left / count, np.minimum(share.power(2).sum(axis=1) / count**2, 0.8)
        is_seen = count >= _LEAST_OF_SCAN
        means.append(np.where(is_seen, mean, np.nan))
        of_means.append(np.where(is_seen, (share @ left**2 / count - mean**2) * loss / (1.0 - loss), np.nan))
    mean, noise_m2 = np.stack(means), np.stack(of_means)
    n_seen = np.isfinite(mean).sum(axis=0)
    overlap = n_seen >= 2
    found_m2 = 0.0
    if overlap.sum() >= _N_LEAST:
        between = np.nanvar(mean[:, overlap], axis=0, ddof=1) - np.nanmean(noise_m2[:, overlap], axis=0)
        found_m2 = float(between.mean())
    count = linear.shares.T @ linear.trust
    about = (linear.shares.T @ (linear.trust * linear.shared_m2) + 1e-9 * linear.shared_m2.mean()) / (
        count + 1e-9
    )
    shared_m2: FloatArray = np.maximum(about, found_m2) / np.maximum(n_seen, 1)
    return shared_m2


def _calibrated(
    lattice: FreeNodes, data: RayPoints, linear: LinearDistances, rough_m2: FloatArray
) -> _Factors:
    """Leave out a scan, blocks and single points, and return the least factors with which 95 % of them are within their intervals.

    A scan that is left out hides what it alone saw, as overhangs hide ground; such points stand for gaps. Facets and normals are
    those of all points.
    """
    weights, usable = lattice.weights(linear), linear.trust > 0.0
    one_per_cell = np.zeros(len(weights), dtype=bool)
    one_per_cell[np.unique(cell_numbers(data.xyz, lattice.step_m), return_index=True)[1]] = True
    noise_m2 = linear.noise_m2 + linear.shares @ rough_m2
    in_gaps, near = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for k, scan in enumerate(_spread(data.scan)):
        in_blocks = left_out_blocks(data.xyz, _BLOCK_IN_STEPS * lattice.step_m, _BLOCK_SHARE, k)
        single = stream(k, "free lattice", "points left out").random(len(weights)) < _SINGLE_SHARE
        out = in_blocks | single | (data.scan == scan)
        posterior = lattice.solved(linear, np.where(out, 0.0, weights), N_DRAWS_ROUGH)
        error = linear.residual - linear.rows @ posterior.mean
        table = np.column_stack([error, ((linear.rows @ posterior.draws) ** 2).mean(axis=1), noise_m2])
        held = _supported(linear, (linear.trust > _LEAST_TRUST) & ~out)
        is_gap = linear.shares @ (~held).astype(np.float64) > 0.5
        in_gaps.append(table[out & usable & one_per_cell & is_gap])
        near.append(table[single & usable & ~is_gap])
    of_near = _least_factor(np.vstack(near))
    gaps = np.vstack(in_gaps)
    gaps[:, 2] *= of_near**2
    return _Factors(_least_factor(gaps, is_of_surface=True), of_near)


def _least_factor(table: FloatArray, *, is_of_surface: bool = False) -> float:
    """Return the least factor, 1 or more, on all of the variance or on that of the surface, that holds 95 % of the errors.

    `table` (K, 3): errors [m], variances of the surface and of points with roughness [m²].
    """
    if len(table) < _N_LEAST:
        return 1.0
    error, variance, noise_m2 = table.T
    square = (error / SIGMAS_95) ** 2
    needed = (square - noise_m2) / variance if is_of_surface else square / (variance + noise_m2)
    return float(np.sqrt(max(np.quantile(needed, 0.95), 1.0)))


def _spread(scan: IntArray) -> IntArray:
    """Return the scans that are left out, evenly among all; -1, none, where there is one scan alone."""
    n_scans = int(scan.max()) + 1
    return (
        np.full(_N_FOLDS, -1)
        if n_scans == 1
        else np.linspace(0, n_scans - 1, _N_FOLDS + 2)[1:-1].round().astype(np.int64)
    )
