"""Mean functions of the terrain: constants, functions and coarse elevation models."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, QhullError

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem

# Half the arm of the central difference that gives a mean's slope [m].
_ARM_M = 0.5


class Mean(ABC):
    """The expected surface."""

    @abstractmethod
    def at(self, xy: FloatArray) -> FloatArray:
        """Return the expected heights at the places (N, 2), as (N,) [m].

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray
            Height [m].
        """

    def covers(self, xy: FloatArray) -> BoolArray:
        """Return at which places (N, 2) the mean is defined, as (N,); everywhere unless overridden.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray of bool
            True where the mean is defined.
        """
        return np.ones(len(xy), dtype=bool)

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (N, 2) to the east and to the north [m/m], by differences over a metre.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N, 2) ndarray
            Slopes to the east and to the north [m/m].
        """
        arms = _ARM_M * np.eye(2)
        return np.stack([(self.at(xy + arm) - self.at(xy - arm)) / (2 * _ARM_M) for arm in arms], axis=-1)


@dataclass(frozen=True)
class ConstantMean(Mean):
    """A horizontal plane at a known height [m].

    Parameters
    ----------
    value_m : float
        Height of the plane [m].

    Examples
    --------
    >>> ConstantMean(3.0).at(np.zeros((2, 2)))
    array([3., 3.])
    """

    value_m: float

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the height.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray
            Height [m].
        """
        return np.full(len(xy), self.value_m)


@dataclass(frozen=True)
class FunctionMean(Mean):
    """Any function of places (N, 2) that returns heights (N,) [m].

    Parameters
    ----------
    function : callable
        Takes places (N, 2) [m] and returns heights (N,) [m].

    Examples
    --------
    >>> FunctionMean(lambda xy: xy[:, 0]).at(np.array([[4.0, 0.0]]))
    array([4.])
    """

    function: Callable[[FloatArray], FloatArray]

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the function's heights; refuse what is no height for every place.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray
            Height [m].
        """
        heights = np.asarray(self.function(xy), dtype=np.float64)
        if heights.shape != (len(xy),) or not np.isfinite(heights).all():
            raise InputError(
                f"the mean function returned the shape {heights.shape} or values that are not finite for {len(xy)} "
                "places; it must give one finite height for each."
            )
        return heights


@dataclass(frozen=True)
class DemMean(Mean):
    """A coarse elevation model, read between its cell centres.

    Parameters
    ----------
    dem : Dem
        The prior.
    interpolation : {"bilinear", "delaunay"}
        Between the four nearest centres, or in the triangles between centres as the
        glacier paper has it. Within the outer half cell both go on linearly.

    Raises
    ------
    InputError
        On evaluation at a place that the prior does not cover.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> prior = Dem.on(Grid((0.0, 0.0, 2.0, 2.0), 1.0), np.arange(9.0).reshape(3, 3))
    >>> DemMean(prior).at(np.array([[0.5, 2.0]]))
    array([0.5])
    """

    dem: Dem
    interpolation: Literal["bilinear", "delaunay"] = "bilinear"

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope (N, 2); within an arm of the prior's rim that of the nearest inner place.

        Beside a void it is that towards the side with heights, and 0 where neither side has them.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N, 2) ndarray
            Slopes to the east and to the north [m/m].
        """
        xmin, ymin, xmax, ymax = self.dem.bounds
        inner = np.clip(xy, [xmin + _ARM_M, ymin + _ARM_M], [xmax - _ARM_M, ymax - _ARM_M])
        inner = np.where(self.covers(inner)[:, None], inner, xy)
        return np.stack([self._slope(inner, arm) for arm in _ARM_M * np.eye(2)], axis=-1)

    def _slope(self, xy: FloatArray, arm: FloatArray) -> FloatArray:
        """Return the slope along an arm (N,) by the ends of it that have heights."""
        ahead, behind = self.covers(xy + arm), self.covers(xy - arm)
        rise = self.at(np.where(ahead[:, None], xy + arm, xy)) - self.at(
            np.where(behind[:, None], xy - arm, xy)
        )
        n_arms = ahead.astype(np.float64) + behind
        return rise / (_ARM_M * np.maximum(n_arms, 1.0))

    def covers(self, xy: FloatArray) -> BoolArray:
        """Return which places (N, 2) the prior covers, as (N,).

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray of bool
            True where the prior has a height.
        """
        return np.isfinite(self.dem.at(xy))

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the prior's heights [m].

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray
            Height [m].
        """
        heights = self.dem.at(xy)
        if self.interpolation == "delaunay":
            triangular = _triangles(self.dem)(xy)
            heights = np.where(np.isfinite(triangular), triangular, heights)
        missing = ~np.isfinite(heights)
        if missing.any():
            where = xy[missing][0]
            raise InputError(
                f"the prior does not cover {int(missing.sum())} of {len(xy)} places, the first at "
                f"({where[0]:.1f}, {where[1]:.1f}); take a prior that covers the grid and the points, or a smaller grid."
            )
        return heights


def _triangles(dem: Dem) -> LinearNDInterpolator:
    known = np.isfinite(dem.elevation).ravel()
    try:
        mesh = Delaunay(dem.xy[known])
    except QhullError as error:
        raise InputError("the prior's valid cells lie on one line; give a prior of an area.") from error
    return LinearNDInterpolator(mesh, dem.elevation.ravel()[known])
