"""Mean surfaces with free coefficients: none, a constant, a plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.engines.fourier_basis import FourierBox

TrendName = Literal["none", "constant", "plane"]


@dataclass(frozen=True)
class PolynomialTrend:
    """Columns of a mean surface on one box: 1, and the two coordinates from -1 to 1 across the box.

    The coefficients have an unlimited prior variance and are integrated out (universal kriging; Rasmussen and
    Williams 2006, section 2.7), so that their uncertainty is in the map.
    """

    name: TrendName
    box: FourierBox

    @property
    def n_columns(self) -> int:
        """Number of coefficients."""
        return {"none": 0, "constant": 1, "plane": 3}[self.name]

    def columns(self, xy: FloatArray) -> FloatArray:
        """Return the values (..., T) at places (..., 2) [m]."""
        scaled = 2 * (xy - self.box.centre_m) / self.box.period_m
        ones = np.ones((*xy.shape[:-1], 1))
        return np.concatenate([ones, scaled], axis=-1)[..., : self.n_columns]

    @property
    def gradient(self) -> FloatArray:
        """Derivatives (2, T) of the columns along x and y [1/m]."""
        slopes = np.concatenate([np.zeros((2, 1)), np.diag(2 / self.box.period_m)], axis=1)
        return slopes[:, : self.n_columns]
