"""Progress of a rover along the legs that were planned."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.route import Leg

# Share of its length by which the way along a leg may be longer or shorter than planned.
_ODD_SHARE = 0.2


class LegProgress:
    """Legs that a rover has driven, from the places it was at.

    A leg is driven when the rover has passed near its end, after most of its length. Between two places it counts as
    driven straight, so that telemetry may pause. A rover that is followed from the middle of its drive on, or again after
    a loss of the link, is found on a later leg once it has driven that from its beginning to its end; the legs before
    then count as driven.

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
        self._from_m = 0.0
        self._begun_m: dict[int, float] = {}
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
        self._last = xy
        self.driven_m += float(np.hypot(*(xy - last)))
        before = self.n_driven
        while (index := self._reached(last, xy)) is not None:
            self._from_m = self.driven_m - float(np.hypot(*(xy - self.legs[index].xy[-1])))
            self.n_driven = index + 1
        for index in range(self.n_driven + 1, len(self.legs)):
            if _gap_m(self.legs[index].xy[0], last, xy) <= self.near_m:
                self._begun_m[index] = self.driven_m
        return tuple(range(before, self.n_driven))

    def _reached(self, before: FloatArray, after: FloatArray) -> int | None:
        """Return the leg whose end was passed between two places, the nearest end of several."""
        gaps_m = {
            index: _gap_m(self.legs[index].xy[-1], before, after)
            for index in range(self.n_driven, len(self.legs))
            if self._may_end(index)
        }
        nearest = min(gaps_m, key=gaps_m.__getitem__, default=None)
        return None if nearest is None or gaps_m[nearest] > self.near_m else nearest

    def _may_end(self, index: int) -> bool:
        """Return whether the rover may be at the end of a leg by the way since its beginning; of later legs, of a swath."""
        leg = self.legs[index]
        if index == self.n_driven:
            return self.driven_m - self._from_m >= (1.0 - _ODD_SHARE) * leg.length_m - self.near_m
        if leg.kind != "swath" or index not in self._begun_m or leg.length_m < 4.0 * self.near_m:
            return False
        way_m = self.driven_m - self._begun_m[index]
        return abs(way_m - leg.length_m) <= _ODD_SHARE * leg.length_m + 2.0 * self.near_m

    @property
    def driven(self) -> list[Leg]:
        """Legs that were driven."""
        return self.legs[: self.n_driven]


def _gap_m(place: FloatArray, before: FloatArray, after: FloatArray) -> float:
    """Return the distance of a place from the straight way between two others [m]."""
    way, apart = after - before, place - before
    share = np.clip(np.dot(apart, way) / max(float(np.dot(way, way)), 1e-12), 0.0, 1.0)
    return float(np.hypot(*(apart - share * way)))
