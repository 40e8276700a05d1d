"""What a pass over the points did, for the record."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.carving.descent import Tally


class Pass(NamedTuple):
    """What one pass of the mean surface did."""

    length_m: float
    n_point_bases: int
    n_ray_bases: int
    gradient_m: float
    """Mean violation beyond the dead-band [m]."""
    loss_m2: float
    """Mean of r (Eq. 9) as the pass met it [m²]."""
    validation_rmse_m: float
    """Of the points held back [m]; NaN without any."""


def pass_of(tally: Tally, length_m: float, validationrmse_m: float) -> Pass:
    """Return what a tally amounts to per step."""
    n = max(tally.n_steps, 1)
    return Pass(
        length_m, tally.n_points, tally.n_rays, tally.gradient_m / n, tally.loss_m2 / n, validationrmse_m
    )


def rms(errors: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(errors**2)))
