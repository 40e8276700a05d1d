"""Volume changes over outlines, with errors carried over from the unchanged ground."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.core.map_scale import MapScale, areal_factors, ground_area_m2
from survey.data.dem import Dem
from survey.scoring.change.results import SIGNIFICANT, VolumeChange
from survey.scoring.change.variogram import Variogram, error_of_sum

LEAST_KNOWN_SHARE = 0.5
"""An outline of which both surveys map less than this share is refused."""


class ChangeErrors(NamedTuple):
    """Errors of a difference raster.

    Parameters
    ----------
    relative : (H, W) ndarray
        Standard deviation of each cell relative to the mean.
    known, unchanged : (H, W) ndarray of bool
        Cells that both surveys map, and those from which the errors were estimated.
    variogram : Variogram
        Of the errors over their relative deviation; distances on the ground.
    is_levelled : bool
        The mean difference of the unchanged ground was subtracted.
    """

    relative: FloatArray
    known: BoolArray
    unchanged: BoolArray
    variogram: Variogram
    is_levelled: bool


class OutlineVolumes:
    """Integrals of a difference raster over outlines.

    Parameters
    ----------
    difference : Dem
        Later minus earlier [m].
    errors : ChangeErrors
        Of the same raster.
    """

    def __init__(self, difference: Dem, errors: ChangeErrors) -> None:
        self.difference = difference
        self.errors = errors

    @cached_property
    def ground(self) -> FloatArray:
        """Ground area of each cell over its grid area (H, W)."""
        grid = self.difference.grid()
        return 1.0 / areal_factors(grid.crs, grid.x, grid.y)

    @cached_property
    def ground_step_m(self) -> float:
        """Mean width of a cell on the ground [m]."""
        return ground_step_m(self.difference)

    def over(self, name: str, shape: Polygon | MultiPolygon, inside: BoolArray) -> VolumeChange:
        """Return the change over an outline whose cells are `inside` (H, W).

        Raises
        ------
        InputError
            Both surveys map less than half of the outline.
        """
        used = inside & self.errors.known
        share = self._known_share(name, shape, inside)
        weights = np.where(used, self.ground, 0.0)
        weights /= weights.sum()
        heights = self.difference.elevation
        mean = float((weights[used] * heights[used]).sum())
        error = error_of_sum(
            self._error_weights(weights), self.errors.variogram, self.errors.unchanged, self.ground_step_m
        )
        # Ground that a survey did not map may have changed otherwise, by as much as the mapped part varies.
        unseen = (1.0 - share) * float(heights[used].std()) if share < 1.0 - 1e-6 else 0.0
        area = ground_area_m2(self.difference.crs, shape)
        return VolumeChange(
            name,
            area,
            share,
            mean,
            mean * area,
            float(np.hypot(error.std, unseen)) * area,
            float(np.hypot(error.half_width_95, SIGNIFICANT * unseen)) * area,
            self._naive_std_m(weights[used], used) * area,
        )

    def _known_share(self, name: str, shape: Polygon | MultiPolygon, inside: BoolArray) -> float:
        """Return the share of an outline that both surveys map; refuses less than a half."""
        on_raster = float(shape.intersection(shapely.box(*self.difference.bounds)).area / shape.area)
        share = float((inside & self.errors.known).sum()) / float(inside.sum()) * on_raster
        if share < LEAST_KNOWN_SHARE:
            raise InputError(
                f"both surveys map {share:.0%} of the outline {name!r}; {LEAST_KNOWN_SHARE:.0%} are needed for a volume."
            )
        return share

    def _error_weights(self, weights: FloatArray) -> FloatArray:
        """Return the weights of the errors of all cells in an outline's mean, less that of the unchanged ground."""
        relative, known, unchanged, _, is_levelled = self.errors
        weighted = weights * relative
        if is_levelled:
            calm = unchanged / relative**2
            weighted = weighted - calm / calm.sum() * relative
        return np.where(known, weighted, 0.0)

    def _naive_std_m(self, weights: FloatArray, used: BoolArray) -> float:
        """Return the standard deviation of the mean if the errors of all cells were independent [m]."""
        squares = (weights * self.errors.relative[used]) ** 2
        return float(np.sqrt(self.errors.variogram.variance_m2 * squares.sum()))


def ground_step_m(dem: Dem) -> float:
    """Return the mean width of a raster's cells on the ground [m]."""
    return dem.step_m / MapScale.over(dem.crs, dem.bounds).linear.mean
