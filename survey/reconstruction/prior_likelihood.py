r"""Likelihood of the errors of a prior elevation model, and its conflicts with the points.

With cells S, their mean μ and covariance Σ from the points, and the covariance B of the offset, tilt and shift,

.. math::  S - \mu \sim N(0, \Sigma + B + \sigma_c^2 \rho_l + \sigma_w^2 I).

For one length l and one σ_c an eigendecomposition gives the likelihood of every σ_w. The sizes have log-normal priors;
their likelihood, integrated over the grid, is the evidence of the terrain's hyperparameters that led to μ and Σ. A conflict
is an offset, a misfit or a size of errors that the error model makes improbable.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtrc

from survey.core import FloatArray
from survey.reconstruction.prior import ErrorScale, PriorErrors

# Sizes that are compared [m], and factors of the correlation length with the spread of its logarithm.
_WHITE_M = np.geomspace(0.05, 20.0, 200)
_CORRELATED_M = np.geomspace(0.05, 20.0, 14)
_LENGTH_FACTORS, _LENGTH_LOG_SD = (0.5, 1.0, 2.0), 0.5
# Sizes of the offset over that of the product's class, in standard deviations of its logarithm.
_LEVELS = np.linspace(-2.5, 2.5, 11)
# More cells than these change the sizes by a few per cent.
_MOST_CELLS = 256


class Innovations(NamedTuple):
    """Cells less what points alone state about them.

    `centre` (C, 2): places of the cells [m]. `value_m` (C,): cell less mean of the terrain [m]. `covariance`
    (C, C): of the means of the terrain, and of tilt and shift of the prior [m²]. `level_sigma_m`: standard
    deviation of a vertical offset that all cells share, as the class of the prior has it [m].
    """

    centre: FloatArray
    value_m: FloatArray
    covariance: FloatArray
    level_sigma_m: float = 0.0

    @property
    def with_level(self) -> FloatArray:
        """The covariance with that of the offset (C, C) [m²]."""
        return self.covariance + self.level_sigma_m**2

    def thinned(self) -> "Innovations":
        """Return at most 256 of the cells, spread evenly."""
        if len(self.value_m) <= _MOST_CELLS:
            return self
        part = np.linspace(0, len(self.value_m) - 1, _MOST_CELLS).astype(np.int64)
        few = self._replace(centre=self.centre[part], value_m=self.value_m[part])
        return few._replace(covariance=self.covariance[np.ix_(part, part)])


class ErrorSizes(NamedTuple):
    """Likeliest sizes of the errors of a prior's cells.

    `white_m`, `correlated_m`: standard deviations [m]. `correlation_m`: distance over which the correlation
    falls to 1/e [m]. `white_log_sd`, `correlated_log_sd`: posterior standard deviations of the logarithms of
    the two. `log_evidence`: log likelihood of the cells, integrated over the sizes. `level_factor`: size of
    the vertical offset over that of the product's class.
    """

    white_m: float
    correlated_m: float
    correlation_m: float
    white_log_sd: float
    correlated_log_sd: float
    log_evidence: float
    level_factor: float = 1.0

    def covariance(self, centre: FloatArray) -> FloatArray:
        """Return the covariance (C, C) of the errors of cells at places (C, 2) [m²].

        `centre` (C, 2): places [m]. Returns (C, C): covariance [m²].
        """
        shared = self.correlated_m**2 * correlation(centre, self.correlation_m)
        return shared + self.white_m**2 * np.eye(len(centre))


def correlation(centre: FloatArray, length_m: float) -> FloatArray:
    """Return the correlation (C, C) of errors that neighbouring cells share, exp(-d / l).

    `centre` (C, 2): places [m]. `length_m`: l [m]. Returns (C, C): correlations.

    >>> correlation(np.array([[0.0, 0.0], [30.0, 40.0]]), 50.0).round(3)
    array([[1.   , 0.368],
           [0.368, 1.   ]])
    """
    distance = np.hypot(*(centre[:, None] - centre[None]).transpose(2, 0, 1))
    result: FloatArray = np.exp(-distance / length_m)
    return result


def likeliest_sizes(innovations: Innovations, errors: PriorErrors) -> ErrorSizes:
    """Return the sizes of greatest posterior density."""
    few = innovations.thinned()
    white_m = _sizes(errors.white, _WHITE_M)
    nodes = list(_nodes(few, errors))
    factors, of_factors = _levels(errors)
    every = np.array([_log_likelihood(few, node, white_m, factors) + node.log_prior for node in nodes])
    every += of_factors[:, None] + errors.white.log_density(white_m)
    logs = np.logaddexp.reduce(every, axis=1)
    top, column = np.unravel_index(int(np.argmax(logs)), logs.shape)
    weights = np.exp(logs - logs.max())
    of_levels = np.exp(every - every.max()).sum(axis=(0, 2))
    correlated = np.array([node.correlated_m for node in nodes])
    return ErrorSizes(
        float(white_m[column]),
        nodes[top].correlated_m,
        nodes[top].length_m,
        _log_spread(white_m, weights.sum(axis=0)),
        _log_spread(correlated, weights.sum(axis=1)),
        float(logs.max() + np.log(weights.sum() / _prior_mass(nodes, errors.white, white_m, of_factors))),
        float(np.exp(of_levels @ np.log(factors) / of_levels.sum())),
    )


class _Node(NamedTuple):
    correlated_m: float
    length_m: float
    log_prior: float
    covariance: FloatArray


def _sizes(scale: ErrorScale, grid_m: FloatArray) -> FloatArray:
    return np.array([scale.median_m]) if scale.is_known else grid_m


def _nodes(few: Innovations, errors: PriorErrors) -> Iterator[_Node]:
    """Yield the pairs of length and correlated size, each with the covariance of all but the white errors."""
    known = errors.correlated.is_known
    for factor in (1.0,) if known and errors.correlated.median_m == 0.0 else _LENGTH_FACTORS:
        length_m = factor * errors.correlation_m
        shape = correlation(few.centre, length_m)
        of_length = -0.5 * float(np.log(factor) / _LENGTH_LOG_SD) ** 2
        for size_m in _sizes(errors.correlated, _CORRELATED_M):
            of_size = float(errors.correlated.log_density(np.array(size_m)))
            yield _Node(float(size_m), length_m, of_length + of_size, few.covariance + size_m**2 * shape)


def _levels(errors: PriorErrors) -> tuple[FloatArray, FloatArray]:
    """Return factors of the offset's size, and their log densities."""
    if errors.level_log_sd == 0.0:
        return np.ones(1), np.zeros(1)
    return np.exp(errors.level_log_sd * _LEVELS), -0.5 * np.square(_LEVELS)


