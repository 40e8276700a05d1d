"""Moved out of planners/config.py."""

from typing import Literal

from planners.config_steered import SteeredConfig


class PiecewiseContinuousConfig(SteeredConfig):
    """The glacier paper's second pattern (Eq. 10): steepest ascent or descent about a swath, switched at random.

    The paper leaves step, candidates, switching and bounds open; these are the values
    read into it. The route is made while driving: see `planners.steering.steering`.
    """

    pattern: Literal["piecewise-continuous"] = "piecewise-continuous"
    """Name of the pattern."""
