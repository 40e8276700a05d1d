"""Averages of maps that were made with several kernels, or with two levels of the prior."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.reconstruction.checks.predictive import HeldOut


class MapFields(Protocol):
    """Map that gives heights and standard deviations on grids."""

    def fields(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m]."""


def mixture(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray], share: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of a mixture of two normal distributions.

    Parameters
    ----------
    first, second : tuple of ndarray
        Means and standard deviations of both.
    share : float
        Probability of the second.

    Examples
    --------
    >>> one, other = (np.zeros(1), np.ones(1)), (np.full(1, 2.0), np.ones(1))
    >>> [values.round(3).tolist() for values in mixture(one, other, 0.5)]
    [[1.0], [1.414]]
    """
    (mean, std), (other, other_std) = first, second
    variance = (1.0 - share) * std**2 + share * other_std**2 + share * (1.0 - share) * (other - mean) ** 2
    return mean + share * (other - mean), np.sqrt(variance)


@dataclass(frozen=True)
class MapAverage:
    """Maps with several kernels, to correct the map with one of them for what is not known of the kernel.

    Parameters
    ----------
    reference : MapFields
        Coarse map with the kernel of the map that is corrected.
    others : tuple of MapFields
        Coarse maps with all kernels.
    weights : (K,) ndarray
        Their probabilities.
    held_out : HeldOut, optional
        Swaths that the average predicts without their points; None where the drive has fewer than two.
    """

    reference: MapFields
    others: tuple[MapFields, ...]
    weights: FloatArray
    held_out: HeldOut | None = None

    def applied(self, grid: Grid, mean: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m] of a map, averaged over the kernels.

        The variance is the mean of the variances and the variance of the means.

        Parameters
        ----------
        grid : Grid
            Nodes of the map.
        mean, std : (H, W) ndarray
            Height and standard deviation with the kernel of the reference [m].
        """
        before, claimed = self.reference.fields(grid)
        every = [one.fields(grid) for one in self.others]
        heights, deviations = (np.array([fields[k] for fields in every]) for k in (0, 1))
        average = np.tensordot(self.weights, heights, axes=1)
        variance = np.tensordot(self.weights, deviations**2 + (heights - average) ** 2, axes=1)
        return mean + average - before, std * np.sqrt(variance) / claimed
