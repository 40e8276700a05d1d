"""Values with noise variances at places: the input of the engines."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from survey.core.arrays import FloatArray, checked
from survey.core.errors import InputError


@dataclass(frozen=True)
class NoisyValues:
    """Places (N, 2) [m], data columns (N, K) there, of which the first are the values, and noise variances (N,)."""

    xy: FloatArray
    columns: FloatArray
    noise_m2: FloatArray

    @classmethod
    def of(cls, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Check values (N,) and their standard deviations (N,) [m].

        Raises
        ------
        InputError
            If there is no point, the arrays do not fit together, hold NaN, or a standard deviation is not above 0.
        """
        xy, values, noise = checked_points(xy, values, sigma_m)
        return cls(xy, values[:, None], noise)

    @property
    def values(self) -> FloatArray:
        """The values (N,)."""
        return self.columns[:, 0]

    def __len__(self) -> int:
        return len(self.xy)

    def __add__(self, other: "NoisyValues") -> "NoisyValues":
        return NoisyValues(
            np.concatenate([self.xy, other.xy]),
            np.concatenate([self.columns, other.columns]),
            np.concatenate([self.noise_m2, other.noise_m2]),
        )

    def with_columns(self, columns: FloatArray) -> Self:
        """Put more columns (N, T) beside the values."""
        return replace(self, columns=np.concatenate([self.columns, columns], axis=1))

    def without_values(self) -> Self:
        """Keep places and noise alone."""
        return replace(self, columns=self.columns[:, :0])

    def extent(self, bounds: tuple[float, float, float, float] | None) -> tuple[float, float, float, float]:
        """Return the smallest rectangle (xmin, ymin, xmax, ymax) that holds the bounds, if any, and the points."""
        low, high = self.xy.min(axis=0), self.xy.max(axis=0)
        if bounds is not None:
            low, high = np.minimum(low, bounds[:2]), np.maximum(high, bounds[2:])
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def checked_points(
    xy: FloatArray, values: FloatArray, sigma_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places, values and noise variances [m²], or refuse them in one sentence."""
    xy = checked(xy, (None, 2), "places of the points")
    values = checked(values, (len(xy),), "values of the points")
    sigma = checked(sigma_m, (len(xy),), "standard deviations of the points")
    if len(xy) == 0:
        raise InputError("no points were given; at least one was expected.")
    if (sigma <= 0).any():
        first = int(np.flatnonzero(sigma <= 0)[0])
        raise InputError(
            f"the standard deviation of point {first} is {sigma[first]:g} m where a number above 0 was "
            "expected; give the point's real accuracy."
        )
    return xy, values, sigma**2
