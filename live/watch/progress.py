"""Progress of a rover along the legs that were planned."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.legs import Leg

_LEAST_SHARE = 0.8


class LegProgress:
    """Legs that a rover has driven, from the places it was at.

    A leg is driven when the rover has passed near its end, after most of its length. Between two places it counts as
    driven straight, so that telemetry may pause.

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
    [(), (), (0,)]
    """

    def __init__(self, legs: list[Leg], near_m: float) -> None:
        self.legs, self.near_m = legs, near_m
        self.n_driven = 0
        self.driven_m = 0.0
        self._on_leg_m = 0.0
        self._last: FloatArray | None = None

    def moved(self, xy: FloatArray) -> tuple[int, ...]:
        """Take the next place (2,) [m]; return the legs that it completes.

        Parameters
        ----------
        xy : (2,) ndarray
            Easting and northing [m].

        Returns
        -------
        tuple of int
            Indices into the legs.
        """
        last = xy if self._last is None else self._last
        step_m = float(np.hypot(*(xy - last)))
        self._last = xy
        self.driven_m += step_m
        self._on_leg_m += step_m
        before = self.n_driven
        while self.n_driven < len(self.legs) and self._is_driven(self.legs[self.n_driven], last, xy):
            self._on_leg_m = float(np.hypot(*(xy - self.legs[self.n_driven].xy[-1])))
            self.n_driven += 1
        return tuple(range(before, self.n_driven))

    def _is_driven(self, leg: Leg, before: FloatArray, after: FloatArray) -> bool:
        """Return whether the rover passed near the end of a leg between two places, after most of its length."""
        way, to_end = after - before, leg.xy[-1] - before
        share = np.clip(np.dot(to_end, way) / max(float(np.dot(way, way)), 1e-12), 0.0, 1.0)
        is_near = float(np.hypot(*(to_end - share * way))) <= self.near_m
        return is_near and self._on_leg_m >= _LEAST_SHARE * leg.length_m - self.near_m

    @property
    def driven(self) -> list[Leg]:
        """Legs that were driven."""
        return self.legs[: self.n_driven]
