"""Stakes: points of known height that take away the error that all samples of a survey share."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.route import Route

STAKED_M = 0.02
"""Shared error that is left after two stakes, each measured to 3 cm [m]."""


class StakePlan(NamedTuple):
    """Places of stakes (K, 2) [m], and the swaths that they save."""

    xy: FloatArray
    saved_swaths: int

    @classmethod
    def at_ends(cls, route: Route, saved_swaths: int) -> "StakePlan":
        """Place a stake at the beginning of the first swath and one at the end of the last.

        Parameters
        ----------
        route : Route
            The route that passes them.
        saved_swaths : int
            How many swaths fewer are enough with them.

        Returns
        -------
        StakePlan
            Two places.
        """
        return cls(np.array([route.swaths[0].xy[0], route.swaths[-1].xy[-1]]), saved_swaths)

    def __str__(self) -> str:
        """Return number, places and what they save."""
        at = " and ".join(f"({x:.0f}, {y:.0f})" for x, y in self.xy)
        return f"{len(self.xy)} stakes at {at} save {self.saved_swaths} swaths"
