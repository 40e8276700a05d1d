"""Interface of terrain models: fit, update, predict, sample, save and load."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np
import numpy.typing as npt

from survey.core import FloatArray, InputError, checked
from survey.data import Grid, SurfacePoints

if TYPE_CHECKING:
    pass
from survey.reconstruction.terrain_map import SIGMAS_95, Reconstruction

Quantity = Literal["mean", "std", "lower", "upper", "support"]


class Capabilities(NamedTuple):
    """What a terrain model can be asked."""

    std: bool = True
    """It states a standard deviation, and with it lower and upper bounds."""
    samples: bool = True
    """It draws surfaces that agree with the points."""
    online: bool = True
    """New points cost what they are, not what all points before them were."""
    rays: bool = False
    """It uses the sensor's place: lines of sight, or a map that follows the sensor."""


class TerrainModel(ABC):
    """A surface that learns from points and can be asked anywhere.

    The constructor stores settings; `fit` checks, learns, and returns the model; `update`
    returns a model conditioned on more points. Ask the model returned: large ones take the
    points into their own arrays, so that the one before has changed too.

    Points carry their standard deviations and, where they have them, the sensor's origins.
    They hold no NaN and neither do places. Where a model is silent, beyond the ground that
    it covers, it answers NaN, and `UNSEEN` for the support. Heights are stored relative to a
    local datum (`local_datum_m`), so that adding 1,000 m to every point adds it to the map
    and changes nothing else.
    """

    capabilities: ClassVar[Capabilities]

    @abstractmethod
    def fit(self, points: SurfacePoints) -> Self:
        """Learn from points, and return the model."""

    @abstractmethod
    def update(self, points: SurfacePoints) -> Self:
        """Return a model conditioned on these points too."""

    def predict(self, xy: npt.ArrayLike, what: Quantity = "mean") -> FloatArray:
        """Return one quantity at places.

        `xy` (N, 2): easting and northing [m]. `what`: height [m], its standard deviation [m], the bounds of a
        95 % interval [m], or the support code. Returns (N,): NaN where the model is silent.
        """
        places = checked(xy, (None, 2), "the places to predict")
        if what not in get_args(Quantity):
            raise InputError(f"{what!r} is not known; ask for {', '.join(get_args(Quantity))}.")
        if what == "mean":
            return self._height(places)
        if what == "support":
            return self._support(places).astype(np.float64)
        if not self.capabilities.std:
            raise InputError(
                f"a {type(self).__name__} states no {what}; ask it for mean or support, or take another model."
            )
        return self._std(places) if what == "std" else self._bound(places, what)

    @abstractmethod
    def grid(self, grid: Grid) -> Reconstruction:
        """Return the map on the nodes of a grid."""

    @abstractmethod
    def sample(self, grid: Grid, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n surfaces (n, H, W) [m] that agree with the points.

        Returns (n, H, W): elevations [m].
        """

    @abstractmethod
    def save(self, path: str | Path) -> None:
        """Write the model to one file."""

    @classmethod
    @abstractmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote."""

    @abstractmethod
    def _height(self, xy: FloatArray) -> FloatArray:
        """Return the most likely height (N,) [m]."""

    @abstractmethod
    def _std(self, xy: FloatArray) -> FloatArray:
        """Return the standard deviation (N,) [m]."""

    @abstractmethod
    def _support(self, xy: FloatArray) -> npt.NDArray[np.uint8]:
        """Return the support codes (N,)."""

    def _bound(self, xy: FloatArray, what: Literal["lower", "upper"]) -> FloatArray:
        """Return one end of the 95 % interval (N,) [m]."""
        sign = 1.0 if what == "upper" else -1.0
        return self._height(xy) + sign * SIGMAS_95 * self._std(xy)


def local_datum_m(z: FloatArray) -> float:
    """Return the level that heights are counted from while a model works: their median, in whole metres.

    >>> local_datum_m(np.array([4012.2, 4013.1, 4099.0]))
    4013.0
    """
    return float(np.round(np.median(z)))


def not_fitted() -> InputError:
    """Return the refusal of a model that was asked too early."""
    return InputError("the terrain model is not fitted yet; call fit first.")
