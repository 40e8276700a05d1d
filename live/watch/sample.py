"""Samples of the ground as they arrive, and a gate that refuses malformed and impossible ones."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from survey.core.arrays import Bounds

_MOST_SPEED_M_S, _MOST_SLOPE = 8.0, 1.5
_MOST_PAUSE_S = 900.0
_SIGMAS, _SLACK_M = 6.0, 1.0
_MOST_SIGMA_M = 20.0
# So many samples in a row that agree with one another are accepted: the rover was moved, or its clock was set.
_AGREEING = 8


class Sample(NamedTuple):
    """Height of the ground at a place and a time.

    Parameters
    ----------
    time_s : float
        By the clock of the rover or of the file [s].
    x_m, y_m, z_m : float
        Easting, northing and height in the CRS of the area [m].
    sigma_m : float
        Standard deviation of the height [m].
    battery : float or None
        Share of the charge that is left.
    """

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    sigma_m: float
    battery: float | None = None


@dataclass
class SampleGate:
    """Test of samples against the site and the one before.

    A sample is refused that is not finite, far outside the site, imprecise beyond use, not later than the one before, or
    farther from it than a rover drives in the time between. Refused samples that agree with one another are accepted
    after a while, so that one wrong sample never blocks those that follow.

    Parameters
    ----------
    bounds : tuple of float
        West, south, east and north of the ground where a rover may be [m].

    Examples
    --------
    >>> gate = SampleGate((0.0, 0.0, 100.0, 100.0))
    >>> gate.reason(Sample(0.0, 5.0, 5.0, 900.0, 0.05)) is None
    True
    >>> gate.reason(Sample(1.0, 80.0, 5.0, 900.0, 0.05))
    '75 m from the sample 1 s before'
    """

    bounds: Bounds
    last: Sample | None = None
    _others: list[Sample] = field(default_factory=list)

    def reason(self, sample: Sample) -> str | None:
        """Return why a sample is refused, or None where it is taken.

        Parameters
        ----------
        sample : Sample
            The next one.

        Returns
        -------
        str or None
            In words.
        """
        wrong = self._malformed(sample)
        if wrong is None and self.last is not None:
            wrong = _contradiction(self.last, sample)
            if wrong is not None:
                wrong = self._unless_agreeing(sample, wrong)
        if wrong is None:
            self.last, self._others = sample, []
        return wrong

    def _malformed(self, sample: Sample) -> str | None:
        if not np.isfinite(sample[:5]).all():
            return "not finite"
        west, south, east, north = self.bounds
        if not (west <= sample.x_m <= east and south <= sample.y_m <= north):
            return "far outside the site"
        if not 0.0 < sample.sigma_m <= _MOST_SIGMA_M:
            return f"standard deviation {sample.sigma_m:g} m"
        return None

    def _unless_agreeing(self, sample: Sample, wrong: str) -> str | None:
        """Return the reason, unless as many refused samples in a row agree."""
        if self._others and _contradiction(self._others[-1], sample) is not None:
            self._others = []
        self._others.append(sample)
        return None if len(self._others) >= _AGREEING else wrong


def _contradiction(before: Sample, after: Sample) -> str | None:
    """Return why a sample cannot follow another, or None."""
    seconds = after.time_s - before.time_s
    if not 0.0 < seconds <= _MOST_PAUSE_S:
        return f"{seconds:.3g} s after the sample before"
    distance_m = float(np.hypot(after.x_m - before.x_m, after.y_m - before.y_m))
    slack_m = _SLACK_M + _SIGMAS * (before.sigma_m + after.sigma_m)
    if distance_m > _MOST_SPEED_M_S * seconds + slack_m:
        return f"{distance_m:.0f} m from the sample {seconds:.3g} s before"
    rise_m = abs(after.z_m - before.z_m)
    if rise_m > _MOST_SLOPE * distance_m + slack_m:
        return f"{rise_m:.0f} m above or below the sample before, {distance_m:.0f} m away"
    return None
