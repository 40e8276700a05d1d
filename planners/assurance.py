r"""How sure it is that a map will meet a limit, over all that the terrain may be.

What is not known of the terrain is a set of covariances, each with a weight (`Belief`): learned from the
cells of a coarse prior, or from the survey itself. For each of them the mean squared error of the map over M nodes is a
weighted sum of squared normal numbers. Its mean and variance follow from the posterior covariance C,

.. math::  E = \frac{1}{M} \mathrm{tr}\, C, \qquad V = \frac{2}{M^2} \mathrm{tr}\, C^2

and the chance that it stays below the squared limit is that of the gamma distribution with the same two
moments (Satterthwaite 1946).
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.spatial.distance import cdist
from scipy.special import gammainc, gammaln

from planners.wavy import slope_length_m
from survey.area import SurveyArea
from survey.arrays import FloatArray
from survey.errors import InputError
from survey.reconstruction.gp.kernel_search import ALL, Cell, KernelSearch
from survey.reconstruction.gp.kernels import Kernel
from survey.reconstruction.gp.stationary import Stationary
from survey.terrain.conditional import CoarseCells

_NODES_ALONG = 12
_MOST_REMEMBERED = 100
# Samples nearer to one another than this share of the slope length are averaged.
_AVERAGED = 0.2
_LENGTHS_PER_DOUBLING = 2
# Four covariances hold nearly all of what the samples leave open.
_MOST_KERNELS = 4
_LEAST_WEIGHT = 0.01


def localized_noise_m(noise_m: float, localization_m: float, kernel: Kernel) -> float:
    r"""Return the error of a sample whose place errs too, east and north by `localization_m` each [m].

    .. math::  \sigma^2 + 2 \, \sigma_{xy}^2 \, v / \lambda^2

    with the variance v of the terrain and its slope length λ, so that v/λ² is the variance of each slope.
    This is the one place where errors of the rover's place enter a predicted error; they are taken
    as independent from sample to sample.

    Examples
    --------
    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> round(localized_noise_m(0.1, 1.0, SquaredExponential(25.0, 100.0)), 3)
    0.122
    """
    slope_variance = kernel.variance_m2 / slope_length_m(kernel) ** 2
    return float(np.sqrt(noise_m**2 + 2.0 * localization_m**2 * slope_variance))


class Believed(NamedTuple):
    """A covariance that the terrain may have, the error of a sample under it [m], and its weight."""

    cell: Cell
    variance_m2: float
    noise_m: float
    weight: float

    @property
    def kernel(self) -> Stationary:
        """The covariance function [m²]."""
        return self.cell.kernel(self.variance_m2)


@dataclass(frozen=True)
class Belief:
    """Covariances that the terrain may have, the weightiest first; weights sum to 1."""

    kernels: tuple[Believed, ...]

    @classmethod
    def of(cls, found: list[Believed]) -> "Belief":
        """Keep the weightiest, and scale their weights."""
        order = sorted(found, key=lambda one: -one.weight)
        kept = [one for one in order[:_MOST_KERNELS] if one.weight > _LEAST_WEIGHT * order[0].weight]
        total = sum(one.weight for one in kept)
        return cls(tuple(one._replace(weight=one.weight / total) for one in kept))

    @property
    def likeliest(self) -> Believed:
        """The weightiest covariance."""
        return self.kernels[0]

    @cached_property
    def slope_length_m(self) -> float:
        """Weighted geometric mean of the slope lengths: what waves are measured by [m]."""
        logs = [one.weight * np.log(slope_length_m(one.kernel)) for one in self.kernels]
        return float(np.exp(np.sum(logs)))

    def draw(self, rng: np.random.Generator) -> Believed:
        """Return one of the covariances by chance."""
        weights = [one.weight for one in self.kernels]
        return self.kernels[int(rng.choice(len(weights), p=weights))]


def belief_from_prior(cells: CoarseCells, *, noise_m: float, localization_m: float = 0.0) -> Belief:
    """Learn covariances from the cells of a coarse prior, all families equally likely beforehand.

    Parameters
    ----------
    cells : CoarseCells
        Coarse elevations and their error.
    noise_m, localization_m : float
        Errors of the samples to come, and of their places [m].

    Notes
    -----
    Cells show nothing finer than themselves: how rough the terrain is between them is
    extrapolated through the families, and no more than that.
    """
    height = cells.height_m - cells.height_m.mean()
    extent = float(np.ptp(cells.places.reshape(-1, 2), axis=0).max())
    lengths = np.exp2(np.arange(np.log2(extent / 16.0), np.log2(2.0 * extent), 1.0 / _LENGTHS_PER_DOUBLING))
    variances = float(height.var()) * np.exp2(np.arange(-3.0, 8.0))
    found, logs = [], []
    for family in ALL:
        for length in lengths:
            cell = Cell.of(family, float(length), 0.0)
            unit = cells.covariance(cell.kernel(1.0))
            for variance in variances.tolist():
                noise = localized_noise_m(noise_m, localization_m, cell.kernel(variance))
                logs.append(_log_likelihood(variance * unit, cells.sigma_m, height))
                found.append(Believed(cell, variance, noise, 0.0))
    weights = np.exp(np.array(logs) - np.max(logs)).tolist()
    return Belief.of([one._replace(weight=weight) for one, weight in zip(found, weights, strict=True)])


def _log_likelihood(covariance: FloatArray, sigma_m: float, height: FloatArray) -> float:
    """Restricted log likelihood of the cells' heights, their constant mean integrated out."""
    n = len(height)
    matrix = covariance.copy()
    matrix[np.diag_indices(n)] += sigma_m**2 + 1e-6 * matrix[0, 0]
    factor, failed = lapack.dpotrf(matrix.T, lower=1, clean=1)
    if failed:
        return -np.inf
    half = lapack.dtrtrs(factor, np.column_stack([np.ones(n), height]), lower=1)[0]
    ones, rest = half[:, 0], half[:, 1]
    weight = float(ones @ ones)
    about = rest - ones * (ones @ rest / weight)
    return float(-0.5 * (about @ about) - np.log(np.diag(factor)).sum() - 0.5 * np.log(weight))


