"""Moved out of planners/config.py."""

from typing import Literal

from planners.config_steered import SteeredConfig


class RandomWanderConfig(SteeredConfig):
    """Control of the piecewise-continuous pattern: the same steps and turns, chosen at random."""

    pattern: Literal["random-wander"] = "random-wander"
    """Name of the pattern."""
