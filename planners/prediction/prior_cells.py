"""Cells of a coarse prior, of which the map takes means of the terrain with their errors.

A prediction needs their places and errors, not their heights. The errors are those that `reconstruct` assumes of a product
of no stated class: independent from cell to cell, correlated over 250 m, and a level that all cells share.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from survey import Dem, InputError, SurveyArea
from survey.core import FloatArray
from survey.reconstruction.prior import PRODUCTS

_GAUSS = 0.5 / np.sqrt(3.0)
_SIGNS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
_CORRELATION_M = PRODUCTS["unknown"].correlation_m
_MOST_FOR_LEVEL = 400


@dataclass(frozen=True, eq=False)
class PriorCells:
    """Cells of a prior that are measurements of means of the terrain.

    `centre` (C, 2): easting and northing [m]. `cell_m`: width of a cell [m]. `sigma_m`: standard deviation of its
    independent error, of the correlated one and of the common level [m].
    """

    centre: FloatArray
    cell_m: float
    sigma_m: float

    @classmethod
    def of(cls, prior: Dem, area: SurveyArea, sigma_m: float) -> Self:
        """Take the known cells that meet the bounds of an area."""
        xmin, ymin, xmax, ymax = area.bounds
        half = 0.5 * prior.step_m
        try:
            near = prior.window((xmin - half, ymin - half, xmax + half, ymax + half))
        except InputError:
            near = prior
        return cls(near.xy[np.isfinite(near.elevation).ravel()], prior.step_m, sigma_m)

    def nearest(self, place: FloatArray, n: int) -> "PriorCells":
        """Return the cells nearest to a place (2,), at most n."""
        if len(self) <= n:
            return self
        return replace(self, centre=self.centre[self._tree.query(place, n)[1]])

    def spread(self, n: int) -> "PriorCells":
        """Return at most n cells, evenly taken."""
        return replace(self, centre=self.centre[np.unique(np.linspace(0, len(self) - 1, n).astype(int))])

    def farthest_m(self, place: FloatArray) -> float:
        """Return the distance of the farthest cell from a place (2,) [m]."""
        return float(np.hypot(*(self.centre - place).T).max())

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.centre)

    @cached_property
    def nodes(self) -> FloatArray:
        """Gauss nodes (4 C, 2) whose mean is that over a cell, those of one cell beside one another [m]."""
        nodes: FloatArray = (self.centre[:, None] + _GAUSS * self.cell_m * _SIGNS).reshape(-1, 2)
        return nodes

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the cells' errors (C, C) [m²]."""
        covariance: FloatArray = self.sigma_m**2 * self._covariance_of_unit
        return covariance

    @cached_property
    def _covariance_of_unit(self) -> FloatArray:
        """Covariance (C, C) of the cells' errors if each of the three had a standard deviation of 1."""
        covariance: FloatArray = (
            1.0 + np.exp(-cdist(self.centre, self.centre) / _CORRELATION_M) + np.eye(len(self))
        )
        return covariance

    @cached_property
    def level_m(self) -> float:
        """Standard deviation of the level of a map that the cells alone hold: that of their best mean error [m]."""
        some = self.spread(_MOST_FOR_LEVEL)
        return float(
            self.sigma_m / np.sqrt(np.linalg.solve(some._covariance_of_unit, np.ones(len(some))).sum())
        )

    def __len__(self) -> int:
        return len(self.centre)


def mean_of_four(values: FloatArray) -> FloatArray:
    """Return the means (C, N) of each four rows (4 C, N): of what holds at the nodes of cells, that of the cells."""
    means: FloatArray = values.reshape(-1, 4, values.shape[1]).mean(axis=1)
    return means
