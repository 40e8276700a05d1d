"""What the surface is expected to be before any point is measured."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, QhullError

from survey.arrays import FloatArray
from survey.dem import Dem
from survey.errors import InputError


class Mean(ABC):
    """The expected surface: a known part and a trend with free coefficients."""

    n_trend: int = 0

    @abstractmethod
    def at(self, xy: FloatArray) -> FloatArray:
        """Return the known part at the places (N, 2), as (N,) [m]."""

    def trend(self, xy: FloatArray) -> FloatArray:
        """Return the free terms at the places (N, 2), as (N, n_trend)."""
        return np.zeros((len(xy), 0))


@dataclass(frozen=True)
class ConstantMean(Mean):
    """A horizontal plane; its height is found by generalised least squares unless given [m].

    Examples
    --------
    >>> ConstantMean(3.0).at(np.zeros((2, 2)))
    array([3., 3.])
    """

    value_m: float | None = None

    @property
    def n_trend(self) -> int:  # type: ignore[override]
        """Number of free coefficients."""
        return int(self.value_m is None)

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the height given, or 0."""
        return np.full(len(xy), self.value_m or 0.0)

    def trend(self, xy: FloatArray) -> FloatArray:
        """Return a column of ones, unless the height was given."""
        return np.ones((len(xy), self.n_trend))


@dataclass(frozen=True)
class PlaneMean(Mean):
    """A tilted plane through generalised least squares, told about `centre` at `scale_m`.

    Examples
    --------
    >>> PlaneMean((0.0, 0.0), 10.0).trend(np.array([[10.0, 5.0]]))
    array([[1. , 1. , 0.5]])
    """

    centre: tuple[float, float]
    scale_m: float
    n_trend: int = 3

    def at(self, xy: FloatArray) -> FloatArray:
        """Return 0: the whole plane is free."""
        return np.zeros(len(xy))

    def trend(self, xy: FloatArray) -> FloatArray:
        """Return 1, easting and northing, the latter two scaled."""
        return np.column_stack([np.ones(len(xy)), (xy - np.array(self.centre)) / self.scale_m])


@dataclass(frozen=True)
class FunctionMean(Mean):
    """Any function of places (N, 2) that returns heights (N,) [m].

    Examples
    --------
    >>> FunctionMean(lambda xy: xy[:, 0]).at(np.array([[4.0, 0.0]]))
    array([4.])
    """

    function: Callable[[FloatArray], FloatArray]

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the function's heights; refuse what is no height for every place."""
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
    >>> from survey.grid import Grid
    >>> prior = Dem.on(Grid((0.0, 0.0, 2.0, 2.0), 1.0), np.arange(9.0).reshape(3, 3))
    >>> DemMean(prior).at(np.array([[0.5, 2.0]]))
    array([0.5])
    """

    dem: Dem
    interpolation: Literal["bilinear", "delaunay"] = "bilinear"

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the prior's heights [m]."""
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
