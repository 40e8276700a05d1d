r"""Errors that all points of a strip share: offset, tilts and horizontal shift, with their joint covariance.

Strip s measures

.. math::  z_s(x) = z(x) + a_s + t_s \cdot (x - x_s) / R_s - \nabla z(x) \cdot h_s + w + e

with offset a, tilts t (as the error that they make at the strip's end), shift h, the strip's middle x_s and its
half-length R_s. Errors w belong to none of them: each block of cells has one, and each stretch of some hundred metres.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.data_object import DataObject
from survey.reconstruction.tiled.cells.pieces import strip_name
from survey.reconstruction.tiled.strips.places import N_TERMS, StripPlaces

_SHIFT_M, _BLOCK_M, _WANDER_M = 0.1, 0.01, 0.01


class Sizes(NamedTuple):
    """Standard deviations of the strips' errors [m]: offset, tilt, shift, and the rest in each block and stretch."""

    offset_m: float
    tilt_m: float
    shift_m: float = _SHIFT_M
    block_m: float = _BLOCK_M
    wander_m: float = _WANDER_M

    def rest_m(self) -> float:
        """Return the standard deviation of what belongs to none of a strip's common errors [m]."""
        return float(np.hypot(self.block_m, self.wander_m))


@dataclass(frozen=True, eq=False, repr=False)
class StripErrors(DataObject):
    """Errors of the strips and their joint covariance.

    Parameters
    ----------
    places : StripPlaces
        Middles and half-lengths.
    errors : (S, 5) ndarray
        Offset, tilts and shifts [m].
    covariance : (5 S, 5 S) ndarray
        Of all errors [m²].
    sizes : Sizes
        Found sizes of the errors.
    cell_m : float
        Standard deviation that the points of a strip share in a cell [m].
    """

    places: StripPlaces
    errors: FloatArray
    covariance: FloatArray
    sizes: Sizes
    cell_m: float

    def at(self, keys: npt.NDArray[np.uint32], xy: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the error (N,) [m] of strips at places (N, 2) [m] with slopes (N, 2) [m/m]."""
        strip = self.places.numbers(keys)
        values: FloatArray = np.sum(self.places.design(strip, xy, slope) * self.errors[strip], axis=1)
        return values

    def facts(self) -> dict[str, Any]:
        """Return the errors with their standard deviations by the names of the strips, for the record."""
        sigma = np.sqrt(np.diag(self.covariance)).reshape(-1, N_TERMS)
        names = ("offset_m", "tilt_east_m", "tilt_north_m", "shift_east_m", "shift_north_m")
        return {
            strip_name(int(key)): {
                **dict(zip(names, map(float, own), strict=True)),
                **{f"{n}_sigma": float(s) for n, s in zip(names, own_sigma, strict=True)},
            }
            for key, own, own_sigma in zip(self.places.keys, self.errors, sigma, strict=True)
        }

    def offset_between(
        self, first: int, second: int, xy: FloatArray, slope: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[float, float]:
        """Return how far a strip lies above another one at a place (2,), and the standard deviation [m].

        Parameters
        ----------
        first, second : int
            Keys of the strips.
        xy : (2,) ndarray
            Easting and northing [m].
        slope : (2,) tuple of float
            Slope eastwards and northwards, by which horizontal shifts count [m/m]; level ground by default.
        """
        strip = self.places.numbers(np.array([first, second], np.uint32))
        rows = self.places.design(strip, np.tile(xy, (2, 1)), np.tile(slope, (2, 1)))
        whole = np.zeros(self.errors.size)
        for k, sign in ((0, 1.0), (1, -1.0)):
            whole[strip[k] * N_TERMS : (strip[k] + 1) * N_TERMS] += sign * rows[k]
        return float(whole @ self.errors.ravel()), float(np.sqrt(whole @ self.covariance @ whole))


def as_arrays(found: StripErrors) -> dict[str, FloatArray]:
    """Return arrays from which `from_arrays` makes the same errors."""
    places = found.places
    return {
        "keys": places.keys.astype(np.float64),
        "middle": places.middle,
        "half_m": places.half_m,
        "errors": found.errors,
        "covariance": found.covariance,
        "sizes": np.array(found.sizes),
        "cell_m": np.array(found.cell_m),
    }


def from_arrays(arrays: Mapping[str, FloatArray]) -> StripErrors:
    """Return errors from the arrays of `as_arrays`."""
    places = StripPlaces(arrays["keys"].astype(np.uint32), arrays["middle"], arrays["half_m"])
    sizes = Sizes(*map(float, arrays["sizes"]))
    return StripErrors(places, arrays["errors"], arrays["covariance"], sizes, float(arrays["cell_m"]))
