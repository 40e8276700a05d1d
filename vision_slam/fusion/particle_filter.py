"""Online fusion of odometry with fixes by a Rao-Blackwellised particle filter.

The heading h of the odometry's frame in the world makes localization non-linear. A particle is such a heading. Given h
all else is linear and Gaussian, so that each particle carries the mean of a Kalman filter (`Hypotheses`): position p, the
odometry's errors of yaw ψ, pitch θ and scale s with their slow parts η, GPS bias b, drift c and datum c₀ of the barometer,
the gyro's bias β. With d the odometry's step, (u, v) its derivatives by yaw and pitch, L its length, Δt its time,

    p ← p + d − ψ u − θ v − s d + w,           w ~ N(0, q² L)
    η ← η + n', β Δt = g + n' + ν,             (random walk of the heading, measured by the gyro's turn g)
    ψ ← η + e^(−L/Λ) (ψ − η) + n,              θ, s alike;  b ← e^(−Δt/T) b + n,  c alike
    z = p + b + ν,    h = p_z + c + c₀ + ν     (fix; barometer)

in the frame of the particle, the world turned by −h about the vertical. In their own frames all particles have the same
transition and measurement matrices and isotropic errors of the receiver: one covariance serves all, and a particle has the
weight N(ν; 0, H P Hᵀ + R). With a known heading one particle is enough, and the filter is a Kalman filter. Its estimate is
that of the smoother for the last moment.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import gammaincinv

from survey.core import FloatArray, InputError
from vision_slam.config import LocalizationConfig
from vision_slam.motion import ANY_RATE_RAD_S, GyroErrors

_YAW, _PITCH, _SCALE, _DRIFT = 3, 4, 5, 9
_PLACE, _BIAS = slice(0, 3), slice(6, 9)
_HEADING, _PITCH_BIAS, _MEAN_SCALE, _DATUM, _WHEEL_SCALE, _SKID, _GYRO = range(10, 17)
_N_STATES = 17
_TURNS = [_YAW, _HEADING]
_UNKNOWN_M = 1e3
_DATUM_SIGMA_M = 1e4
# Beyond this the states are linearized about the estimated heading again.
_BENT_RAD = np.radians(0.3)
# Wheels that differ from the odometry by more standard deviations than this spin.
_SPINS = 4.0
_TICK_M = 1e-3
# Hypotheses whose log weight is farther below the best than this do not count at the gate.
_COUNTS = 7.0
_ANY_RAD = np.radians(30.0)


@dataclass(frozen=True)
class GyroTurn:
    """Turn of the gyro during a step, relative to the odometry, and the turn of the odometry [rad]."""

    beyond_rad: float
    turned_rad: float


class Hypotheses:
    """N headings (N,) with log weights (N,), means (N, 17) in the frame of each, and the covariance of all.

    The frame of a heading is the world turned by it about the vertical through `origin`.
    """

    def __init__(
        self,
        origin: FloatArray,
        heading_rad: FloatArray,
        heading_sigma_rad: float,
        place_sigma_m: float,
        config: LocalizationConfig,
    ) -> None:
        n = len(heading_rad)
        self._origin, self._heading = np.asarray(origin, dtype=np.float64), heading_rad
        self._log_weight = np.zeros(n)
        self._mean = np.zeros((n, _N_STATES))
        self._model = _Model(config)
        self._covariance = self._model.prior(place_sigma_m, heading_sigma_rad)

    @classmethod
    def at(cls, start: FloatArray, n: int, config: LocalizationConfig, rng: np.random.Generator) -> Self:
        """Return the hypotheses of a start: one for a known heading, else all headings."""
        place_m, heading_rad = config.start_errors
        if heading_rad < _ANY_RAD:
            return cls(start, np.zeros(1), heading_rad, place_m, config)
        return cls(start, *_all_around(n, rng), place_m, config)

    @classmethod
    def anywhere(
        cls,
        fix: FloatArray,
        n: int,
        config: LocalizationConfig,
        rng: np.random.Generator,
        error_ratio: float = 1.0,
    ) -> Self:
        """Return hypotheses of all headings at a fix, whose bias and position are not separable yet."""
        drawn = cls(fix, *_all_around(n, rng), _UNKNOWN_M, config)
        drawn.correct(fix, np.inf, rng, error_ratio)
        return drawn

    def move(
        self, step: FloatArray, seconds: float, unseen_m: float, unseen_rad: float, turn: GyroTurn | None
    ) -> None:
        """Predict: move by the odometry's step (3,) [m]."""
        transition, noise = self._model.motion(step, seconds)
        # The heading walks, and is off for good after a turn that nothing saw.
        walked = unseen_rad**2 + self._model.gyro.heading_walk * float(np.linalg.norm(step))
        gyro_rad = 0.0
        if turn is not None and walked > 0.0:
            share = self._hold(turn, seconds, walked)
            transition[_TURNS, _GYRO] = share * seconds
            gyro_rad, walked = -share * turn.beyond_rad, (1.0 - share) * walked
        self._mean = self._mean @ transition.T
        self._mean[:, _PLACE] += step
        self._mean[:, _TURNS] += gyro_rad
        self._covariance = transition @ self._covariance @ transition.T
        noise[_PLACE] += unseen_m**2
        self._covariance[np.diag_indices(_N_STATES)] += noise
        self._covariance[np.ix_(_TURNS, _TURNS)] += walked

    def _hold(self, turn: GyroTurn, seconds: float, walked: float) -> float:
        """Update the gyro bias β by a step; return the share of the heading walk n that the gyro measures.

        Beyond the odometry it turns by g = β Δt − n + ν: of the bias g says β Δt = g, with the
        variances of n and ν; given the bias n is q/(q + r) (β Δt − g), with q and r these variances.
        """
        noise = float(self._model.gyro.variance(seconds, turn.turned_rad))
        sees = np.zeros(_N_STATES)
        sees[_GYRO] = seconds
        self._update(sees, turn.beyond_rad - self._mean @ sees, walked + noise)
        return walked / (walked + noise)

    def correct(
        self,
        fix: FloatArray,
        gate: float,
        rng: np.random.Generator,
        error_ratio: float = 1.0,
        along_m: FloatArray | None = None,
    ) -> bool:
        """Update by a fix (3,) [m]; return whether it passed the gate.

        A fix whose squared Mahalanobis distance from all likely hypotheses exceeds the gate
        changes nothing. Its bias and white error are those of the model times `error_ratio`;
        `along_m` (3,) is the error by the clock of the fixes, in the frame of the odometry.
        """
        sees = _SEES_FIX.copy()
        sees[:, _BIAS] *= error_ratio
        innovation = self._innovation(fix, sees)
        seen = self._covariance @ sees.T
        spread = sees @ seen + np.diag(error_ratio**2 * self._model.fix_variance)
        if along_m is not None:
            spread += np.outer(along_m, along_m)
        precision = np.asarray(np.linalg.inv(spread), dtype=np.float64)
        misfit = np.einsum("ni,ni->n", innovation @ precision, innovation)
        if misfit[self._log_weight > self._log_weight.max() - _COUNTS].min() > gate:
            return False
        self._take(innovation, misfit, seen, precision)
        self._resample_when_few_count(rng)
        self._straighten()
        return True

    def correct_height(self, height_m: float) -> None:
        """Update by a height of the barometer [m]."""
        innovation = height_m - self._origin[2] - self._mean @ _SEES_HEIGHT
        self._update(_SEES_HEIGHT, innovation, self._model.height_variance)

    def roll(self, rolled_m: float, step_m: float, turned_rad: float) -> None:
        """Update the scale by the travel of the wheels, negative in reverse, unless they spin."""
        sees = np.zeros(_N_STATES)
        sees[[_WHEEL_SCALE, _SCALE, _SKID]] = step_m, -step_m, turned_rad
        variance = self._model.roll_variance(abs(step_m), turned_rad)
        innovation = (rolled_m - step_m) - self._mean @ sees
        if np.abs(innovation).min() < _SPINS * np.sqrt(sees @ self._covariance @ sees + variance):
            self._update(sees, innovation, variance)

    def place(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean position (3,) and its covariance (3, 3) in the world."""
        weight, turn = self._weight(), _turns(self._heading)
        each = (turn @ self._mean[:, _PLACE, None])[:, :, 0]
        mean = weight @ each
        off = each - mean
        own = turn @ self._covariance[_PLACE, _PLACE] @ turn.transpose(0, 2, 1)
        covariance: FloatArray = np.tensordot(weight, own, axes=1) + (weight[:, None] * off).T @ off
        return self._origin + mean, covariance

    def heading(self) -> tuple[float, float]:
        """Return the mean turn of the odometry's frame in the world [rad], and how much they agree on it, 0 to 1."""
        each = np.exp(1j * (self._heading - self._mean[:, _YAW]))
        mean = self._weight() @ each
        own = float(self._covariance[_YAW, _YAW])
        return float(np.angle(mean)), float(abs(mean) * np.exp(-0.5 * own))

    def scale(self) -> float:
        """Return the mean of what the odometry's steps are to be multiplied by."""
        return float(1.0 - self._weight() @ self._mean[:, _SCALE])

    def _innovation(self, fix: FloatArray, sees: FloatArray) -> FloatArray:
        seen = np.einsum("nji,j->ni", _turns(self._heading), fix - self._origin)
        innovation: FloatArray = seen - self._mean @ sees.T
        return innovation

    def _update(self, sees: FloatArray, innovation: FloatArray, variance: float) -> None:
        """Correct by a number of which each hypothesis has another innovation (N,)."""
        seen = self._covariance @ sees[:, None]
        precision = np.array([[1.0 / (sees @ seen[:, 0] + variance)]])
        self._take(innovation[:, None], innovation**2 * precision[0, 0], seen, precision)

    def _take(
        self, innovation: FloatArray, misfit: FloatArray, seen: FloatArray, precision: FloatArray
    ) -> None:
        """Apply Kalman's correction, whose gain all hypotheses share."""
        gain = seen @ precision
        self._log_weight -= 0.5 * misfit
        self._mean += innovation @ gain.T
        left = self._covariance - gain @ seen.T
        self._covariance = 0.5 * (left + left.T)

    def _weight(self) -> FloatArray:
        if len(self._log_weight) == 1:
            return np.ones(1)
        weight = np.exp(self._log_weight - self._log_weight.max())
        normalized: FloatArray = weight / weight.sum()
        return normalized

    def _resample_when_few_count(self, rng: np.random.Generator) -> None:
        """Resample systematically when fewer than half the particles count: one draw, even steps."""
        weight, n = self._weight(), len(self._heading)
        if 1.0 / (weight @ weight) > 0.5 * n:
            return
        combs = (np.arange(n) + rng.random()) / n
        chosen = np.searchsorted(np.cumsum(weight), combs).clip(max=n - 1)
        self._heading, self._mean = self._heading[chosen], self._mean[chosen]
        self._log_weight = np.zeros(n)

    def _straighten(self) -> None:
        """Move the estimated constant heading error into the heading, so that the remaining error stays small."""
        found = self._mean[:, _HEADING].copy()
        middle = float(self._weight() @ found)
        if abs(middle) < _BENT_RAD:
            return
        self._heading = self._heading - found
        turn = _turns(found)
        for part in (_PLACE, _BIAS):
            self._mean[:, part] = np.einsum("nij,nj->ni", turn, self._mean[:, part])
        self._mean[:, _YAW] -= found
        self._mean[:, _HEADING] = 0.0
        rotation = np.eye(_N_STATES)
        rotation[_PLACE, _PLACE] = rotation[_BIAS, _BIAS] = _turns(np.array([middle]))[0]
        self._covariance = rotation @ self._covariance @ rotation.T


class _Model:
    """Process and measurement noise of the linear states."""

    def __init__(self, config: LocalizationConfig) -> None:
        level = np.array([1.0, 1.0, config.gps_vertical_factor])
        self._config = config
        self._bias = (config.gps_bias_sigma_m * level) ** 2
        self._yaw, self._pitch = np.radians([config.yaw_sigma_deg, config.tilt_sigma_deg]) ** 2
        self.gyro = GyroErrors.of(config)
        self.fix_variance: FloatArray = (config.gps_white_sigma_m * level) ** 2
        self.height_variance = config.barometer_white_sigma_m**2

    def prior(self, place_sigma_m: float, heading_sigma_rad: float) -> FloatArray:
        """Return the prior covariance (17, 17)."""
        config = self._config
        variance = np.zeros(_N_STATES)
        variance[_PLACE], variance[_BIAS] = place_sigma_m**2, self._bias
        variance[_DRIFT], variance[_DATUM] = config.barometer_drift_sigma_m**2, _DATUM_SIGMA_M**2
        variance[_HEADING] = heading_sigma_rad**2
        variance[_PITCH_BIAS] = np.radians(config.tilt_bias_sigma_deg) ** 2
        variance[_MEAN_SCALE], variance[_WHEEL_SCALE] = config.scale_sigma**2, config.wheel_scale_sigma**2
        variance[_SKID], variance[_GYRO] = config.wheel_skid_m**2, ANY_RATE_RAD_S**2
        covariance = np.diag(variance)
        for changing, mean, own in (
            (_YAW, _HEADING, self._yaw),
            (_PITCH, _PITCH_BIAS, self._pitch),
            (_SCALE, _MEAN_SCALE, config.scale_wander_sigma**2),
        ):
            covariance[changing, changing] = own + variance[mean]
            covariance[changing, mean] = covariance[mean, changing] = variance[mean]
        return covariance

    def motion(self, step: FloatArray, seconds: float) -> tuple[FloatArray, FloatArray]:
        """Transition (17, 17) and variances (17,) of the noise, of a step that took so long."""
        config = self._config
        length = float(np.linalg.norm(step))
        transition, noise = np.eye(_N_STATES), np.zeros(_N_STATES)
        level = float(np.hypot(step[0], step[1]))
        ahead = step[:2] / level if level > 0.0 else np.zeros(2)
        transition[_PLACE, _YAW] = step[1], -step[0], 0.0
        transition[_PLACE, _PITCH] = -ahead[0] * step[2], -ahead[1] * step[2], level
        transition[_PLACE, _SCALE] = -step
        noise[_PLACE] = config.step_sigma_m**2 * length
        for changing, mean, memory, variance in (
            (_YAW, _HEADING, np.exp(-length / config.attitude_correlation_m), self._yaw),
            (_PITCH, _PITCH_BIAS, np.exp(-length / config.attitude_correlation_m), self._pitch),
            (_SCALE, _MEAN_SCALE, np.exp(-length / config.scale_wander_m), config.scale_wander_sigma**2),
        ):
            transition[changing, changing], transition[changing, mean] = memory, 1.0 - memory
            noise[changing] = (1.0 - memory**2) * variance
        bias = np.exp(-seconds / config.gps_correlation_time_s)
        drift = np.exp(-seconds / config.barometer_correlation_time_s)
        transition[_BIAS, _BIAS] = bias * np.eye(3)
        transition[_DRIFT, _DRIFT] = drift
        noise[_BIAS] = (1.0 - bias**2) * self._bias
        noise[_GYRO] = self.gyro.bias_walk * seconds
        noise[_DRIFT] = (1.0 - drift**2) * config.barometer_drift_sigma_m**2
        return transition, noise

    def roll_variance(self, step_m: float, turned_rad: float) -> float:
        """Return the variance of the wheels' travel, beyond what lasts."""
        config = self._config
        straight = config.wheel_step_sigma_m**2 * step_m
        return straight + config.wheel_skid_m**2 * turned_rad + _TICK_M**2


def _all_around(n: int, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Draw headings (N,) evenly around the circle; return also their spacing [rad]."""
    spacing = 2.0 * np.pi / n
    return (np.arange(n) + rng.random(n)) * spacing - np.pi, spacing


def _turns(angle_rad: FloatArray) -> FloatArray:
    """Return turns (N, 3, 3) about the vertical."""
    turn = np.zeros((len(angle_rad), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle_rad)
    turn[:, 1, 0] = np.sin(angle_rad)
    turn[:, 0, 1] = -turn[:, 1, 0]
    turn[:, 2, 2] = 1.0
    return turn


def _sees(*parts: int | slice, n_rows: int) -> FloatArray:
    rows = np.zeros((n_rows, _N_STATES))
    for part in parts:
        rows[:, part] = np.eye(n_rows) if isinstance(part, slice) else 1.0
    return rows


_SEES_FIX = _sees(_PLACE, _BIAS, n_rows=3)
_SEES_HEIGHT = _sees(2, _DRIFT, _DATUM, n_rows=1)[0]


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

    `config`: what is assumed of the sensors. `rng`: draws of the particles. `n_particles`: how many headings,
    where the heading is not known. `start` (3,): where the rover starts, as exactly as `config` says. None is
    a start anywhere: particles come from the first fix, with every heading. `lost_m`: standard deviation of
    the horizontal position above which the filter says lost.

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

        `step` (3,): motion in the frame of the odometry [m]. `seconds`: its duration [s].
        """
        for hypotheses in (self._current, self._alternative):
            if hypotheses is not None:
                hypotheses.move(step, seconds, unseen_m, unseen_rad, turn)
        if self._n_jumps:
            self._contradicted_s += seconds

    def roll(self, rolled_m: float, travel_m: float, turned_rad: float) -> None:
        """Update the scale of the odometry by the travel of the wheels during the last step.

        `rolled_m`, `travel_m`: travel by wheels and by odometry [m], negative in reverse.
        """
        for hypotheses in (self._current, self._alternative):
            if hypotheses is not None:
                hypotheses.roll(rolled_m, travel_m, abs(turned_rad))

    def correct(self, fix: FloatArray, error_ratio: float = 1.0, along_m: FloatArray | None = None) -> bool:
        """Update the particles by a fix.

        `fix` (3,): position of the body [m]. `along_m` (3,): additional error by the clock of the fixes, in
        the frame of the odometry [m].
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

        `height_m`: pressure altitude [m].
        """
        for hypotheses in (self._current, self._alternative):
            if hypotheses is not None:
                hypotheses.correct_height(height_m)

    def estimate(self) -> FilterEstimate:
        """Return mean and covariance of the particles."""
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
