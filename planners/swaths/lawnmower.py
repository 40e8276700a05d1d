"""Lawnmower: straight parallel swaths, driven back and forth."""

from planners.swaths.swaths import Swath
from survey.core.arrays import FloatArray


def lawnmower(axes: list[FloatArray]) -> list[Swath]:
    """Return swaths along the reference lines themselves."""
    return [Swath(axis, axis) for axis in axes]
