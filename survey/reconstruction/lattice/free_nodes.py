r"""Nodes that are free in x, y and z, moved by Gauss-Newton steps along their normals.

`FreeNodes` moves the nodes of a mesh until

.. math::  \sum_p \frac{(n_{f(p)} \cdot (p - \sum_k w_{pk} x_k))^2}{n^T C_p n + \rho^2}
    + \frac{1}{\tau^2} \sum_i \frac{(n_i \cdot (\bar x_{N(i)} - x_i))^2}{s_i^2} + \frac{1}{6 \ell^2 \tau^2} \sum_{i \sim j} |x_i - x_j|^2

is least: the distances of the points from their facets f(p) along the normals, weighted by their covariances :math:`C_p` and by the
roughness ρ that is finer than the nodes; the bending of a thin plate, the distance of each node from the mean of its neighbours
along the normal; and the tension of a membrane, over ℓ = 3 steps, which keeps the plate from bulging across gaps. Huber's weights
reduce the effect of mixed pixels. The softness :math:`s_i` of Student's t with 4 degrees of freedom lets the plate bend at edges.

Each step moves every node along its normal and associates the points again. Between the steps nodes slide along the surface towards the
means of their neighbours, so that they stay evenly spaced. The scales τ and ρ are set to the fixed point of their restricted
likelihood (MacKay 1992, *Bayesian interpolation*), with the traces from draws of the posterior.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import SuperLU, splu

from survey.core import BoolArray, FloatArray, IntArray, stream
from survey.reconstruction.lattice.free_surface import facet_normals, nearest_facets
from survey.reconstruction.lattice.surface_net import cell_numbers

N_DRAWS_ROUGH = 16
"""Draws that give a variance to about a sixth."""
_FARTHEST_IN_STEPS, _LONGEST_MOVE, _SLIDE = 3.0, 0.5, 0.3
_DEGREES_OF_FREEDOM, _HUBER = 4.0, 2.5
_TENSION_IN_STEPS, _MEAN_NEIGHBOURS = 3.0, 6.0
_QUARTILE = 0.6745


class RayPoints(NamedTuple):
    """Points (P, 3) [m], unit rays (P, 3), covariances (P, 3, 3) of own errors and of those that scans share [m²], numbers of the scans (P,)."""

    xyz: FloatArray
    rays: FloatArray
    covariance: FloatArray
    shared: FloatArray
    scan: IntArray

    def one_per_cell(self, side_m: float) -> "RayPoints":
        """Return the first point of each cubic cell, so that near ground does not outnumber far walls."""
        first = np.sort(np.unique(cell_numbers(self.xyz, side_m), return_index=True)[1])
        return RayPoints(
            self.xyz[first], self.rays[first], self.covariance[first], self.shared[first], self.scan[first]
        )


class LinearDistances(NamedTuple):
    """Distances (P,) of points from their facets [m], and their derivatives by the displacements u (N,) along the normals.

    `rows` (P, N): moves of the facets at the points. `shares` (P, N): weights of the nodes. `noise_m2`, `shared_m2` (P,): variances of the
    own errors of the points along the normals, and of those that their scans share. `trust` (P,): weights of Huber, 0 for points without a facet. `bending` (N, N), `bend` (N,): the
    mean of the neighbours less the node, along its normal, is bend + bending u [m].
    """

    rows: csr_array
    shares: csr_array
    residual: FloatArray
    noise_m2: FloatArray
    shared_m2: FloatArray
    trust: FloatArray
    bending: csr_array
    bend: FloatArray


class NodeMoves(NamedTuple):
    """Mean displacements (N,) and draws of their errors (N, D) [m]."""

    mean: FloatArray
    draws: FloatArray


class FreeNodes:
    """Nodes that Gauss-Newton steps move, and the scales that are learned on the way."""

    def __init__(self, nodes: FloatArray, triangles: IntArray, step_m: float) -> None:
        self.nodes, self.triangles, self.step_m = nodes, triangles, step_m
        n = len(nodes)
        edges = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        signs = np.tile([1.0, -1.0], len(edges)) / np.sqrt(_MEAN_NEIGHBOURS)
        self.differences = csr_array(
            (signs, edges.ravel(), 2 * np.arange(len(edges) + 1)), shape=(len(edges), n)
        )
        links = coo_array(
            (np.ones(2 * len(edges)), np.vstack([edges, edges[:, ::-1]]).T), shape=(n, n)
        ).tocsr()
        self.n_neighbours: FloatArray = links.sum(axis=1)
        self.mean_of_neighbours = diags_array(1.0 / self.n_neighbours) @ links
        self.bending_m, self.roughness_m = 0.2 * step_m, 0.1 * step_m
        self.softness = np.ones(n)

    def weights(self, linear: LinearDistances) -> FloatArray:
        """Return the weights of the points (P,) [1/m²]."""
        return linear.trust / (linear.noise_m2 + self.roughness_m**2)

    def step(self, data: RayPoints) -> None:
        """Take one Gauss-Newton step along the normals, learn both scales, and let nodes slide along the surface."""
        linear = self.linearised(data)
        weights = self.weights(linear)
        posterior = self.solved(linear, weights, N_DRAWS_ROUGH)
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
        unit: FloatArray = total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None]
        return unit

    def linearised(self, data: RayPoints) -> LinearDistances:
        """Associate the points with facets, and linearise distances and bending about the present nodes."""
        normals, n = self.normals(), len(self.nodes)
        farthest_m = _FARTHEST_IN_STEPS * self.step_m
        facet, weights = nearest_facets(self.nodes, self.triangles, data.xyz, data.rays, farthest_m)
        corners, across = self.triangles[facet], facet_normals(self.nodes, self.triangles)[facet]
        residual = ((data.xyz - (weights[:, :, None] * self.nodes[corners]).sum(axis=1)) * across).sum(axis=1)
        moved = weights * (normals[corners] * across[:, None]).sum(axis=2)
        first = 3 * np.arange(len(data.xyz) + 1)
        rows, shares = (
            csr_array((values.ravel(), corners.ravel(), first), shape=(len(data.xyz), n))
            for values in (moved, weights)
        )
        noise_m2, shared_m2 = (
            np.einsum("pi,pij,pj->p", across, c, across) for c in (data.covariance, data.shared)
        )
        links = self.mean_of_neighbours.tocoo()
        alike = (normals[links.row] * normals[links.col]).sum(axis=1)
        bending = csr_array((links.data * alike, (links.row, links.col)), shape=(n, n)) - eye_array(n)
        bend = ((self.mean_of_neighbours @ self.nodes - self.nodes) * normals).sum(axis=1)
        trust = np.where(facet >= 0, self._trust(residual, noise_m2, facet >= 0), 0.0)
        return LinearDistances(rows, shares, residual, noise_m2, shared_m2, trust, bending.tocsr(), bend)

    def _trust(self, residual: FloatArray, noise_m2: FloatArray, has_facet: BoolArray) -> FloatArray:
        """Return the weights of Huber (P,); while the nodes are far from the points, their usual distance counts as noise."""
        away = np.abs(residual) / np.sqrt(noise_m2 + self.roughness_m**2)
        usual = max(1.0, float(np.median(away[has_facet])) / _QUARTILE) if has_facet.any() else 1.0
        return np.minimum(1.0, _HUBER * usual / np.maximum(away, 1e-12))

    def solved(self, linear: LinearDistances, weights: FloatArray, n_draws: int) -> NodeMoves:
        """Solve for the displacements, and draw their errors by perturbed right-hand sides (Papandreou and Yuille 2010)."""
        rows, bending, tau = linear.rows, linear.bending, self.bending_m
        stiff = diags_array(1.0 / (tau * self.softness))
        bending, bend = (stiff @ bending).tocsr(), stiff @ linear.bend
        tension = 1.0 / (_TENSION_IN_STEPS * tau)
        stretched = tension * self.differences
        precision = rows.T @ (diags_array(weights) @ rows) + bending.T @ bending + stretched.T @ stretched
        ridge = 1e-6 / tau**2 * eye_array(len(self.nodes))
        factor: SuperLU = splu(
            (precision + ridge).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        pull = tension**2 * self.n_neighbours / _MEAN_NEIGHBOURS * linear.bend
        mean = factor.solve(rows.T @ (weights * linear.residual) - bending.T @ bend + pull)
        rng = stream(0, "free lattice", "draws")
        of_points = rows.T @ (np.sqrt(weights)[:, None] * rng.standard_normal((len(weights), n_draws)))
        of_bending = bending.T @ rng.standard_normal((len(self.nodes), n_draws))
        of_tension = stretched.T @ rng.standard_normal((stretched.shape[0], n_draws))
        return NodeMoves(mean, factor.solve(of_points + of_bending + of_tension))

    def learn(self, linear: LinearDistances, weights: FloatArray, posterior: NodeMoves) -> None:
        """Set bending and roughness to the fixed point of their restricted likelihood."""
        n = len(self.nodes)
        bent = linear.bend + linear.bending @ posterior.mean
        soft = self.softness[:, None]
        lost = float(((linear.bending @ posterior.draws / soft) ** 2).sum(axis=0).mean()) / self.bending_m**2
        used = weights > 0.0
        left = linear.residual - linear.rows @ posterior.mean
        n_free = used.sum() - float(
            (weights[:, None] * (linear.rows @ posterior.draws) ** 2).sum(axis=0).mean()
        )
        excess = float((linear.trust * left**2).sum()) / max(n_free, 1.0) - float(
            linear.noise_m2[used].mean()
        )
        self.roughness_m = max(float(np.sqrt(max(excess, 0.0))), 1e-3 * self.step_m)
        self.bending_m = float(np.sqrt(((bent / self.softness) ** 2).sum() / max(n - lost, 0.05 * n)))
        nu = _DEGREES_OF_FREEDOM
        self.softness = np.sqrt((nu + (bent / self.bending_m) ** 2) / (nu + 1.0))
