r"""Online fusion of visual odometry with GPS by a Rao-Blackwellised particle filter.

A particle holds what is not linear: position, heading and the odometry's scale. The GPS
bias, which wanders slowly (Gauss-Markov), is linear and Gaussian once the position is
given: each particle carries its mean, and all share one variance, since that does not
depend on the readings. With d the odometry's step in its own level frame,

    p ← p + s R(ψ) d + n,   ψ ← ψ + n,   s ← s + n
    z = p + b + ν,          b ← exp(−Δt/T) b + n

so the weight of a particle is N(z − p − b̂; 0, σ_b² + σ_ν²) and b̂ is then corrected as by a
Kalman filter. The noise of the motion follows `LocalizationConfig`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from survey.arrays import FloatArray
from survey.errors import InputError
from vision_slam.config import LocalizationConfig

_CONSISTENT = float(chi2.ppf(0.999, 3))
_N_JUMPS = 5
_JITTER = 0.1


@dataclass(frozen=True)
class FilterEstimate:
    """Weighted mean and covariance of the particles at one moment.

    ``position`` (3,) [m], ``heading_rad`` turn of the odometry's frame in the world,
    ``scale`` of its steps, ``covariance`` (3, 3) of the position [m²]; ``is_lost`` while
    the particles do not yet agree, or fixes contradict them.
    """

    position: FloatArray
    heading_rad: float
    scale: float
    covariance: FloatArray
    is_lost: bool


class ParticleFilter:
    """Position of a rover from odometry steps and fixes, one after the other.

    Parameters
    ----------
    config : LocalizationConfig
        What is assumed of the sensors.
    rng : numpy.random.Generator
        Draws of the particles.
    n_particles : int
        How many.
    start : (3,) ndarray, optional
        Where the rover starts, known to `config.start_sigma_m`. None is an unknown start:
        particles come from the first fix, with every heading.
    lost_m : float
        Standard deviation of the horizontal position above which the filter says lost.

    Examples
    --------
    >>> known = ParticleFilter(LocalizationConfig(), np.random.default_rng(1), start=np.zeros(3))
    >>> for _ in range(20):
    ...     known.move(np.array([0.5, 0.0, 0.0]), 0.5)
    >>> known.correct(np.array([10.2, 0.3, 0.1]))
    >>> bool(abs(known.estimate().position[0] - 10.0) < 0.3)
    True
    """

    def __init__(
        self,
        config: LocalizationConfig,
        rng: np.random.Generator,
        *,
        n_particles: int = 2000,
        start: FloatArray | None = None,
        lost_m: float = 5.0,
    ) -> None:
        if n_particles < 10:
            raise InputError(f"{n_particles} particles are too few to tell anything; give at least 10.")
        self._config, self._rng, self._n = config, rng, n_particles
        self._lost_m = lost_m
        self._level = np.array([1.0, 1.0, config.gps_vertical_factor])
        self._white = (config.gps_white_sigma_m * self._level) ** 2
        self._log_weight = np.zeros(n_particles)
        self._n_jumps = 0
        self._position: FloatArray | None = None
        self._heading: FloatArray = np.zeros(n_particles)
        self._scale: FloatArray = np.ones(n_particles)
        self._bias: FloatArray = np.zeros((n_particles, 3))
        self._bias_variance: FloatArray = (config.gps_bias_sigma_m * self._level) ** 2
        if start is not None:
            self._draw(start, np.full(3, config.start_sigma_m), np.radians(config.yaw_sigma_deg))

    def move(self, step: FloatArray, seconds: float) -> None:
        """Move by a step (3,) [m] of the odometry, in its own frame, which took so long."""
        if self._position is None:
            return
        config, rng, n = self._config, self._rng, self._n
        length = float(np.linalg.norm(step))
        cosine, sine = np.cos(self._heading), np.sin(self._heading)
        turned = np.column_stack(
            [cosine * step[0] - sine * step[1], sine * step[0] + cosine * step[1], np.full(n, step[2])]
        )
        random = config.step_sigma_m * np.sqrt(length) * rng.standard_normal((n, 3))
        self._position = self._position + self._scale[:, None] * turned + random
        # The same spread over the correlation length that the smoother gives the heading.
        wander = np.radians(config.yaw_sigma_deg) * np.sqrt(2.0 * length / config.attitude_correlation_m)
        self._heading = self._heading + wander * rng.standard_normal(n)
        memory = float(np.exp(-seconds / config.gps_correlation_time_s))
        bias = (config.gps_bias_sigma_m * self._level) ** 2
        self._bias = memory * self._bias
        self._bias_variance = memory**2 * self._bias_variance + (1.0 - memory**2) * bias

    def correct(self, fix: FloatArray) -> None:
        """Weigh the particles by a fix (3,) [m].

        One that contradicts all of them is left out; after several in a row it is the
        particles that are wrong, and they are drawn anew around the fixes.
        """
        if self._position is None:
            self._start_anywhere(fix)
            return
        innovation = fix - self._position - self._bias
        variance = self._bias_variance + self._white
        if self._contradicts(innovation, variance):
            self._n_jumps += 1
            if self._n_jumps >= _N_JUMPS:
                self._start_anywhere(fix)
            return
        self._n_jumps = 0
        self._log_weight = self._log_weight - 0.5 * (innovation**2 / variance).sum(axis=1)
        gain = self._bias_variance / variance
        self._bias = self._bias + gain * innovation
        self._bias_variance = (1.0 - gain) * self._bias_variance
        self._resample_when_few_count()

    def estimate(self) -> FilterEstimate:
        """Return the mean, and how far the particles spread.

        Raises
        ------
        InputError
            No fix has come yet and no start was given.
        """
        if self._position is None:
            raise InputError(
                "the filter has neither a start nor a fix; give it one before asking where it is."
            )
        weight = self._weight()
        mean = weight @ self._position
        off = self._position - mean
        covariance = np.einsum("n,ni,nj->ij", weight, off, off)
        spread = float(np.sqrt(covariance[0, 0] + covariance[1, 1]))
        heading = float(np.angle(weight @ np.exp(1j * self._heading)))
        sure_of_heading = abs(weight @ np.exp(1j * self._heading)) > 0.9
        return FilterEstimate(
            mean,
            heading,
            float(weight @ self._scale),
            covariance,
            bool(spread > self._lost_m or not sure_of_heading or self._n_jumps > 1),
        )

    def _draw(self, place: FloatArray, sigma: FloatArray, heading_sigma: float | None) -> None:
        rng, n = self._rng, self._n
        self._position = place + sigma * rng.standard_normal((n, 3))
        self._heading = (
            rng.uniform(-np.pi, np.pi, n) if heading_sigma is None else heading_sigma * rng.standard_normal(n)
        )
        self._scale = 1.0 + self._config.scale_sigma * rng.standard_normal(n)
        self._bias = np.zeros((n, 3))
        self._log_weight = np.zeros(n)
        self._n_jumps = 0

    def _start_anywhere(self, fix: FloatArray) -> None:
        """Draw particles around a fix with every heading; what is bias and what is place, nobody knows yet."""
        bias = self._config.gps_bias_sigma_m * self._level
        self._draw(fix, np.sqrt(bias**2 + self._white), None)
        assert self._position is not None
        # Given the place, the bias is what the fix adds to it, but for the white noise.
        share = bias**2 / (bias**2 + self._white)
        self._bias = share * (fix - self._position)
        self._bias_variance = share * self._white

    def _contradicts(self, innovation: FloatArray, variance: FloatArray) -> bool:
        """Whether the fix is improbable even for the particles' own spread (innovation gate, 99.9 %)."""
        weight = self._weight()
        mean = weight @ innovation
        spread = variance + weight @ (innovation - mean) ** 2
        return bool((mean**2 / spread).sum() > _CONSISTENT)

    def _weight(self) -> FloatArray:
        weight = np.exp(self._log_weight - self._log_weight.max())
        normalized: FloatArray = weight / weight.sum()
        return normalized

    def _resample_when_few_count(self) -> None:
        """Resample systematically when fewer than half the particles count: one draw, even steps."""
        weight = self._weight()
        if 1.0 / (weight @ weight) > 0.5 * self._n:
            return
        assert self._position is not None
        combs = (np.arange(self._n) + self._rng.random()) / self._n
        chosen = np.searchsorted(np.cumsum(weight), combs).clip(max=self._n - 1)
        spread = np.sqrt(weight @ (self._heading - weight @ self._heading) ** 2)
        self._position, self._bias = self._position[chosen], self._bias[chosen]
        # A little of their own spread keeps heading and scale, which nothing else moves, from dying out.
        noise = _JITTER * min(float(spread), 0.3) / self._n**0.2
        self._heading = self._heading[chosen] + noise * self._rng.standard_normal(self._n)
        self._scale = self._scale[chosen]
        self._log_weight = np.zeros(self._n)
