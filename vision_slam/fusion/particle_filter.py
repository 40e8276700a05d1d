r"""Online fusion of odometry with fixes by a Rao-Blackwellised particle filter.

One thing makes localization non-linear: the heading h of the odometry's frame in the world.
A particle is such a heading. Given it all else is linear and Gaussian, so that each particle
carries the mean of a Kalman filter: position p, the odometry's errors of yaw ψ, pitch θ and
scale s with what they wander about, GPS bias b, drift c and datum c₀ of the barometer, the
gyro's bias β. With d
the odometry's step, (u, v) how it answers to yaw and pitch, L its length, Δt its time,

    p ← p + d − ψ u − θ v − s d + w,           w ~ N(0, q² L)
    η ← η + n', β Δt = g + n' + ν,             (walk of the heading, held by the gyro's turn g)
    ψ ← η + e^(−L/Λ) (ψ − η) + n,              θ, s alike;  b ← e^(−Δt/T) b + n,  c alike
    z = p + b + ν,    h = p_z + c + c₀ + ν     (fix; barometer)

in the frame of the particle, the world turned by −h about the vertical. In their own frames
all particles move and see alike, and the receiver errs alike to all sides: one covariance
serves all, and a particle weighs N(ν; 0, H P Hᵀ + R). From a known heading one particle is
enough, and the filter is Kalman's. It is the smoother's estimate of the last moment when
nothing after it has been seen.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.hypotheses import GyroTurn, Hypotheses

_CONSISTENT = float(2.0 * gammaincinv(1.5, 0.9999))
_N_JUMPS = 5
# Seconds of contradiction after which an alternative position with the same heading is accepted.
_PATIENCE_S = 120.0
_TURNED_RAD = np.radians(20.0)
# The heading of the alternative must differ by more than its own uncertainty.
_TURNED_SIGMAS = 5.0


@dataclass(frozen=True)
class FilterEstimate:
    """Weighted mean and covariance of the particles at one moment.

    ``position`` (3,) [m], ``heading_rad`` turn of the odometry's frame in the world,
    ``scale`` of its steps, ``covariance`` (3, 3) of the position [m²]; ``is_lost`` while
    the particles do not agree, or fixes contradict them.
    """

    position: FloatArray
    heading_rad: float
    scale: float
    covariance: FloatArray
    is_lost: bool


class ParticleFilter:
    """Rao-Blackwellised particle filter: position of a rover from odometry steps and fixes.

    A fix that contradicts all particles is refused. After several in a row, either the
    receiver has jumped or the rover was moved. Alternative particles are then drawn around the
    fixes, with all headings, and both sets are updated, while `estimate` reports lost. If the
    alternative converges to another heading, it is accepted. If the heading is the same, the
    fixes have a constant offset, as after a jump: the alternative is accepted after two
    minutes. Fixes that agree with the first set end the alternative.

    Parameters
    ----------
    config : LocalizationConfig
        What is assumed of the sensors.
    rng : numpy.random.Generator
        Draws of the particles.
    n_particles : int
        How many headings, where the heading is not known.
    start : (3,) ndarray, optional
        Where the rover starts, as exactly as `config` says. None is a start anywhere:
        particles come from the first fix, with every heading.
    lost_m : float
        Standard deviation of the horizontal position above which the filter says lost.

    Examples
    --------
    >>> known = ParticleFilter(LocalizationConfig(), np.random.default_rng(1), start=np.zeros(3))
    >>> for _ in range(20):
    ...     known.move(np.array([0.5, 0.0, 0.0]), 0.5)
    >>> known.correct(np.array([10.2, 0.3, 0.1]))
    True
    >>> bool(abs(known.estimate().position[0] - 10.0) < 0.3)
    True
    """

    def __init__(
        self,
        config: LocalizationConfig,
        rng: np.random.Generator,
        *,
        n_particles: int = 200,
        start: FloatArray | None = None,
        lost_m: float = 5.0,
    ) -> None:
        if n_particles < 10:
            raise InputError(f"{n_particles} particles are too few for a heading; give at least 10.")
        self._config, self._rng, self._n, self._lost_m = config, rng, n_particles, lost_m
        self._current = None if start is None else Hypotheses.at(start, n_particles, config, rng)
        self._alternative: Hypotheses | None = None
        self._n_jumps, self._contradicted_s = 0, 0.0

    def move(
        self,
        step: FloatArray,
        seconds: float,
        unseen_m: float = 0.0,
        unseen_rad: float = 0.0,
        turn: GyroTurn | None = None,
    ) -> None:
        """Predict by a step of the odometry.

        Parameters
        ----------
        step : (3,) ndarray
            Motion in the frame of the odometry [m].
        seconds : float
            Its duration [s].
        unseen_m, unseen_rad : float
            Additional errors of step and heading where no image measured the motion.
        turn : GyroTurn, optional
            Turn of the gyro relative to the odometry.
        """
        for hypotheses in (self._current, self._alternative):
            if hypotheses is not None:
                hypotheses.move(step, seconds, unseen_m, unseen_rad, turn)
        if self._n_jumps:
            self._contradicted_s += seconds

    def roll(self, rolled_m: float, travel_m: float, turned_rad: float) -> None:
        """Update the scale of the odometry by the travel of the wheels during the last step.

        Parameters
        ----------
        rolled_m, travel_m : float
            Travel by wheels and by odometry [m], negative in reverse.
        turned_rad : float
            Turn of the heading during the step.
        """
        for hypotheses in (self._current, self._alternative):
            if hypotheses is not None:
                hypotheses.roll(rolled_m, travel_m, abs(turned_rad))

    def correct(self, fix: FloatArray, error_ratio: float = 1.0, along_m: FloatArray | None = None) -> bool:
        """Update the particles by a fix.

        Parameters
        ----------
        fix : (3,) ndarray
            Position of the body [m].
        error_ratio : float
            Errors of this fix over those that the configuration assumes.
        along_m : (3,) ndarray, optional
            Additional error by the clock of the fixes, in the frame of the odometry [m].

        Returns
        -------
        bool
            Whether the fix passed the gate.
        """
        if self._current is None:
            self._current = Hypotheses.anywhere(fix, self._n, self._config, self._rng, error_ratio)
            return True
        if self._current.correct(fix, _CONSISTENT, self._rng, error_ratio, along_m):
            self._alternative, self._n_jumps, self._contradicted_s = None, 0, 0.0
            return True
        self._n_jumps += 1
        if self._n_jumps >= _N_JUMPS:
            self._test_alternative(self._current, fix, error_ratio, along_m)
        return False

    def correct_height(self, height_m: float) -> None:
        """Update the particles by a height of the barometer, whose datum is unknown.

        Parameters
        ----------
        height_m : float
            Pressure altitude [m].
        """
        for hypotheses in (self._current, self._alternative):
            if hypotheses is not None:
                hypotheses.correct_height(height_m)

    def estimate(self) -> FilterEstimate:
        """Return mean and covariance of the particles.

        Returns
        -------
        FilterEstimate
            Position, heading, scale and whether the filter is lost.

        Raises
        ------
        InputError
            No fix has come yet and no start was given.
        """
        if self._current is None:
            raise InputError(
                "the filter has neither a start nor a fix; give it one before asking where it is."
            )
        position, covariance = self._current.place()
        heading, sureness = self._current.heading()
        unsure = covariance[0, 0] + covariance[1, 1] > self._lost_m**2 or sureness < 0.9
        return FilterEstimate(
            position, heading, self._current.scale(), covariance, bool(unsure or self._n_jumps > 1)
        )

    def _test_alternative(
        self, here: Hypotheses, fix: FloatArray, error_ratio: float, along_m: FloatArray | None
    ) -> None:
        """Update the alternative hypotheses by a refused fix; accept them once they are consistent."""
        alternative = self._alternative
        if alternative is None or not alternative.correct(fix, _CONSISTENT, self._rng, error_ratio, along_m):
            self._alternative = Hypotheses.anywhere(fix, self._n, self._config, self._rng, error_ratio)
            return
        heading, sureness = alternative.heading()
        _, covariance = alternative.place()
        if sureness < 0.98 or covariance[0, 0] + covariance[1, 1] > self._lost_m**2:
            return
        turned = abs(np.angle(np.exp(1j * (heading - here.heading()[0]))))
        spread = np.sqrt(-2.0 * np.log(sureness))
        if turned > max(_TURNED_RAD, _TURNED_SIGMAS * spread) or self._contradicted_s > _PATIENCE_S:
            self._current, self._alternative = self._alternative, None
            self._n_jumps, self._contradicted_s = 0, 0.0
