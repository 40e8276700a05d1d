r"""Seek a source by its counts: the next place to count, and when to stop.

The next place maximizes the expected information of its count about the source per time. With counts of
variance ``μ + φ μ²`` the values ``h(μ) = 2 φ^{-1/2} asinh (φ μ)^{1/2}`` have the variance 1, so that

.. math::  I(z) \approx \tfrac12 \log \left( 1 + \operatorname{var} h(\mu(z)) \right)

over the particles of the source. The search ends where the source lies within a radius of the stated place with a probability, and
counts that deviate together have been counted as the fewer that they are worth.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from survey.core import BoolArray, FloatArray
from survey.data.area import SurveyArea
from survey.reconstruction.counts.counts import Counts
from survey.reconstruction.counts.sources import DISPERSION, SourceSearch

LEAST_SIGNAL = 1.0
"""A source is stated once its part of some count is as large as that of the background, which itself varies over a site."""
_DIRECTIONS, _DISTANCES_M = 16, (12.0, 30.0, 75.0, 150.0)
_N_CONSIDERED = 250
# A share of independent counts is used again until it changes by this factor.
_SAME_SHARE = 1.25


class FoundSource(NamedTuple):
    """Stated place of a source: easting and northing (2,) [m], and the probability that it lies within the radius."""

    xy: FloatArray
    probability: float


@dataclass(frozen=True)
class SourceSeeker:
    """Choice of the next place to count, and of the end of a search.

    Parameters
    ----------
    area : SurveyArea
        Ground that may be driven.
    speed_m_s : float
        Speed of the rover [m/s].
    count_s : float
        Duration of a count at the end of a leg [s].
    radius_m, probability : float
        The source must lie within this distance of the stated place [m] with this probability.

    Notes
    -----
    One leg is planned at a time, straight, and counts on the way to it are not foreseen.
    """

    area: SurveyArea
    speed_m_s: float = 1.0
    count_s: float = 20.0
    radius_m: float = 10.0
    probability: float = 0.9

    def next_place(
        self, search: SourceSearch, at: FloatArray, wind_m_s: FloatArray | None = None
    ) -> FloatArray:
        """Return the place (2,) [m] with the largest expected information per time.

        Parameters
        ----------
        search : SourceSearch
            Particles given all counts so far.
        at : (2,) ndarray
            Place of the rover [m].
        wind_m_s : (2,) ndarray, optional
            Wind that is expected, to the east and to the north [m/s].

        Returns
        -------
        (2,) ndarray
            Easting and northing [m].
        """
        places = self._places(search, at)
        exposure_s = np.full(len(places), self.count_s)
        wind = None if wind_m_s is None else np.tile(wind_m_s, (len(places), 1))
        belief = search.belief
        chosen = search.rng.choice(len(belief.weights), _N_CONSIDERED, p=belief.weights)
        expected = search.expected_at(Counts(places, np.zeros(len(places)), exposure_s, wind), chosen)
        dispersion = np.exp(belief.particles[chosen, DISPERSION, None])
        stable = 2.0 / np.sqrt(dispersion) * np.arcsinh(np.sqrt(dispersion * expected))
        information = 0.5 * np.log1p(stable.var(axis=0))
        seconds = np.hypot(*(places - at).T) / self.speed_m_s + self.count_s
        return np.asarray(places[int((information / seconds).argmax())])

    def found(self, search: SourceSearch) -> FoundSource | None:
        """Return the place of the source where it is known well enough, else nothing.

        Where the counts deviate together, `search` is conditioned again on all of them, each worth a share of one. The particles must give
        half of the error that is allowed: a search looks after each leg, and stops at the first look that seems good enough.
        """
        wanted = 1.0 - 0.5 * (1.0 - self.probability)
        if search.belief.within(self.radius_m)[1] < wanted or search.largest_signal() < LEAST_SIGNAL:
            return None
        share = search.independent_share()
        if max(share / search.belief.share, search.belief.share / share) > _SAME_SHARE:
            search.with_share(share)
        place, probability = search.belief.within(self.radius_m)
        return FoundSource(place, probability) if probability >= wanted else None

    def _places(self, search: SourceSearch, at: FloatArray) -> FloatArray:
        """Return places (M, 2) around the rover and around likely sources, on the ground that may be driven."""
        angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        ring = np.column_stack([np.cos(angle), np.sin(angle)])
        around = [at + reach * ring for reach in _DISTANCES_M]
        middle = search.belief.within(self.radius_m)[0]
        around += [middle + reach * ring[::2] for reach in (5.0, 15.0)]
        places = np.vstack(around)
        inside: BoolArray = self.area.contains(places)
        return places[inside] if inside.any() else at[None, :]