def _log_likelihood(few: Innovations, node: _Node, white_m: FloatArray, factors: FloatArray) -> FloatArray:
    """Return the log likelihood (F, W) of sizes of the offset and of the white error.

    An offset of size s adds s² 1 1ᵀ to a covariance A: its determinant grows by 1 + s² 1ᵀA⁻¹1, and the misfit falls by
    s² (1ᵀA⁻¹v)² over that (Sherman and Morrison 1950).
    """
    value, vector = np.linalg.eigh(0.5 * (node.covariance + node.covariance.T))
    turned, ones = vector.T @ few.value_m, vector.T @ np.ones(len(few.value_m))
    total = np.maximum(value, 0.0)[:, None] + white_m**2
    plain = np.sum(np.log(2.0 * np.pi * total) + (turned**2)[:, None] / total, axis=0)
    level_m2 = (few.level_sigma_m * factors[:, None]) ** 2
    grown = 1.0 + level_m2 * np.sum((ones**2)[:, None] / total, axis=0)
    explained = level_m2 * np.sum((ones * turned)[:, None] / total, axis=0) ** 2 / grown
    likelihood: FloatArray = -0.5 * (plain + np.log(grown) - explained)
    return likelihood


def _log_spread(sizes_m: FloatArray, weights: FloatArray) -> float:
    """Return the standard deviation of the logarithm of a size; 0 for one that is absent."""
    if sizes_m.max() == 0.0:
        return 0.0
    logs, share = np.log(sizes_m), weights / weights.sum()
    return float(np.sqrt(share @ np.square(logs - share @ logs)))


def _prior_mass(nodes: list[_Node], white: ErrorScale, white_m: FloatArray, of_factors: FloatArray) -> float:
    """Return the sum of the prior over the grid, so that the evidence does not depend on the number of nodes."""
    of_nodes = np.exp([node.log_prior for node in nodes]).sum()
    return float(of_nodes * np.exp(white.log_density(white_m)).sum() * np.exp(of_factors).sum())


