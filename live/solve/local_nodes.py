r"""Chebyshev nodes of a stretch of ground: heights at few places, from which those of many points follow.

Within a rectangle of half sides a along its axes, interpolation by n Chebyshev nodes of a wave ``cos(ω x)`` errs by at
most

.. math::  \frac{(\omega a)^n}{2^{n-1} n!}

so that the error of a random surface follows from its spectrum, and as many nodes are taken as a tolerance needs.
"""

from math import factorial
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from survey.core.arrays import FloatArray


class LocalNodes(NamedTuple):
    """Places (q, 2) [m], and the weights (P, q) by which heights there give those of points."""

    xy: FloatArray
    weights: FloatArray


def local_nodes(xy: FloatArray, omega: FloatArray, strengths: FloatArray, tolerance_m: float) -> LocalNodes:
    """Return nodes from which the heights of points follow within a tolerance; the points themselves if no more are needed.

    Parameters
    ----------
    xy : (P, 2) ndarray
        Points [m].
    omega : (K, 2) ndarray
        Angular frequencies of the surface's waves [rad/m].
    strengths : (K,) ndarray
        Standard deviations of the waves [m].
    tolerance_m : float
        Largest standard deviation of the error of interpolation along either axis [m].

    Returns
    -------
    LocalNodes
        On the points' principal axes.

    Examples
    --------
    >>> xy = np.random.default_rng(1).uniform(0.0, 40.0, (500, 2))
    >>> omega = np.array([[0.02, 0.01], [-0.01, 0.03]])
    >>> nodes = local_nodes(xy, omega, np.array([1.0, 1.0]), 1e-3)
    >>> waves = np.cos(nodes.xy @ omega[0]), np.cos(xy @ omega[0])
    >>> len(nodes.xy) < 40, bool(np.abs(nodes.weights @ waves[0] - waves[1]).max() < 2e-3)
    (True, True)
    """
    middle = xy.mean(axis=0)
    axes = np.linalg.eigh((xy - middle).T @ (xy - middle))[1].T
    along = (xy - middle) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    half = np.maximum(0.5 * (high - low), 1e-6)
    numbers = [_n_needed(half[k] * np.abs(omega @ axes[k]), strengths, tolerance_m, len(xy)) for k in (0, 1)]
    if numbers[0] * numbers[1] >= len(xy):
        return LocalNodes(xy, np.eye(len(xy)))
    scaled = (along - 0.5 * (low + high)) / half
    rows = [_interpolation(scaled[:, k], numbers[k]) for k in (0, 1)]
    weights = (rows[0][:, :, None] * rows[1][:, None, :]).reshape(len(xy), -1)
    unit = [chebyshev.chebpts1(n) for n in numbers]
    nodes = np.stack(np.meshgrid(*unit, indexing="ij"), axis=-1).reshape(-1, 2)
    return LocalNodes(middle + (0.5 * (low + high) + nodes * half) @ axes, weights)


def _n_needed(phase: FloatArray, strengths: FloatArray, tolerance_m: float, most: int) -> int:
    """Return how many nodes a line needs, on whose half waves turn by some phases (K,) [rad]."""
    for n in range(1, most):
        bound = phase**n / (2.0 ** (n - 1) * factorial(n))
        if np.linalg.norm(strengths * bound) <= tolerance_m:
            return n
    return most


def _interpolation(t: FloatArray, n: int) -> FloatArray:
    """Return the weights (P, n) of values at n Chebyshev nodes for places (P,) from -1 to 1."""
    scale = np.full(n, 2.0 / n)
    scale[0] = 1.0 / n
    weights: FloatArray = (chebyshev.chebvander(t, n - 1) * scale) @ chebyshev.chebvander(
        chebyshev.chebpts1(n), n - 1
    ).T
    return weights
