r"""Gaussian process of points that is conditioned on the cells of a prior elevation model too.

A cell c of a prior measures the mean of the terrain over its area, with an error. Given the points, the process f has the
posterior mean m and covariance k; with the means H over the cells, their errors' covariance R and the cells S,

.. math::  m'(x) = m(x) + k(x, H) [k(H, H) + R]^{-1} (S - m(H)), \qquad
           v'(x) = v(x) - k(x, H) [k(H, H) + R]^{-1} k(H, x)

(Rasmussen and Williams 2006, Eqs. 2.23 and 2.24, on top of the points). Where points determine the terrain k(x, H) vanishes,
and with it the weight of the prior: the map near dense points is that without a prior. The sizes of the cells' errors are
estimated from the innovations S - m(H). A mean over a cell is that of four Gauss nodes, exact for cubic relief.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from survey.core import FloatArray, InputError
from survey.reconstruction.gp.averaged_process import AveragedProcess
from survey.reconstruction.gp.engines.regression import Process, means_of
from survey.reconstruction.gp.satellite_cells import SatelliteCells

_GAUSS = 0.5 / np.sqrt(3.0)
# Places at once, which bounds the memory of their covariance with the cells.
_BLOCK = 2000
# Arm of the difference that gives a slope, in shortest length scales.
_ARM = 1e-3


@dataclass(frozen=True)
class CellMeans:
    """Means of a process over cells (C,) [m], and their covariances with places [m²]."""

    process: Process
    cells: SatelliteCells

    @cached_property
    def nodes(self) -> FloatArray:
        """Gauss nodes of the cells (4 C, 2) [m], those of one cell beside one another."""
        u, v = self.cells.sides[:, 0], self.cells.sides[:, 1]
        signs = ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0))
        four = [self.cells.centre + _GAUSS * (a * u + b * v) for a, b in signs]
        nodes: FloatArray = np.stack(four, axis=1).reshape(-1, 2)
        return nodes

    @cached_property
    def expected(self) -> FloatArray:
        """Means over the cells (C,) [m]."""
        mean: FloatArray = self.process.predict(self.nodes)[0].reshape(-1, 4).mean(axis=1)
        return mean

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the means (C, C) [m²]."""
        every = means_of(self.with_places(self.nodes), 4)
        symmetric: FloatArray = 0.5 * (every + every.T)
        return symmetric

    def with_places(self, xy: FloatArray) -> FloatArray:
        """Return the covariance of the means with places, (C, M) [m²]."""
        return self._with_means(xy).T

    @cached_property
    def _with_means(self) -> Callable[[FloatArray], FloatArray]:
        return self.process.covariance_with(self.nodes, 4)


