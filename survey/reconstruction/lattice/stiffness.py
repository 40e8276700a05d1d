r"""Estimate by maximum likelihood the stiffness and range of the ground and the scale of the sensor's errors.

The prior of the heights z about a plane is that of a thin plate on an elastic bed,

.. math::  E(z) = \tfrac{\kappa}{2} \int \big( (k^2 - \Delta) z \big)^2 dA, \qquad k = \sqrt 8 / \rho

a Gaussian field of Matérn smoothness 1 (Lindgren, Rue and Lindström 2011): κ is the
stiffness, without a unit, and ρ the range [m] at which the correlation has fallen to about 0.1.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded
from scipy.optimize import minimize_scalar

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice.information import Information
from survey.reconstruction.lattice.multigrid.banded import band_cholesky, band_of, log_determinant
from survey.reconstruction.lattice.multigrid.plate_prior import Weights
from survey.reconstruction.lattice.multigrid.solver import Operator
from survey.reconstruction.nodes import NodeWindow

# Patches of nodes from which it is learned: the ones with most points, side by side.
PATCH_NODES = 32
"""Nodes along a side of a patch."""
_N_PATCHES = 6
_LEAST_POINTS = 60
_RANGES_IN_STEPS = (400.0, 80.0, 40.0, 20.0, 10.0)
_NOISE_FACTORS = (0.05, 10.0)
_LOG_WIDTH_FIRST, _LOG_WIDTH_LATER = 7.0, 1.5


class Stiffness(NamedTuple):
    """The prior of the surface and the scale of the errors."""

    stiffness: float
    """κ, without a unit."""
    range_m: float
    """ρ: where the correlation has fallen to about 0.1 [m]."""
    noise_factor: float = 1.0
    """Standard deviation of the points over what they state."""

    def weights(self, step_m: float) -> Weights:
        """Return the weights of plate, membrane and mass on a lattice [1/m²]."""
        k_squared = 8.0 / self.range_m**2
        plate = self.stiffness / step_m**2
        return plate, 2.0 * self.stiffness * k_squared, self.stiffness * k_squared**2 * step_m**2

    def prior_std_m(self) -> float:
        """Return the standard deviation of a height about the plane where nothing is known [m]."""
        return float(self.range_m / np.sqrt(32.0 * np.pi * self.stiffness))


class LatticeLikelihood:
    """The likelihood of points on a small lattice, as a function of stiffness and range.

    Parameters
    ----------
    points : (N, 4) ndarray
        Lattice coordinates, height [m] and weight [1/m²].
    shape : (2,) tuple of int
        Rows and columns of the lattice.
    step_m : float
        Distance between its nodes [m].
    """

    def __init__(self, points: FloatArray, shape: tuple[int, int], step_m: float) -> None:
        self._step_m = step_m
        information = Information.empty(shape, 0)
        information.add(points)
        plane = information.plane()
        height = points[:, 2] - (plane[0] + points[:, :2] @ plane[1:])
        information = Information.empty(shape, 0)
        information.add(np.column_stack([points[:, :2], height, points[:, 3]]))
        self._rhs = information.rhs.ravel()
        self.n_points, self._energy = len(points), float(np.sum(points[:, 3] * height**2))
        self._data_band = band_of(Operator(information.stencil, (0.0, 0.0, 0.0)))

    def __call__(self, log_ratio: float, range_m: float) -> tuple[float, float]:
        r"""Return the two parts of the likelihood that know the heights.

        With the ratio λ = κ s² of stiffness and squared noise factor,

        .. math::  2 \log p = \underbrace{m \log\lambda + \log|Q_0| - \log|\lambda Q_0 + S|}_D
            - N \log s^2 - F / s^2 + \mathrm{const}

        where :math:`F = z^T R^{-1} z - b^T (\lambda Q_0 + S)^{-1} b`, m counts the nodes, and Q₀ is the
        prior's matrix at κ = 1. Returned are D and F.
        """
        band, log_prior = _prior_band(range_m, self._step_m)
        factor = band_cholesky(self._data_band + np.exp(log_ratio) * band)
        z = cho_solve_banded((factor, True), self._rhs, check_finite=False)
        misfit = max(self._energy - float(np.sum(self._rhs * z)), 1e-12)
        return band.shape[1] * log_ratio + log_prior - log_determinant(factor), misfit


@lru_cache(maxsize=32)
def _prior_band(range_m: float, step_m: float) -> tuple[FloatArray, float]:
    """Return the prior's matrix on a patch at κ = 1, as a band, and its log determinant."""
    nothing = np.zeros((1, PATCH_NODES, PATCH_NODES))
    band = band_of(Operator(nothing, Stiffness(1.0, range_m).weights(step_m)))
    return band, log_determinant(band_cholesky(band))


