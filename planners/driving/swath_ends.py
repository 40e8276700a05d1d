"""Moved out of planners/swaths/cells.py."""

from collections.abc import Sequence

import numpy as np

from survey.core.arrays import FloatArray


def ends_of(swaths: Sequence[FloatArray]) -> FloatArray:
    """Return the first and last points (2 N, 2) of the swaths, swath by swath."""
    return np.array([[swath[0], swath[-1]] for swath in swaths], dtype=np.float64).reshape(-1, 2)
