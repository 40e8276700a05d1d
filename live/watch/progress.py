"""Progress of a rover along the legs that were planned."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.legs import Leg

_LEAST_SHARE = 0.8


class LegProgress:
    """Legs that a rover has driven, from the places it was at.

    A leg is driven when the rover has come near its end, after most of its length.

    Parameters
    ----------
    legs : list of Leg
        In driving order; more may be added.
    near_m : float
        Distance from the end of a leg at which it counts as reached [m].

    Examples
    --------
    >>> progress = LegProgress([Leg("swath", [[0.0, 0.0], [10.0, 0.0]])], near_m=1.0)
    >>> [progress.moved(np.array([x, 0.1])) for x in (0.0, 5.0, 9.5)]
    [None, None, 0]
    """

    def __init__(self, legs: list[Leg], near_m: float) -> None:
        self.legs, self.near_m = legs, near_m
        self.n_driven = 0
        self.driven_m = 0.0
        self._on_leg_m = 0.0
        self._last: FloatArray | None = None

    def moved(self, xy: FloatArray) -> int | None:
        """Take the next place (2,) [m]; return the index of the leg that it completes, if any.

        Parameters
        ----------
        xy : (2,) ndarray
            Easting and northing [m].

        Returns
        -------
        int or None
            Index into the legs.
        """
        step_m = 0.0 if self._last is None else float(np.hypot(*(xy - self._last)))
        self._last = xy
        self.driven_m += step_m
        self._on_leg_m += step_m
        if self.n_driven >= len(self.legs):
            return None
        leg = self.legs[self.n_driven]
        is_near = float(np.hypot(*(xy - leg.xy[-1]))) <= self.near_m
        if not is_near or self._on_leg_m < _LEAST_SHARE * leg.length_m - self.near_m:
            return None
        self.n_driven += 1
        self._on_leg_m = 0.0
        return self.n_driven - 1

    @property
    def driven(self) -> list[Leg]:
        """Legs that were driven."""
        return self.legs[: self.n_driven]