class _Joint:
    """The likelihood of several patches, at the noise factor that makes it largest."""

    def __init__(self, patches: Sequence[LatticeLikelihood]) -> None:
        self._patches = patches
        self._n = sum(patch.n_points for patch in patches)

    def noise_factor(self, misfit: float) -> float:
        """Return s² = F/N, within bounds."""
        return float(np.clip(np.sqrt(misfit / self._n), *_NOISE_FACTORS))

    def __call__(self, log_ratio: float, range_m: float) -> tuple[float, float]:
        """Return the log likelihood and the noise factor."""
        determinants, misfit = np.sum([patch(log_ratio, range_m) for patch in self._patches], axis=0)
        noise_factor = self.noise_factor(misfit)
        twice = determinants - 2.0 * self._n * np.log(noise_factor) - misfit / noise_factor**2
        return 0.5 * float(twice), noise_factor


def likeliest(points: FloatArray, step_m: float, start: Stiffness | None = None) -> Stiffness | None:
    """Return the likeliest stiffness, range and noise factor; None when the points are too few.

    Parameters
    ----------
    points : (N, 4) ndarray
        Easting and northing [m], height above a local datum [m], weight 1/σ² [1/m²].
    step_m : float
        Distance between the lattice's nodes [m].
    start : Stiffness, optional
        What was likeliest before; near it the search is short.
    """
    patches = [LatticeLikelihood(*patch, step_m) for patch in _fullest(points, step_m)]
    return likeliest_of(patches, [step_m * n for n in _RANGES_IN_STEPS], start) if patches else None


def likeliest_of(
    patches: Sequence[LatticeLikelihood], ranges: Sequence[float], start: Stiffness | None = None
) -> Stiffness:
    """Return the stiffness, range and noise factor that are likeliest on all patches.

    Parameters
    ----------
    patches : sequence of LatticeLikelihood
        Patches of 32 × 32 nodes.
    ranges : sequence of float
        Ranges to try [m].
    start : Stiffness, optional
        What was likeliest before; near it the search is short.
    """
    joint = _Joint(patches)
    if start is None:
        centre, width = np.log(1000.0), _LOG_WIDTH_FIRST
    else:
        centre, width = np.log(start.stiffness * start.noise_factor**2), _LOG_WIDTH_LATER
        k = int(np.argmin(np.abs(np.log(np.array(ranges) / start.range_m))))
        ranges = ranges[max(k - 1, 0) : k + 2]
    _, log_ratio, range_m = max(_likeliest_at(joint, centre, width, range_m) for range_m in ranges)
    noise_factor = joint(log_ratio, range_m)[1]
    return Stiffness(float(np.exp(log_ratio)) / noise_factor**2, range_m, noise_factor)


def _likeliest_at(joint: _Joint, centre: float, width: float, range_m: float) -> tuple[float, float, float]:
    """Return the largest log likelihood at one range, the logarithm of κ s² there, and the range."""
    found = minimize_scalar(
        lambda log_ratio: -joint(log_ratio, range_m)[0],
        bounds=(centre - width, centre + width),
        method="bounded",
        options={"xatol": 0.15},
    )
    return -float(found.fun), float(found.x), range_m


def _fullest(points: FloatArray, step_m: float) -> list[tuple[FloatArray, tuple[int, int]]]:
    """Return the points, in lattice coordinates, and the shape of the patches in which most nodes have points."""
    cells = np.floor(points[:, :2] / step_m).astype(np.int64)
    side = PATCH_NODES - 1
    first = cells.min(axis=0)
    patch = (cells - first) // side
    occupied = np.unique(np.column_stack([patch, cells]), axis=0)
    patches, n_cells = np.unique(occupied[:, :2], axis=0, return_counts=True)
    found = []
    for k in np.argsort(-n_cells, kind="stable")[:_N_PATCHES]:
        inside = (patch == patches[k]).all(axis=1)
        if inside.sum() >= _LEAST_POINTS:
            west, south = (first + patches[k] * side).tolist()
            window = NodeWindow(step_m, west, south, PATCH_NODES, PATCH_NODES)
            uv = window.coordinates(points[inside, :2])
            found.append((np.column_stack([uv, points[inside, 2:]]), window.shape))
    return found
