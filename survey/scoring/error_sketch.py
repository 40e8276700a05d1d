"""Error statistics and calibration of values that come block by block, in bounded memory."""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.scoring.accuracy import LEVELS, NMAD_FACTOR, Calibration, ErrorStatistics

# Bins of the errors' distribution: even in asinh(e / 1 mm) about the first block's median, so that each is
# 2e-5 of its distance from there, or 20 nm, wide.
_SCALE_M = 1e-3


_N_BINS = 2_000_000


_FARTHEST = math.asinh(1e6 / _SCALE_M)


_N_BISECTIONS = 80


@dataclass
class ErrorSketch:
    """The distribution of errors that come block by block, in 16 MB whatever their number.

    Mean, RMSE and higher moments are exact to rounding; median, NMAD and percentile to 2e-5 of
    their distance from the first block's median. The largest error is exact.

    Examples
    --------
    >>> errors = np.random.default_rng(1).normal(0.2, 0.5, 20_000)
    >>> sketch = ErrorSketch()
    >>> for part in np.split(errors, 10):
    ...     sketch.add(part)
    >>> sketched, exact = sketch.statistics(), ErrorStatistics.of(errors)
    >>> all(abs(a - b) < 1e-4 for a, b in zip(vars(sketched).values(), vars(exact).values()))
    True
    """

    n: int = 0
    centre_m: float = 0.0
    worst_m: float = 0.0
    _sums: FloatArray = field(default_factory=lambda: np.zeros(4), repr=False)
    _counts: IntArray = field(default_factory=lambda: np.zeros(_N_BINS, dtype=np.int64), repr=False)

    def add(self, errors: FloatArray) -> None:
        """Add errors (N,) [m]; all finite."""
        if len(errors) == 0:
            return
        if self.n == 0:
            self.centre_m = float(np.median(errors))
        offset = errors - self.centre_m
        power = offset.copy()
        for k in range(4):
            self._sums[k] += power.sum()
            power *= offset
        position = (np.arcsinh(offset / _SCALE_M) + _FARTHEST) * (_N_BINS / (2.0 * _FARTHEST))
        index = np.clip(position, 0, _N_BINS - 1).astype(np.int64)
        np.add.at(self._counts, index, 1)
        self.n += len(errors)
        self.worst_m = max(self.worst_m, float(np.abs(errors).max()))

    def statistics(self) -> ErrorStatistics:
        """Return what `ErrorStatistics.of` would give for all errors at once."""
        if self.n == 0:
            raise InputError("there are no errors to summarise; check that the rasters overlap.")
        m1, m2, m3, m4 = self._sums / self.n
        bias = self.centre_m + m1
        variance = max(m2 - m1**2, 0.0)
        third = m3 - 3.0 * m1 * m2 + 2.0 * m1**3
        fourth = m4 - 4.0 * m1 * m3 + 6.0 * m1**2 * m2 - 3.0 * m1**4
        below = np.cumsum(self._counts, dtype=np.float64)
        median = self._within(below, -np.inf, 0.5)
        return ErrorStatistics(
            n=self.n,
            rmse_m=math.sqrt(variance + bias**2),
            bias_m=float(bias),
            std_m=math.sqrt(variance),
            median_m=median,
            nmad_m=NMAD_FACTOR * self._within(below, median, 0.5),
            p95_m=self._within(below, 0.0, 0.95),
            worst_m=self.worst_m,
            skewness=float(third / variance**1.5) if variance > 0.0 else math.nan,
            kurtosis=float(fourth / variance**2 - 3.0) if variance > 0.0 else math.nan,
        )

    def _share_below(self, below: FloatArray, error_m: float) -> float:
        """Return the share of the errors that are not above a value [m], even within a bin."""
        place = (math.asinh((error_m - self.centre_m) / _SCALE_M) + _FARTHEST) * (_N_BINS / (2.0 * _FARTHEST))
        k = int(min(max(place, 0.0), _N_BINS - 1))
        before = below[k - 1] if k else 0.0
        return float(before + (below[k] - before) * min(max(place - k, 0.0), 1.0)) / self.n

    def _within(self, below: FloatArray, centre_m: float, share: float) -> float:
        """Return the distance from a centre within which a share of the errors lies [m]; from -inf, the value itself."""
        one_sided = centre_m == -np.inf
        low, high = (-self.worst_m if one_sided else 0.0), 2.0 * self.worst_m + 1e-12
        for _ in range(_N_BISECTIONS):
            middle = 0.5 * (low + high)
            if one_sided:
                inside = self._share_below(below, middle)
            else:
                inside = self._share_below(below, centre_m + middle) - self._share_below(
                    below, centre_m - middle
                )
            low, high = (middle, high) if inside < share else (low, middle)
        return 0.5 * (low + high)


@dataclass
class CalibrationSketch:
    """The counts of a calibration that come block by block."""

    n: int = 0
    _z_squares: float = 0.0
    _within: FloatArray = field(default_factory=lambda: np.zeros(len(LEVELS) + 1))

    def add(self, errors: FloatArray, std: FloatArray) -> None:
        """Add errors and stated deviations (N,) [m]; NaN deviations do not count."""
        stated = np.isfinite(std)
        e, s = np.abs(errors[stated]), std[stated]
        if (s < 0.0).any():
            raise InputError(f"{int((s < 0.0).sum())} stated standard deviations are negative; correct them.")
        z = np.divide(e, s, out=np.where(e > 0.0, np.inf, 0.0), where=s > 0.0)
        self.n += len(z)
        self._z_squares += float((z**2).sum())
        limits = ndtri(0.5 + 0.5 * np.array([*LEVELS, 0.95]))
        self._within += [(z <= limit).sum() for limit in limits]

    def calibration(self) -> Calibration:
        """Return what `Calibration.of` would give for all at once."""
        if self.n == 0:
            return Calibration.of([], [])
        shares = self._within / self.n
        z_rms = math.sqrt(self._z_squares / self.n)
        return Calibration(LEVELS, tuple(shares[:-1].tolist()), float(shares[-1]), z_rms, self.n)
