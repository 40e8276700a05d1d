r"""Error budget of a mass balance from two surveys.

The standard deviation of the mean change of height has these parts, each of both surveys:

- interpolation: what the maps between the swaths leave open of the area's mean height,

  .. math::  \bar v = \overline{k} - \bar k^T K^{-1} \bar k + (1 - 1^T K^{-1} \bar k)^2 / (1^T K^{-1} 1)

  with the means of the covariance k over the area (block kriging; Journel and Huijbregts 1978). Relief is taken to be
  another one at the second date, as on ice that has flowed and melted;
- shared: the error that all samples of a survey share, or what two stakes leave of it;
- duration: melt while a survey lasts T days, :math:`0.3 \, \dot h \, T / \sqrt{12}`, its rate known to 30 %;
- flow: the mean vertical motion of the ice.

Each of K stakes measures melt and flow by itself, which divides their errors by :math:`\sqrt{1 + K}`; five to ten stakes
are found to be enough on small glaciers (Fountain and Vecchia 1999, Geografiska Annaler A 81, 563). The error of the
density is added for a mass balance.
"""

from typing import NamedTuple

import numpy as np

from planners.guarantee.posterior.kernel_posterior import KernelPosterior, WeightedKernel
from planners.guarantee.stakes import STAKED_M
from planners.season.config import SEASON_SURFACES, SeasonConfig
from survey.core.arrays import FloatArray

CONFIDENCE = 1.96
"""Standard deviations in half of a 95 % interval."""

_MOST_SAMPLES = 1000
_RATE_SHARE = 0.3
_DAYS_OF_YEAR = 365.25


class ErrorBudget(NamedTuple):
    """Standard deviations of the mean change of height by cause, and of its mass by density [m, m w.e.]."""

    interpolation_m: float
    shared_m: float
    duration_m: float
    flow_m: float
    density_m_we: float

    @property
    def height_m(self) -> float:
        """Standard deviation of the mean change of height [m]."""
        return float(np.sqrt(sum(part**2 for part in self[:4])))

    def error(self, config: SeasonConfig) -> float:
        """Return half the 95 % interval, in the unit of what is wanted."""
        if config.unit == "%":
            return 100.0 * CONFIDENCE * self.height_m / config.change_m
        water_m = self.height_m * config.density_kg_m3 / 1000.0
        return CONFIDENCE * float(np.hypot(water_m, self.density_m_we))


def budget_of(config: SeasonConfig, mean_error_m: float, n_stakes: int, n_days: float) -> ErrorBudget:
    """Return the error budget of two surveys of a design.

    Parameters
    ----------
    config : SeasonConfig
        Melt, flow, density, and errors of the samples.
    mean_error_m : float
        Standard deviation of the area's mean height in one survey [m].
    n_stakes : int
        Number of stakes.
    n_days : float
        Days that one survey takes.

    Returns
    -------
    ErrorBudget
        By cause.
    """
    surface = SEASON_SURFACES[config.surface]
    both, known = np.sqrt(2.0), np.sqrt(1.0 + n_stakes)
    shared_m = min(config.shared_m, STAKED_M) if n_stakes >= 2 else config.shared_m
    return ErrorBudget(
        float(both * mean_error_m),
        float(both * shared_m),
        float(both * _RATE_SHARE * config.melt_m_day * n_days / np.sqrt(12.0) / known),
        float(config.emergence_m_year * config.n_days / _DAYS_OF_YEAR / known),
        surface.density_std_kg_m3 / 1000.0 * config.change_m,
    )


def mean_error_m(xy: FloatArray, nodes: FloatArray, posterior: KernelPosterior) -> float:
    """Return the standard deviation of the mean height over nodes, from samples at places [m].

    Parameters
    ----------
    xy : (N, 2) ndarray
        Places of the samples [m]; where there are more than 1000, fewer stand for all, with less noise.
    nodes : (M, 2) ndarray
        Places that are spread evenly over the area [m].
    posterior : KernelPosterior
        Covariances that the terrain may have.

    Returns
    -------
    float
        Weighted over the covariances, with the mean square of the posterior's factor of the error as if it were
        log-normal.
    """
    every = max(int(np.ceil(len(xy) / _MOST_SAMPLES)), 1)
    parts = [one.weight * _mean_variance_m2(xy[::every], nodes, one, every) for one in posterior.kernels]
    return float(np.sqrt(sum(parts)) * np.exp(posterior.spread**2))


def _mean_variance_m2(xy: FloatArray, nodes: FloatArray, one: WeightedKernel, every: int) -> float:
    """Return the variance of the mean height over nodes under one covariance [m²]."""
    kernel = one.kernel
    matrix = kernel.covariance(xy, xy)
    noise_m2 = max(one.noise_m**2 / every, 1e-8 * one.variance_m2)
    matrix[np.diag_indices(len(matrix))] += noise_m2
    mean = kernel.covariance(xy, nodes).mean(axis=1)
    solved = np.linalg.solve(matrix, np.column_stack([np.ones(len(xy)), mean]))
    gap = 1.0 - float(mean @ solved[:, 0])
    left = float(kernel.covariance(nodes, nodes).mean()) - float(mean @ solved[:, 1])
    # Relief finer than samples is another at each node.
    unseen = one.unseen_m2 / len(nodes)
    return max(left, 0.0) + gap**2 / float(solved[:, 0].sum()) + unseen
