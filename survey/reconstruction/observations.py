"""One quantity at the points, with its variance."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.base import ELEVATION

Predict = Callable[[BoolArray, FloatArray], tuple[FloatArray, FloatArray]]
"""From the points used (N,) and places (M, 2) [m] to mean (M,) [m] and variance (M,) [m²] of the surface."""


@dataclass(frozen=True)
class Observations:
    """Places (N, 2) [m], what was measured there (N,), and its variance (N,)."""

    xy: FloatArray
    z: FloatArray
    variance: FloatArray

    @classmethod
    def of(cls, points: SurfacePoints, quantity: str = ELEVATION) -> Self:
        """Return the points' elevation, or another quantity that they carry.

        Raises
        ------
        InputError
            When the points do not carry it, or not its standard deviation.
        """
        if quantity == ELEVATION:
            return cls(points.xy, points.z, points.sigma_z**2)
        if quantity not in points.values:
            known = ", ".join(sorted(points.values)) or "none"
            raise InputError(f"the points carry no value {quantity!r}; they carry: {known}.")
        if quantity not in points.value_sigmas:
            raise InputError(
                f"the points state no standard deviation of {quantity}; state one above 0 for each point."
            )
        sigma = points.value_sigmas[quantity]
        if (sigma <= 0).any():
            raise InputError(
                f"{int((sigma <= 0).sum())} standard deviations of {quantity} are 0 or less; state their standard deviations."
            )
        return cls(points.xy, points.values[quantity], sigma**2)

    def __len__(self) -> int:
        return len(self.z)

    def merged(self) -> Self:
        """Average measurements of one and the same place by their weights 1/σ²; for a surface nothing is lost."""
        places, index = np.unique(self.xy, axis=0, return_inverse=True)
        if len(places) == len(self.xy):
            return self
        index = index.ravel()
        weight = np.bincount(index, 1.0 / self.variance)
        return type(self)(places, np.bincount(index, self.z / self.variance) / weight, 1.0 / weight)

    def on_one_line(self) -> bool:
        """Return whether all places lie on one line, or on one spot, to a millionth of their extent."""
        centred = self.xy - self.xy.mean(axis=0)
        extents = np.linalg.svd(centred, compute_uv=False)
        return len(self.xy) < 3 or bool(extents[1] <= 1e-6 * max(float(extents[0]), 1e-9))