# An offset beyond these many standard deviations is a conflict; so is a misfit less likely than this.
_SIGMAS, _LEAST_LIKELY = 3.0, 1e-3
# A fitted size of an error this many times larger than the product's is a conflict.
_TOO_LARGE = 3.0
# This share of priors have a level that their error model does not allow; the logarithm of such an offset is uniform
# between these sizes [m].
_WRONG_SHARE, _WRONG_M = 0.05, (0.1, 100.0)


class Level(NamedTuple):
    """Vertical offset of a prior from the points.

    `offset_m`: prior less points, by generalized least squares [m]. `sigma_m`: its standard deviation from
    points and cells [m]. `assumed_sigma_m`: standard deviation that the prior's error model allows for an
    offset [m].
    """

    offset_m: float
    sigma_m: float
    assumed_sigma_m: float

    @property
    def in_sigmas(self) -> float:
        """Offset over its expected standard deviation."""
        return abs(self.offset_m) / float(np.hypot(self.sigma_m, self.assumed_sigma_m))

    @property
    def is_conflict(self) -> bool:
        """Whether the offset is beyond three standard deviations."""
        return self.in_sigmas > _SIGMAS

    @property
    def probability(self) -> float:
        """Probability that the error model of the prior holds, and the points err by as much.

        By Bayes' rule against a wrong level: one in twenty priors has one, of any size from 0.1 to 100 m.
        """
        sigma_m = float(np.hypot(self.sigma_m, self.assumed_sigma_m))
        allowed = np.exp(-0.5 * self.in_sigmas**2) / (np.sqrt(2.0 * np.pi) * sigma_m)
        size_m = float(np.clip(abs(self.offset_m), *_WRONG_M))
        wrong = 1.0 / (2.0 * size_m * np.log(_WRONG_M[1] / _WRONG_M[0]))
        return float(allowed * (1.0 - _WRONG_SHARE) / (allowed * (1.0 - _WRONG_SHARE) + wrong * _WRONG_SHARE))


def level(innovations: Innovations, assumed_sigma_m: float) -> Level:
    """Return the vertical offset of cells whose covariance leaves an offset out.

    `assumed_sigma_m`: standard deviation that the error model allows for the offset [m].
    """
    factor = cho_factor(innovations.covariance, lower=True)
    ones = np.ones(len(innovations.value_m))
    weights = cho_solve(factor, ones)
    information = float(ones @ weights)
    return Level(float(weights @ innovations.value_m) / information, information**-0.5, assumed_sigma_m)


def conflicts(
    found: Level,
    innovations: Innovations,
    white_m: float,
    expected: ErrorScale,
    level_probability: float = 0.0,
) -> tuple[str, ...]:
    """Return one sentence for every conflict, with its size.

    `white_m`: independent error of a cell, as it was estimated [m]. Returns: empty where prior and points
    agree.
    """
    sentences = []
    if found.is_conflict:
        used = (
            f"counts with a probability of {100.0 * level_probability:.0f} %"
            if level_probability
            else "is not used"
        )
        sentences.append(
            f"the prior lies {abs(found.offset_m):.2f} m {'above' if found.offset_m > 0.0 else 'below'} the points, "
            f"{found.in_sigmas:.1f} standard deviations of what is expected; its level {used}, check its vertical datum."
        )
    if np.isfinite(expected.log_sd) and white_m > _TOO_LARGE * expected.median_m:
        sentences.append(
            f"the prior's cells differ from the points by {white_m:.2f} m each, and {expected.median_m:.2f} m was expected of this "
            "class of product; they count with the larger value."
        )
    chance = misfit_chance(innovations)
    if not found.is_conflict and chance < _LEAST_LIKELY:
        sentences.append(
            f"the prior's cells contradict the points (chance {chance:.1e} under the error model); check place, date and "
            "class of the prior."
        )
    return tuple(sentences)


def misfit_chance(innovations: Innovations) -> float:
    """Return the chance that cells differ from the points by as much, by their χ²."""
    value: FloatArray = innovations.value_m
    squared = float(value @ cho_solve(cho_factor(innovations.covariance, lower=True), value))
    return float(chdtrc(len(value), squared))


def misfit_log_likelihood(innovations: Innovations) -> float:
    """Return the log likelihood of cells with an offset, up to a constant.

    Returns: log density of the innovations [nats].
    """
    factor, value = cho_factor(innovations.with_level, lower=True), innovations.value_m
    return float(-0.5 * value @ cho_solve(factor, value) - np.log(np.diag(factor[0])).sum())
