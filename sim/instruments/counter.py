r"""Draw the counts of a detector: radiation over uneven ground, a plume in a wind that turns, and an intensity without a source.

The worlds hold more than `survey.reconstruction.counts` assumes: a background that varies over the site, heights that
differ, dead time; a wind that turns and gusts in time, a sensor of wind with an error of its own, and widths of the plume that
differ from the tables.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import ndtri

from survey.core import FloatArray
from survey.reconstruction.counts.counts import Counts

_N_WAVES, _N_ROUGH, _N_TURNS = 200, 1000, 41


class CountedWorld(Protocol):
    """A world in which a detector counts."""

    source_xy: FloatArray

    def rate(self, xy: FloatArray) -> FloatArray:
        """Return the mean rate (N,) at which a detector counts at places (N, 2) [1/s]."""

    def count(self, xy: FloatArray, exposure_s: FloatArray) -> Counts:
        """Return counts one after the other at places (N, 2) [m]."""


@dataclass
class RadiationWorld:
    """A radiating point.

    Parameters
    ----------
    source_xy : (2,) ndarray
        Its place [m].
    strength, background_per_s : float
        Counts per second at 1 m from the source without absorption, and mean background [1/s].
    rng : numpy.random.Generator
        Stream of the counts and of the ground.
    uneven, relief_m, dead_time_s : float
        Standard deviation of the logarithm of the background (length 60 m), that of the height of the ground [m], and time after each
        count in which nothing is counted [s].
    """

    source_xy: FloatArray
    strength: float
    background_per_s: float
    rng: np.random.Generator
    uneven: float = 0.0
    relief_m: float = 0.0
    dead_time_s: float = 0.0

    def __post_init__(self) -> None:
        self._background, self._height = (_Waves.drawn(self.rng, length) for length in (60.0, 80.0))

    def rate(self, xy: FloatArray) -> FloatArray:
        """Return the rate (N,) at which a detector counts at places (N, 2) [1/s]."""
        rise = self.relief_m * (self._height.at(xy) - self._height.at(self.source_xy[None]))
        square = np.sum((xy - self.source_xy) ** 2, axis=1) + (rise + 0.5) ** 2 + 0.05
        rate = self.strength * np.exp(-0.0095 * np.sqrt(square)) / square
        rate += self.background_per_s * np.exp(self.uneven * self._background.at(xy))
        seen: FloatArray = rate / (1.0 + self.dead_time_s * rate)
        return seen

    def count(self, xy: FloatArray, exposure_s: FloatArray) -> Counts:
        """Return counts one after the other at places (N, 2) [m]."""
        return Counts(xy, self.rng.poisson(self.rate(xy) * exposure_s).astype(np.float64), exposure_s)


@dataclass
class PlumeWorld:
    """A plume in wind.

    Parameters
    ----------
    source_xy : (2,) ndarray
        Its source [m].
    strength, background_per_s : float
        Counts per second of a flow of 1 m³/s that took up all of it, and background [1/s].
    wind_m_s : (2,) ndarray
        Mean wind, to the east and to the north [m/s].
    rng : numpy.random.Generator
        Stream of wind and counts.
    turning_deg, gusts : float
        Standard deviations of the wind's direction (correlated over 60 s) [deg], and of the logarithm of the intensity (30 s).
    vane_error_deg : float
        Standard deviation of the constant error of the measured direction [deg].
    width : float
        Factor on the widths of the tables.
    loss_per_s : float
        Decay [1/s].
    """

    source_xy: FloatArray
    strength: float
    background_per_s: float
    wind_m_s: FloatArray
    rng: np.random.Generator
    turning_deg: float = 0.0
    gusts: float = 0.0
    vane_error_deg: float = 0.0
    width: float = 1.0
    loss_per_s: float = 0.0

    def __post_init__(self) -> None:
        self._turn, self._gust = self.rng.standard_normal(2)
        self._vane = math.radians(self.vane_error_deg) * float(self.rng.standard_normal())

    def rate(self, xy: FloatArray) -> FloatArray:
        """Return the mean rate (N,) over the turns of the wind at places (N, 2) [1/s]."""
        turns = math.radians(self.turning_deg) * ndtri((np.arange(_N_TURNS) + 0.5) / _N_TURNS)
        winds = [_turned(self.wind_m_s, float(turn)) for turn in turns]
        mean = [np.mean([self._plume(place, wind) for wind in winds]) for place in xy]
        return self.background_per_s + self.strength * np.array(mean)

    def count(self, xy: FloatArray, exposure_s: FloatArray) -> Counts:
        """Return counts one after the other at places (N, 2) [m]."""
        rows = [self._one(place, float(seconds)) for place, seconds in zip(xy, exposure_s, strict=True)]
        n, wind = (np.array(column, dtype=np.float64) for column in zip(*rows, strict=True))
        return Counts(xy, n, exposure_s, wind)

    def _one(self, place: FloatArray, seconds: float) -> tuple[float, FloatArray]:
        """Return one count, and the mean wind that was measured."""
        for name, over_s in (("_turn", 60.0), ("_gust", 30.0)):
            kept = math.exp(-seconds / over_s)
            drawn = kept * getattr(self, name) + math.sqrt(1.0 - kept**2) * float(self.rng.standard_normal())
            setattr(self, name, drawn)
        wind = _turned(self.wind_m_s, math.radians(self.turning_deg) * self._turn)
        measured = _turned(wind, self._vane + math.radians(2.0) * float(self.rng.standard_normal()))
        rate = self.background_per_s + self.strength * self._plume(place, wind) * math.exp(
            self.gusts * self._gust - 0.5 * self.gusts**2
        )
        return float(self.rng.poisson(rate * seconds)), measured

    def _plume(self, place: FloatArray, wind: FloatArray) -> float:
        speed = float(np.hypot(*wind))
        along = wind / speed
        lag = place - self.source_xy
        down, across = float(lag @ along), float(lag @ np.array([-along[1], along[0]]))
        if down <= 0.0:
            return 0.0
        wide = self.width * 0.08 * down / math.sqrt(1.0 + 1e-4 * down) + 0.4
        high = self.width * 0.06 * down / math.sqrt(1.0 + 1.5e-3 * down) + 0.4
        exponent = 0.5 * (across / wide) ** 2 + 0.5 / high**2 + self.loss_per_s * down / speed
        return math.exp(-exponent) / (math.pi * wide * high * speed)


@dataclass
class UnevenWorld:
    """An intensity without a source: the exponential of a Gaussian field.

    Parameters
    ----------
    median_per_s, sigma, length_m : float
        Median of the intensity [1/s], standard deviation of its logarithm, and length scale [m].
    rng : numpy.random.Generator
        Stream of the field and of the counts.
    is_rough : bool
        Whether the field is one of the exponential family (Matérn 1/2) in place of a smooth one.
    """

    median_per_s: float
    sigma: float
    length_m: float
    rng: np.random.Generator
    is_rough: bool = False

    def __post_init__(self) -> None:
        # The spectrum of Matérn 1/2 in the plane is a Cauchy distribution.
        scale = self.length_m * (
            np.abs(self.rng.standard_normal(_N_ROUGH)) if self.is_rough else np.ones(_N_ROUGH)
        )
        self._field = _Waves(
            self.rng.standard_normal((_N_ROUGH, 2)) / scale[:, None],
            self.rng.uniform(0.0, 2.0 * np.pi, _N_ROUGH),
        )

    def rate(self, xy: FloatArray) -> FloatArray:
        """Return the rate (N,) at places (N, 2) [1/s]."""
        return self.median_per_s * np.exp(self.sigma * self._field.at(xy))

    def count(self, xy: FloatArray, exposure_s: FloatArray) -> Counts:
        """Return counts one after the other at places (N, 2) [m]."""
        return Counts(xy, self.rng.poisson(self.rate(xy) * exposure_s).astype(np.float64), exposure_s)


class _Waves:
    """Gaussian field of variance 1 from cosine waves."""

    def __init__(self, omega: FloatArray, phase: FloatArray) -> None:
        self._omega, self._phase = omega, phase

    @classmethod
    def drawn(cls, rng: np.random.Generator, length_m: float) -> "_Waves":
        return cls(rng.standard_normal((_N_WAVES, 2)) / length_m, rng.uniform(0.0, 2.0 * np.pi, _N_WAVES))

    def at(self, xy: FloatArray) -> FloatArray:
        value: FloatArray = np.sqrt(2.0 / len(self._phase)) * np.cos(xy @ self._omega.T + self._phase).sum(
            axis=1
        )
        return value


def _turned(wind: FloatArray, angle: float) -> FloatArray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([cosine * wind[0] - sine * wind[1], sine * wind[0] + cosine * wind[1]])