def belief_from_survey(
    xy: FloatArray, heights: FloatArray, *, noise_m: float, localization_m: float = 0.0
) -> Belief:
    """Learn family, length scale, variance and noise from the samples of a survey.

    Parameters
    ----------
    xy, heights : (N, 2) and (N,) ndarray
        Places and measured heights [m].
    noise_m, localization_m : float
        Stated errors of a sample, and of its place [m]; the fit may depart from them by some 20 %.
    """
    stated = max(noise_m, 1e-6)
    search = KernelSearch(xy, heights[:, None], stated, ALL)
    if localization_m > 0.0:
        stated = localized_noise_m(stated, localization_m, search.found()[0].kernel)
        search = KernelSearch(xy, heights[:, None], stated, ALL)
    return Belief.of(
        [Believed(one.cell, one.variance_m2, one.noise_m, weight) for one, weight in search.plausible()]
    )


class Assured(NamedTuple):
    """Chance that the map meets the limit, and its expected root mean square error [m]."""

    probability: float
    rmse_m: float


@dataclass(frozen=True, eq=False)
class Assurance:
    """Tells how sure it is that samples at given places make a map within a limit.

    Parameters
    ----------
    area : SurveyArea
        Where the map is judged: at the centres of 12 cells along its longer side.
    limit_m : float
        Largest root mean square error allowed [m].
    step_m : float
        Distance between samples [m].
    """

    area: SurveyArea
    limit_m: float
    step_m: float
    _correlations: dict[Cell, FloatArray] = field(default_factory=dict, repr=False)

    @cached_property
    def nodes(self) -> FloatArray:
        """Places (M, 2) on the free ground [m]."""
        xmin, ymin, xmax, ymax = self.area.bounds
        cell = max(xmax - xmin, ymax - ymin) / _NODES_ALONG
        x = np.arange(xmin + 0.5 * cell, xmax, cell)
        y = np.arange(ymin + 0.5 * cell, ymax, cell)
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside: FloatArray = nodes[self.area.contains(nodes)]
        if not len(inside):
            raise InputError("the area is so thin that no node of its map lies on free ground; widen it.")
        return inside

    def _among_nodes(self, cell: Cell) -> FloatArray:
        """Correlation (M, M) of the nodes, which every plan under this covariance needs."""
        if cell not in self._correlations:
            if len(self._correlations) >= _MOST_REMEMBERED:
                self._correlations.clear()
            self._correlations[cell] = cell.correlation(cdist(self.nodes, self.nodes, "sqeuclidean"))
        return self._correlations[cell]

    def of(self, xy: FloatArray, belief: Belief) -> Assured:
        """Return what samples at the places (N, 2) [m] promise."""
        thin = max(int(_AVERAGED * belief.slope_length_m / self.step_m), 1)
        places = xy[::thin]
        across = cdist(places, self.nodes, "sqeuclidean")
        each = [self._under(one, places, across, thin) for one in belief.kernels]
        weights = np.array([one.weight for one in belief.kernels])
        return Assured(
            float(weights @ [one.probability for one in each]),
            float(weights @ [one.rmse_m for one in each]),
        )

    def _under(self, believed: Believed, places: FloatArray, across: FloatArray, thin: int) -> Assured:
        """Return what is promised if the terrain has this covariance; each place stands for `thin` samples."""
        ratio = believed.noise_m**2 / thin / believed.variance_m2
        cell = Cell.of(believed.cell.family, believed.cell.length_scale_m, ratio)
        factor = cell.factor(places)
        if factor is None:
            return Assured(0.0, float(np.sqrt(believed.variance_m2)))
        right = np.column_stack([np.ones(len(places)), cell.correlation(across)])
        half = lapack.dtrtrs(factor, right, lower=1)[0]
        ones, explained = half[:, 0], half[:, 1:]
        gap = 1.0 - ones @ explained
        posterior = self._among_nodes(cell._replace(ratio=0.0)) - explained.T @ explained
        posterior += np.outer(gap, gap) / (ones @ ones)
        posterior *= believed.variance_m2
        m = len(posterior)
        mean = max(float(np.trace(posterior)) / m, 1e-12)
        variance = max(2.0 * float(np.square(posterior).sum()) / m**2, 1e-6 * mean**2)
        shape = mean**2 / variance
        # The mean of the square root of a gamma distributed number.
        rmse = np.exp(gammaln(shape + 0.5) - gammaln(shape)) * np.sqrt(mean / shape)
        return Assured(float(gammainc(shape, shape * self.limit_m**2 / mean)), float(rmse))
