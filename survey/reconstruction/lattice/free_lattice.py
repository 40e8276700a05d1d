r"""Lattice whose nodes are free in x, y and z: overhangs, serac edges and undercut walls, with standard deviations.

`free_lattice` moves the nodes of a mesh (`survey.reconstruction.lattice.surface_net`) until

.. math::  \sum_p \frac{(n_{f(p)} \cdot (p - \sum_k w_{pk} x_k))^2}{n^T C_p n + \rho^2}
    + \frac{1}{\tau^2} \sum_i (n_i \cdot (\bar x_{N(i)} - x_i))^2

is least: the distances of the points from their facets f(p) along the normals, weighted by the covariances :math:`C_p` of the
points and the roughness ρ that is finer than the nodes, and the bending energy of a thin plate, the distance of each node from
the mean of its neighbours along the normal. Gauss-Newton steps move each node along its normal and associate the points again; between the steps
nodes slide along the surface towards the means of their neighbours, so that they stay evenly spaced (the EMap paper, section 7, lets
nodes free in x and y). The scales τ and ρ are those of greatest restricted likelihood, by the fixed point of MacKay (1992).

The standard deviation along the normal is that of the posterior of the linearised problem and the roughness; blocks of
points that are left out scale it.
"""

import os
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import SuperLU, splu

from survey.core import BoolArray, FloatArray, InputError, IntArray, stream
from survey.data import SurfacePoints
from survey.reconstruction.lattice.calibration import left_out_blocks
from survey.reconstruction.lattice.free_surface import FreeSurface, facet_normals, nearest_facets
from survey.reconstruction.lattice.surface_net import cell_numbers, surface_net
from survey.reconstruction.terrain_map import SIGMAS_95

# Sides of the cells from which one point is taken at each step.
_CELLS_IN_STEPS = (0.5, 0.5, 0.35, 0.35, 0.25)
_N_DRAWS, _N_DRAWS_LEARNING = 64, 16
_FARTHEST_IN_STEPS, _LONGEST_MOVE = 3.0, 0.5
_TAIL = float(os.environ.get('TAIL','4'))
_SLIDE = 0.3
_TENSION_IN_STEPS, _MEAN_NEIGHBOURS = float(os.environ.get('TEN','3.0')), 6.0
_HUBER, _LEAST_TRUST = 2.5, 0.3
_PRIOR_POINTS = 6.0
_N_FOLDS, _BLOCK_SHARE, _SINGLE_SHARE, _BLOCK_IN_STEPS = 3, 0.15, 0.05, 4.0
_N_LEAST = 40
_LEAST_OF_SCAN = 3.0


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
        Points with their covariances and with the places of the scanner (`SurfacePoints.origins`); see `beam_covariance`.
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
        Points without origins, too few points, or steps that are too small for their extent.

    Notes
    -----
    Sharp edges are rounded over about one step; the roughness holds the error. Walls thinner than two steps may be merged. Errors
    that all points of a scan share are in the standard deviation only where scans overlap.
    """
    if points.origins is None:
        raise InputError("the points do not state where the scanner stood; add the columns origin_x_m, origin_y_m and origin_z_m.")
    if not step_m > 0.0:
        raise InputError(f"nodes {step_m:g} m apart are impossible; give a step above 0.")
    datum = np.floor(points.xyz.min(axis=0))
    xyz, origins = points.xyz - datum, points.origins - datum
    rays = xyz - origins
    rays = rays / np.linalg.norm(rays, axis=1)[:, None]
    nodes, triangles = surface_net(xyz, origins, step_m, 6.0 * step_m if reach_m is None else reach_m)
    covariance = (
        points.covariance if points.covariance is not None else (points.sigma_z**2)[:, None, None] * np.eye(3)
    )
    _, scan = np.unique(origins, axis=0, return_inverse=True)
    lattice = _Lattice(nodes, triangles, step_m)
    data = _Data(xyz, rays, covariance, scan.ravel())
    for cells in _CELLS_IN_STEPS:
        lattice.step(data.one_per_cell(cells * step_m))
    return lattice.surface(data, datum)


class _Data(NamedTuple):
    """Points (P, 3) [m], unit rays (P, 3), covariances (P, 3, 3) [m²], and numbers of their scans (P,)."""

    xyz: FloatArray
    rays: FloatArray
    covariance: FloatArray
    scan: IntArray

    def one_per_cell(self, side_m: float) -> "_Data":
        """Return the first point of each cubic cell, so that near ground does not outnumber far walls."""
        first = np.sort(np.unique(cell_numbers(self.xyz, side_m), return_index=True)[1])
        return _Data(*(column[first] for column in self))


class _Linear(NamedTuple):
    """Linearised problem of the displacements u (N,) along the normals: residual (P,) = rows u, bend (N,) = bending u.

    `noise_m2` (P,): variances of the points along the normals of their facets. `trust` (P,): weights of Huber, 0 for
    points without a facet.
    """

    rows: csr_array
    shares: csr_array
    residual: FloatArray
    noise_m2: FloatArray
    trust: FloatArray
    bending: csr_array
    bend: FloatArray


class _Posterior(NamedTuple):
    """Mean displacements (N,) and draws of their errors (N, D) [m]."""

    mean: FloatArray
    draws: FloatArray


class _Factors(NamedTuple):
    """Factors on the posterior's standard deviation in gaps and near points."""

    gaps: float
    near: float


