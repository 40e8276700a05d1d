"""Moved out of planners/config.py."""

from typing import Literal

from planners.config import SwathConfig


class LawnmowerConfig(SwathConfig):
    """Straight swaths at ``(i + 1/2) L / n``, driven back and forth from border to border (glacier paper, III.A).

    With an ``inset_share`` of about 0.5 the rover no longer drives to the fence, where
    half of what it could measure lies outside: 10 to 35 % less distance for the same map.

    Examples
    --------
    >>> LawnmowerConfig(swaths=4).inset_share
    0.0
    """

    pattern: Literal["lawnmower"] = "lawnmower"
    """Name of the pattern."""