@dataclass(frozen=True)
class ProcessWithCells(Process):
    """A process given points and the cells of a prior.

    `base`: process given the points. `cells`: cells with the sizes of their errors. `conflicts`: conflicts of cells and
    points. `means`: means of the process over these cells, where they are known. Slopes are differences over a thousandth of
    the shortest length scale.
    """

    base: Process
    cells: SatelliteCells
    conflicts: tuple[str, ...] = ()
    means: CellMeans | None = None
    solves_each_node: ClassVar = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "kernel", self.base.kernel)
        object.__setattr__(self, "data", self.base.data)

    @cached_property
    def means_over_cells(self) -> CellMeans:
        """Means of the process over the cells."""
        return CellMeans(self.base, self.cells) if self.means is None else self.means

    @cached_property
    def _common(self) -> FloatArray:
        """Errors that the cells have in common, for unknowns of one standard deviation (C, J) [m]."""
        return self.cells.common_rows * self.cells.common_sigma

    @cached_property
    def _factor(self) -> FloatArray:
        """Lower Cholesky factor of the innovations' covariance (C, C) [m]."""
        total = self.means_over_cells.covariance + self.cells.covariance + self._common @ self._common.T
        factor: FloatArray = cholesky(total, lower=True)
        return factor

    @cached_property
    def _whitened(self) -> FloatArray:
        """Whitened innovations (C,)."""
        innovations = self.cells.height - self.means_over_cells.expected
        whitened: FloatArray = solve_triangular(self._factor, innovations, lower=True)
        return whitened

    def _half(self, xy: FloatArray) -> FloatArray:
        """Return the whitened covariance of cells and places (C, M), whose squares are what the cells explain [m²]."""
        return self._whiten(self.means_over_cells.with_places(xy))

    def _whiten(self, covariance: FloatArray) -> FloatArray:
        """Return the covariance of cells and places (C, M) [m²] over the root of the innovations' covariance [m]."""
        half: FloatArray = solve_triangular(self._factor, covariance, lower=True)
        return half

    def given(
        self, covariance: FloatArray, mean: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) given the cells, from those given the points and the covariance (C, M) with the cells."""
        half = self._whiten(covariance)
        left = variance - np.einsum("ij,ij->j", half, half)
        return mean + half.T @ self._whitened, np.maximum(left, 0.0)

    @property
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the density of values and cells."""
        determinant = float(np.log(np.diag(self._factor)).sum())
        n = len(self.cells)
        misfit = 0.5 * (float(self._whitened @ self._whitened) + n * np.log(2.0 * np.pi))
        return float(self.base.log_marginal_likelihood - misfit - determinant)

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at places (M, 2)."""
        return _in_blocks(xy, *_on_surface(self.base, xy), self._at)

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) on the nodes of two axes."""
        return _on_axes(self.base, x, y, self._at)

    def _at(self, xy: FloatArray, mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) given the cells, from those given the points."""
        return self.given(self.means_over_cells.with_places(xy), mean, variance)

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope of the mean (M, 2) [m/m]."""
        rises = [self._half_between(xy, arm).T @ self._whitened for arm in np.eye(2)]
        return self.base.gradient(xy) + np.stack(rises, axis=-1)

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (N,) that the other values and the cells predict for each value, its noise included."""
        return self.without_each(self.base.leave_one_out(), self.means_over_cells.with_places(self.data.xy))

    def without_each(
        self, by_points: tuple[FloatArray, FloatArray], covariance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return `leave_one_out` from that of the points alone, and from the covariance (C, N) of cells and points [m²].

        With the variance p of the surface given all values and the total variance t of a value's noise, the prediction
        without the value errs by t / (t - p) of its residual.
        """
        without, variance = by_points
        noise = np.minimum(self.data.noise_m2, variance)
        # Variance at the points given all points, from that without the point: p = t - t² / v.
        given = np.maximum(noise - noise**2 / variance, 0.0)
        residual = (self.data.values - without) * noise / variance
        half = self._whiten(covariance)
        given = np.maximum(given - np.einsum("ij,ij->j", half, half), 0.0)
        residual = residual - half.T @ self._whitened
        share = noise / np.maximum(noise - given, 1e-9 * noise)
        return self.data.values - residual * share, noise * share

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process that is conditioned on more values, at the same sizes of the cells' errors."""
        return replace(self, base=self.base.update(xy, values, sigma_m), means=None)

    def record(self) -> dict[str, Any]:
        """Return name and resolution of the engine, and the number of cells."""
        return {**self.base.record(), "n_cells": len(self.cells)}

    def sample_on_axes(self, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces (n, H, W) [m] on the nodes of two axes, by the covariance of all nodes."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        if len(nodes) > _BLOCK * 3:
            raise InputError(
                f"joint samples of a map with a prior's cells were asked for {len(nodes)} nodes, and {_BLOCK * 3} are the "
                "most; take a coarser grid."
            )
        value, vector = np.linalg.eigh(self.joint_covariance(nodes))
        root = vector * np.sqrt(np.maximum(value, 0.0))
        drawn = self.predict(nodes)[0] + rng.standard_normal((n, len(nodes))) @ root.T
        surfaces: FloatArray = drawn.reshape(n, len(y), len(x))
        return surfaces

    def weighted_sum(self, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
        """Return mean and standard deviation of the weighted sum of heights at places (M, 2)."""
        mean, std = self.base.weighted_sum(xy, weights)
        blocks = [slice(k, k + _BLOCK) for k in range(0, len(xy), _BLOCK)]
        half = np.sum([self._half(xy[block]) @ weights[block] for block in blocks], axis=0)
        return mean + float(half @ self._whitened), float(np.sqrt(max(std**2 - half @ half, 0.0)))

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2)."""
        half = self._half(xy)
        return self.base.joint_covariance(xy) - half.T @ half

    def derivative_variance_on_axes(self, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (H * W,) of the derivative along a vector (2,), without that of a trend."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        variance = self.base.derivative_variance_on_axes(x, y, direction)
        for start in range(0, len(nodes), _BLOCK):
            half = self._half_between(nodes[start : start + _BLOCK], direction)
            variance[start : start + _BLOCK] -= np.einsum("ij,ij->j", half, half)
        return np.maximum(variance, 0.0)

    def _half_between(self, xy: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the derivative (C, M) of `_half` along a vector (2,) [1/m]."""
        step = _ARM * self.kernel.length_scales_m[0]
        return (self._half(xy + step * direction) - self._half(xy - step * direction)) / (2.0 * step)

    def facts(self) -> dict[str, Any]:
        """Return the estimated errors of the prior with their standard deviations, and its conflicts, for the record."""
        sizes, common = self.cells.sizes, self._common
        gain = solve_triangular(self._factor, common, lower=True)
        value = self.cells.common_sigma * (gain.T @ self._whitened)
        left = np.eye(len(value)) - gain.T @ gain
        covariance = self.cells.common_sigma[:, None] * left * self.cells.common_sigma
        return {
            "satellite_sigma_m": sizes.white_m,
            "satellite_correlated_sigma_m": sizes.correlated_m,
            "prior_conflicts": list(self.conflicts),
            **self.cells.common_facts(value, covariance),
        }


@dataclass(frozen=True)
class ProcessAtLevels(AveragedProcess):
    """Average of one process given the same cells at several levels; what the levels share is computed once.

    `parts`: processes with cells, which have their base and their means in common.
    """

    parts: tuple[ProcessWithCells, ...]

    @classmethod
    def of(cls, parts: Sequence[ProcessWithCells], probabilities: FloatArray) -> Self:
        """Return the average, the most probable level first."""
        order = np.argsort(-probabilities, kind="stable")
        some = tuple(parts[k] for k in order)
        return cls(some, probabilities[order], np.zeros(len(some)), (None,) * len(some))

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at places (M, 2)."""
        return _in_blocks(xy, *_on_surface(self.parts[0].base, xy), self._at)

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) on the nodes of two axes."""
        return _on_axes(self.parts[0].base, x, y, self._at)

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (N,) that the other values predict for each value, its noise included."""
        first = self.parts[0]
        by_points, covariance = first.base.leave_one_out(), first.means_over_cells.with_places(self.data.xy)
        every = [part.without_each(by_points, covariance) for part in self.parts]
        return self._moments(self.data.xy, [mean for mean, _ in every], [variance for _, variance in every])

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the average that is conditioned on more values."""
        base = self.parts[0].base.update(xy, values, sigma_m)
        means = CellMeans(base, self.parts[0].cells)
        return replace(self, parts=tuple(replace(part, base=base, means=means) for part in self.parts))

    def _at(self, xy: FloatArray, mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) of the average, from those given the points."""
        covariance = self.parts[0].means_over_cells.with_places(xy)
        every = [part.given(covariance, mean, variance) for part in self.parts]
        return self._moments(xy, [mean for mean, _ in every], [variance for _, variance in every])


_GivenCells = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def _on_surface(base: Process, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance (M,) of the surface given the points."""
    mean, variance = base.predict(xy)
    return mean, base.surface_variance(variance, xy)


def _in_blocks(
    xy: FloatArray, mean: FloatArray, variance: FloatArray, given: _GivenCells
) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance (M,) given the cells, block by block, from those given the points."""
    for start in range(0, len(xy), _BLOCK):
        block = slice(start, start + _BLOCK)
        mean[block], variance[block] = given(xy[block], mean[block], variance[block])
    return mean, variance


def _on_axes(
    base: Process, x: FloatArray, y: FloatArray, given: _GivenCells
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (H, W) given the cells on the nodes of two axes, some rows at once."""
    mean, std = base.predict_on_axes(x, y)
    rows = max(_BLOCK // len(x), 1)
    for start in range(0, len(y), rows):
        part = slice(start, start + rows)
        nodes = np.stack(np.meshgrid(x, y[part]), axis=-1).reshape(-1, 2)
        variance = base.surface_variance(std[part].ravel() ** 2, nodes)
        found, left = given(nodes, mean[part].ravel(), variance)
        mean[part], std[part] = found.reshape(-1, len(x)), np.sqrt(left).reshape(-1, len(x))
    return mean, std