class _Lattice:
    """Nodes that Gauss-Newton steps move, and the scales that are learned on the way."""

    def __init__(
        self, nodes: FloatArray, triangles: IntArray, step_m: float
    ) -> None:
        self.nodes, self.triangles, self.step_m = nodes, triangles, step_m
        edges = triangles[:, [0, 1, 1, 2, 2, 0, 1, 0, 2, 1, 0, 2]].reshape(-1, 2)
        n = len(nodes)
        links = coo_array((np.ones(len(edges)), edges.T), shape=(n, n)).tocsr()
        links.data[:] = 1.0
        self.n_neighbours = links.sum(axis=1)
        self.mean_of_neighbours = diags_array(1.0 / self.n_neighbours) @ links
        once = coo_array(links)
        first = once.row < once.col
        ends = np.column_stack([once.row[first], once.col[first]])
        signs = np.tile([1.0, -1.0], len(ends)) / np.sqrt(_MEAN_NEIGHBOURS)
        self.differences = csr_array((signs, (np.repeat(np.arange(len(ends)), 2), ends.ravel())), shape=(len(ends), n))
        self.bending_m, self.roughness_m = 0.2 * step_m, 0.1 * step_m
        self.softness = np.ones(n)

    def step(self, data: _Data) -> None:
        """Take one Gauss-Newton step along the normals, learn both scales, and let nodes slide along the surface."""
        linear = self.linearised(data)
        weights = linear.trust / (linear.noise_m2 + self.roughness_m**2)
        posterior = self.solved(linear, weights, _N_DRAWS_LEARNING)
        self.learn(linear, weights, posterior)
        limit = _LONGEST_MOVE * self.step_m
        normals = self.normals()
        self.nodes = self.nodes + np.clip(posterior.mean, -limit, limit)[:, None] * normals
        slide = self.mean_of_neighbours @ self.nodes - self.nodes
        slide -= (slide * normals).sum(axis=1)[:, None] * normals
        self.nodes = self.nodes + _SLIDE * slide

    def normals(self) -> FloatArray:
        """Return the unit normals of the nodes (N, 3), means of their facets' by area."""
        a, b, c = (self.nodes[column] for column in self.triangles.T)
        areas = np.cross(b - a, c - a)
        total = np.zeros_like(self.nodes)
        for column in self.triangles.T:
            for axis in range(3):
                total[:, axis] += np.bincount(column, areas[:, axis], len(total))
        return total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None]

    def linearised(self, data: _Data) -> _Linear:
        """Associate the points with facets, and linearise distances and bending about the present nodes."""
        normals, n = self.normals(), len(self.nodes)
        facet, weights = nearest_facets(
            self.nodes, self.triangles, data.xyz, data.rays, _FARTHEST_IN_STEPS * self.step_m
        )
        corners, across = self.triangles[facet], facet_normals(self.nodes, self.triangles)[facet]
        residual = ((data.xyz - (weights[:, :, None] * self.nodes[corners]).sum(axis=1)) * across).sum(axis=1)
        values = weights * (normals[corners] * across[:, None]).sum(axis=2)
        index = np.repeat(np.arange(len(data.xyz)), 3)
        shape = (len(data.xyz), n)
        rows = csr_array((values.ravel(), (index, corners.ravel())), shape=shape)
        shares = csr_array((weights.ravel(), (index, corners.ravel())), shape=shape)
        noise_m2 = np.einsum("pi,pij,pj->p", across, data.covariance, across)
        spread = np.sqrt(noise_m2 + self.roughness_m**2)
        usual = max(1.0, float(np.median(np.abs(residual[facet >= 0]) / spread[facet >= 0])) / 0.6745)
        trust = np.minimum(1.0, _HUBER * usual * spread / np.maximum(np.abs(residual), 1e-12))
        links = self.mean_of_neighbours.tocoo()
        alike = (normals[links.row] * normals[links.col]).sum(axis=1)
        bending = (csr_array((links.data * alike, (links.row, links.col)), shape=(n, n)) - eye_array(n)).tocsr()
        bend = ((self.mean_of_neighbours @ self.nodes - self.nodes) * normals).sum(axis=1)
        return _Linear(rows, shares, residual, noise_m2, np.where(facet >= 0, trust, 0.0), bending, bend)

    def solved(self, linear: _Linear, weights: FloatArray, n_draws: int) -> _Posterior:
        """Solve for the displacements, and draw their errors by perturbed right-hand sides (Papandreou and Yuille 2010)."""
        rows, bending, tau = linear.rows, linear.bending, self.bending_m
        stiff = diags_array(1.0 / (tau * self.softness))
        bending, bend = (stiff @ bending).tocsr(), stiff @ linear.bend
        tension = 1.0 / (_TENSION_IN_STEPS * tau)
        stretched = tension * self.differences
        precision = rows.T @ (diags_array(weights) @ rows) + bending.T @ bending + stretched.T @ stretched
        ridge = 1e-6 / tau**2 * eye_array(len(self.nodes))
        factor: SuperLU = splu(
            (precision + ridge).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        pull = tension**2 * self.n_neighbours / _MEAN_NEIGHBOURS * linear.bend
        mean = factor.solve(rows.T @ (weights * linear.residual) - bending.T @ bend + pull)
        rng = stream(0, "free lattice", "draws")
        of_points = rows.T @ (np.sqrt(weights)[:, None] * rng.standard_normal((len(weights), n_draws)))
        of_bending = bending.T @ rng.standard_normal((len(self.nodes), n_draws))
        of_tension = stretched.T @ rng.standard_normal((stretched.shape[0], n_draws))
        return _Posterior(mean, factor.solve(of_points + of_bending + of_tension))

    def learn(self, linear: _Linear, weights: FloatArray, posterior: _Posterior) -> None:
        """Set bending and roughness to the fixed point of their restricted likelihood."""
        n = len(self.nodes)
        bent = linear.bend + linear.bending @ posterior.mean
        soft = self.softness[:, None]
        lost = float(((linear.bending @ posterior.draws / soft) ** 2).sum(axis=0).mean()) / self.bending_m**2
        used = weights > 0.0
        left = linear.residual - linear.rows @ posterior.mean
        n_free = used.sum() - float((weights[:, None] * (linear.rows @ posterior.draws) ** 2).sum(axis=0).mean())
        excess = float((linear.trust * left**2).sum()) / max(n_free, 1.0) - float(linear.noise_m2[used].mean())
        self.roughness_m = max(float(np.sqrt(max(excess, 0.0))), 1e-3 * self.step_m)
        self.bending_m = float(np.sqrt(((bent / self.softness) ** 2).sum() / max(n - lost, 0.05 * n)))
        if _TAIL:
            self.softness = np.sqrt((_TAIL + (bent / self.bending_m) ** 2) / (_TAIL + 1.0))

    def surface(self, data: _Data, datum: FloatArray) -> FreeSurface:
        """Return nodes, standard deviations and support, with places counted from the datum (3,) [m]."""
        linear = self.linearised(data)
        weights = linear.trust / (linear.noise_m2 + self.roughness_m**2)
        posterior = self.solved(linear, weights, _N_DRAWS)
        rough_m2 = self.roughness_about(linear, posterior)
        factors = self.calibrated(data, linear, weights, rough_m2)
        shared_m2 = self.shared_by_scan(data, linear, posterior)
        self.shared_m2=shared_m2
        touched = linear.shares.T @ (linear.trust > _LEAST_TRUST).astype(np.float64) > 0.0
        factor = np.where(touched, factors.near, factors.gaps)
        sigma = np.sqrt(factor**2 * (posterior.draws**2).mean(axis=1) + factors.near**2 * rough_m2 + shared_m2)
        normals = self.normals()
        nodes = self.nodes + posterior.mean[:, None] * normals
        return FreeSurface(
            nodes + datum, self.triangles, normals, sigma, touched, self.step_m, self.bending_m, self.roughness_m, factors.near
        )

    def roughness_about(self, linear: _Linear, posterior: _Posterior) -> FloatArray:
        """Return the variance about each node (N,) that the noise of the points does not explain [m²]."""
        left = linear.residual - linear.rows @ posterior.mean
        share = linear.shares.T @ diags_array(linear.trust)
        excess = share @ (left**2 - linear.noise_m2) + _PRIOR_POINTS * self.roughness_m**2
        count = share.sum(axis=1) + _PRIOR_POINTS
        near = self.mean_of_neighbours
        smooth: FloatArray = (excess + near @ excess) / (count + near @ count)
        return np.maximum(smooth, self.roughness_m**2)

    def shared_by_scan(self, data: _Data, linear: _Linear, posterior: _Posterior) -> FloatArray:
        """Return the variance about each node (N,) of errors that all points of a scan share [m²], from where scans overlap.

        The variance between the means of scans about a node, less what the points within them explain (analysis of variance),
        over the number of scans that see the node.
        """
        left = linear.residual - linear.rows @ posterior.mean
        n_scans = int(data.scan.max()) + 1
        sums = []
        for k in range(n_scans):
            of_scan = diags_array(np.where(data.scan == k, linear.trust, 0.0))
            share = linear.shares.T @ of_scan
            sums.append((share.sum(axis=1), share @ left, share @ left**2, share.power(2).sum(axis=1)))
        count, total, squares, own = (np.stack(column) for column in zip(*sums, strict=True))
        seen = count >= _LEAST_OF_SCAN
        several = seen.sum(axis=0) >= 2
        n_seen = np.maximum(seen.sum(axis=0), 1)
        mean = np.where(seen, total / np.maximum(count, 1e-9), np.nan)[:, several]
        within = np.where(seen, squares / np.maximum(count, 1e-9), np.nan)[:, several] - mean**2
        of_mean = within * (own / np.maximum(count, 1e-9) ** 2)[:, several] / np.maximum(1.0 - (own / np.maximum(count, 1e-9) ** 2)[:, several], 0.2)
        between = np.nanvar(mean, axis=0, ddof=1) - np.nanmean(of_mean, axis=0)
        shared = max(float(between.mean()), 0.0) if several.sum() >= _N_LEAST else 0.0
        print('shared', np.sqrt(shared), several.mean(), n_seen.mean())
        near = self.mean_of_neighbours
        return shared / n_seen

    def calibrated(self, data: _Data, linear: _Linear, weights: FloatArray, rough_m2: FloatArray) -> _Factors:
        """Leave out blocks and single points, and return factors that would have held for them."""
        numbers = cell_numbers(data.xyz, self.step_m)
        one_per_cell = np.zeros(len(numbers), dtype=bool)
        one_per_cell[np.unique(numbers, return_index=True)[1]] = True
        gaps, near = [], []
        noise_m2 = linear.noise_m2 + linear.shares @ rough_m2
        for k, scan in enumerate(_spread(data.scan, _N_FOLDS)):
            in_blocks = left_out_blocks(data.xyz, _BLOCK_IN_STEPS * self.step_m, _BLOCK_SHARE, k)
            single = stream(k, "free lattice", "points left out").random(len(weights)) < _SINGLE_SHARE
            out = in_blocks | single | (data.scan == scan)
            posterior = self.solved(linear, np.where(out, 0.0, weights), _N_DRAWS_LEARNING)
            error = linear.residual - linear.rows @ posterior.mean
            variance = ((linear.rows @ posterior.draws) ** 2).mean(axis=1)
            table = np.column_stack([error, variance, noise_m2])
            held = linear.shares.T @ ((linear.trust > _LEAST_TRUST) & ~out).astype(np.float64) > 0.0
            in_gap = linear.shares @ (~held).astype(np.float64) > 0.5
            gaps.append(table[out & (linear.trust > 0.0) & one_per_cell & in_gap])
            near.append(table[out & (linear.trust > 0.0) & ~in_gap & single])
        of_gaps, of_near = np.vstack(gaps), np.vstack(near)
        a = q = 1.0
        if len(of_near) >= _N_LEAST:
            error, variance, noise = of_near.T
            q = max(float(np.quantile(np.abs(error) / np.sqrt(variance + noise), 0.95)) / SIGMAS_95, 1.0)
        if len(of_gaps) >= _N_LEAST:
            error, variance, noise = of_gaps.T
            needed = np.sqrt(np.maximum((error / SIGMAS_95) ** 2 - q**2 * noise, 0.0) / variance)
            a = max(float(np.quantile(needed, 0.95)), 1.0)
        print('a', a, len(of_gaps), 'q', q, len(of_near))
        return _Factors(a, q)


def _spread(scan: IntArray, n: int) -> IntArray:
    """Return up to n scans (n,) that lie evenly among all; -1, none, where there is one scan alone."""
    n_scans = int(scan.max()) + 1
    return np.full(n, -1) if n_scans == 1 else np.linspace(0, n_scans - 1, n).round().astype(np.int64)
