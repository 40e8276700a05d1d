"""What all instruments share: moments of reading, wrong clocks, lost readings, errors with a memory."""

from typing import NamedTuple

import numpy as np

from sim.config.sensors import InstrumentConfig
from survey.core.arrays import FloatArray
from survey.core.streams import stream


class Moments(NamedTuple):
    """``at_s`` when an instrument reads, ``shown_s`` what its clock shows then."""

    at_s: FloatArray
    shown_s: FloatArray


class Clock:
    """Tells when an instrument reads.

    Examples
    --------
    >>> clock = Clock(InstrumentConfig(rate_hz=2.0, clock_offset_s=0.25), 1, "gps")
    >>> clock.due(1.0).shown_s.tolist(), clock.due(1.6).at_s.tolist()
    ([0.25, 0.75, 1.25], [1.5])
    """

    def __init__(self, config: InstrumentConfig, seed: int, name: str) -> None:
        self._config = config
        self._rng = stream(seed, "instruments", name, "dropped")
        self._n_read = 0

    def due(self, until_s: float) -> Moments:
        """Return the moments since the last call up to a time, that one included; dropped ones are left out."""
        rate = self._config.rate_hz
        last = int(np.floor(until_s * rate + 1e-6))
        at_s = np.arange(self._n_read, last + 1) / rate
        self._n_read = max(last + 1, self._n_read)
        kept = self._rng.random(len(at_s)) >= self._config.dropped_share
        return Moments(at_s[kept], at_s[kept] + self._config.clock_offset_s)


class GaussMarkov:
    r"""First-order Gauss–Markov errors that go on from call to call.

    .. math:: b_{k+1} = a b_k + \sigma \sqrt{1 - a^2}\, w_k, \qquad a = e^{-\Delta t / \tau}

    with autocovariance :math:`\sigma^2 e^{-|t|/\tau}`; the first value is drawn from N(0, σ²).
    """

    def __init__(self, sigma: float, correlation_s: float, rng: np.random.Generator, n_columns: int) -> None:
        self._sigma, self._correlation_s, self._rng = sigma, correlation_s, rng
        self._at_s = np.nan  # nothing drawn yet
        self._value = np.zeros(n_columns)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the errors (N, n_columns) at increasing times after those asked for before."""
        noise = self._sigma * self._rng.standard_normal((len(time_s), len(self._value)))
        if not len(time_s):
            return noise
        if np.isnan(self._at_s):
            self._at_s, self._value = float(time_s[0]), noise[0]
            return np.vstack([self._value, self._continued(time_s[1:], noise[1:])])
        return self._continued(time_s, noise)

    def _continued(self, time_s: FloatArray, noise: FloatArray) -> FloatArray:
        if not len(time_s):
            return noise
        memory = np.exp(-np.diff(time_s, prepend=self._at_s) / self._correlation_s)
        driven = np.sqrt(1.0 - memory**2)[:, None] * noise
        a = float(memory[-1])
        if np.allclose(memory, a, rtol=1e-9):
            from scipy.signal import lfilter  # slow to import, and ideal clocks need none

            series: FloatArray = lfilter([1.0], [1.0, -a], driven, axis=0, zi=a * self._value[None])[0]
        else:
            series = driven
            value = self._value
            for k, share in enumerate(memory):
                value = share * value + driven[k]
                series[k] = value
        self._at_s, self._value = float(time_s[-1]), series[-1].copy()
        return series
