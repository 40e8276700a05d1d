r"""Place of a source from counts: what a detector registers of it, and the posterior by weighted particles.

A source of strength S at ``x₀`` gives the intensity ``b + S g(x; x₀)`` over a background b. `InverseSquare` is the radiation of a
point, `SteadyPlume` the Gaussian plume of a steady wind (Pasquill and Gifford; widths of Briggs 1973 for open country and neutral air)
with a loss on the way. Counts are negative binomial about ``τ (b + S g)``.

Place, strength, background and dispersion, and for a plume the error of the wind's direction and the factor on its width, are
represented by particles. A count weights them; where few carry the weight they are drawn again and moved by Markov steps along
differences of particles (Chopin 2002; ter Braak 2006). Counts that deviate together, as gusts make them, are worth fewer: the
autocorrelation of the residuals states how many, and the likelihood is raised to that share.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from survey.core import Bounds, FloatArray, IntArray
from survey.reconstruction.counts.counts import Counts

_N_PARTICLES = 1500
# Markov steps go on until a particle has moved so often on average, or so many were tried.
_MOVES, _MOST_SWEEPS = 1.5, 20
# Share of the steps that go to any place and strength of the prior.
_ANYWHERE = 0.1
_N_CENTRES = 300
_MOST_LAGS, _LEAST_PAIRS, _SEEN = 15, 8, 0.3
# Priors of the logarithms of dispersion and of the scatter of the direction: mean and standard deviation.
_DISPERSION = (math.log(0.02), 1.5)
_JITTER_DEG, _JITTER_SD = 3.0, 0.7
_GUST = (math.log(0.05), 1.2)
# Metres within which a plume has its width at the begin.
_SOURCE_M = 1.0
X, Y, STRENGTH, BACKGROUND, DISPERSION, TURN, WIDTH, JITTER, GUST = range(9)
"""Columns of particles: place [m]; logarithms of strength, background and dispersion; of a plume the turn of the wind [rad], and the
logarithms of the factor on its width, of the standard deviation of the direction of a single count [rad], and of the dispersion that
gusts give to the plume alone."""


class Signal(NamedTuple):
    """Intensity (K, N) of a source of strength 1 at N counts for K particles, and its relative variance."""

    unit: FloatArray
    variance: FloatArray


class Response(Protocol):
    """What a detector registers of a source of strength 1."""

    @property
    def own_prior(self) -> tuple[FloatArray, FloatArray]:
        """Means and standard deviations of parameters of its own: the columns of the particles after the dispersion."""

    def of(self, counts: Counts, particles: FloatArray) -> Signal:
        """Return the intensity at the counts."""


@dataclass(frozen=True)
class InverseSquare:
    """Radiation of a point on the ground: ``exp(-a r) / r²``.

    Parameters
    ----------
    height_m : float
        Height of the detector above the ground of the source [m].
    absorption_per_m : float
        Absorption by air [1/m]: 0.0095 for the 662 keV of caesium 137.

    Notes
    -----
    Ground between source and detector, and heights that differ, are not modelled.
    """

    height_m: float = 0.5
    absorption_per_m: float = 0.0095

    @property
    def own_prior(self) -> tuple[FloatArray, FloatArray]:
        """No parameters of its own."""
        return np.zeros(0), np.zeros(0)

    def of(self, counts: Counts, particles: FloatArray) -> Signal:
        """Return the intensity of strength 1: that at 1 m without absorption."""
        intensity = _inverse_square(counts.xy, particles, self.height_m, self.absorption_per_m)
        return Signal(intensity, np.zeros((1, 1)))


@njit(cache=True, fastmath=True)
def _inverse_square(
    xy: FloatArray, particles: FloatArray, height_m: float, absorption_per_m: float
) -> FloatArray:
    """Return ``exp(-a r) / r²`` (K, N) for K particles at N places."""
    intensity = np.empty((len(particles), len(xy)))
    for k in range(len(particles)):
        for i in range(len(xy)):
            square = (xy[i, 0] - particles[k, X]) ** 2 + (xy[i, 1] - particles[k, Y]) ** 2 + height_m**2
            intensity[k, i] = math.exp(-absorption_per_m * math.sqrt(square)) / square
    return intensity


@dataclass(frozen=True)
class SteadyPlume:
    """Gaussian plume of a source at the ground in a steady wind.

    Parameters
    ----------
    height_m : float
        Height of the detector above the ground [m].
    half_life_s : float
        Half-life of what is emitted [s]; infinite without decay.
    turn_sd_deg, width_sd : float
        Prior standard deviations of the error of the measured direction [deg], and of the logarithm of the factor on the plume's widths.

    Notes
    -----
    The wind is that which was measured with each count, turned by one angle. Buildings, slopes and gusts are not modelled; gusts
    appear as dispersion.
    """

    height_m: float = 1.0
    half_life_s: float = math.inf
    turn_sd_deg: float = 10.0
    width_sd: float = 0.4

    @property
    def own_prior(self) -> tuple[FloatArray, FloatArray]:
        """Turn of the wind, factor on the width, scatter of the direction, and gusts."""
        mean = np.array([0.0, 0.0, math.log(math.radians(_JITTER_DEG)), _GUST[0]])
        return mean, np.array([math.radians(self.turn_sd_deg), self.width_sd, _JITTER_SD, _GUST[1]])

    def of(self, counts: Counts, particles: FloatArray) -> Signal:
        """Return the intensity of strength 1: that of 1 per second, taken up in a flow of 1 m³/s."""
        assert counts.wind_m_s is not None
        loss_per_s = math.log(2.0) / self.half_life_s
        return Signal(*_plume(counts.xy, counts.wind_m_s, particles, self.height_m, loss_per_s))


@njit(cache=True)
def _plume(
    xy: FloatArray, wind: FloatArray, particles: FloatArray, height_m: float, loss_per_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the Gaussian plume (K, N) for K particles at N places in the wind (N, 2) measured there, and its relative variance.

    The variance is that of gusts, and of a direction which errs for each count by itself, to first order.
    """
    intensity = np.zeros((len(particles), len(xy)))
    variance = np.zeros((len(particles), len(xy)))
    for k in range(len(particles)):
        cosine, sine, factor = (
            math.cos(particles[k, TURN]),
            math.sin(particles[k, TURN]),
            math.exp(particles[k, WIDTH]),
        )
        jitter, gusts = math.exp(particles[k, JITTER]), math.exp(particles[k, GUST])
        for i in range(len(xy)):
            east = cosine * wind[i, 0] - sine * wind[i, 1]
            north = sine * wind[i, 0] + cosine * wind[i, 1]
            speed = max(math.hypot(east, north), 0.1)
            dx, dy = xy[i, 0] - particles[k, X], xy[i, 1] - particles[k, Y]
            down = (dx * east + dy * north) / speed
            if down <= -_SOURCE_M:
                continue
            across = (dy * east - dx * north) / speed
            s = max(down, 0.0) + _SOURCE_M
            wide = factor * 0.08 * s / math.sqrt(1.0 + 1e-4 * s) + 0.3
            high = factor * 0.06 * s / math.sqrt(1.0 + 1.5e-3 * s) + 0.3
            exponent = 0.5 * (across / wide) ** 2 + 0.5 * (height_m / high) ** 2 + loss_per_s * s / speed
            intensity[k, i] = math.exp(-exponent) / (math.pi * wide * high * speed)
            turned = (jitter * across * s / wide**2) ** 2 + 0.5 * (jitter * s / wide) ** 4
            variance[k, i] = gusts + turned
    return intensity, variance


@njit(cache=True, fastmath=True)
def _log_likelihood(  # noqa: PLR0917 - compiled functions take no keywords
    n: FloatArray,
    exposure_s: FloatArray,
    power: FloatArray,
    unit: FloatArray,
    variance: FloatArray,
    particles: FloatArray,
) -> FloatArray:
    """Return the sums (K,) of powers of the log likelihoods of counts (N,), given the intensity (K, N) of strength 1."""
    total = np.zeros(len(particles))
    for k in range(len(particles)):
        background, strength = math.exp(particles[k, BACKGROUND]), math.exp(particles[k, STRENGTH])
        everywhere = math.exp(particles[k, DISPERSION])
        base = math.lgamma(1.0 / everywhere)
        for i in range(len(n)):
            signal = strength * unit[k, i]
            mu = exposure_s[i] * (background + signal)
            dispersion, constant = everywhere, base
            r = 1.0 / dispersion
            if variance.size > 1 and variance[k, i] > 0.0:
                dispersion += variance[k, i] * (signal / (background + signal)) ** 2
                r = 1.0 / dispersion
                constant = math.lgamma(r)
            total[k] += power[i] * (
                math.lgamma(n[i] + r)
                - constant
                + n[i] * math.log(dispersion * mu)
                - (n[i] + r) * math.log1p(dispersion * mu)
            )
    return total


@dataclass(frozen=True)
class SourcePrior:
    """Prior distribution of a source.

    Parameters
    ----------
    bounds : (xmin, ymin, xmax, ymax)
        Rectangle that holds the source [m]; all places in it are equally likely.
    strength, background_per_s : (float, float)
        Least and largest strength, and background [1/s]; all orders of magnitude between are equally likely.
    """

    bounds: Bounds
    strength: tuple[float, float]
    background_per_s: tuple[float, float]

    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper limits (4,) of place and logarithms of strength and background."""
        low = np.array([*self.bounds[:2], math.log(self.strength[0]), math.log(self.background_per_s[0])])
        high = np.array([*self.bounds[2:], math.log(self.strength[1]), math.log(self.background_per_s[1])])
        return low, high


class Belief(NamedTuple):
    """Posterior of a source: K particles, their weights, and the share to which the likelihood is raised.

    Parameters
    ----------
    particles : (K, 5) or (K, 9) ndarray
        Columns as `X`, `Y`, `STRENGTH`, ... name them.
    weights : (K,) ndarray
        Weights, which sum to 1.
    share : float
        Independent counts per count.
    """

    particles: FloatArray
    weights: FloatArray
    share: float

    def within(self, radius_m: float) -> tuple[FloatArray, float]:
        """Return the place (2,) [m] with the largest probability within a radius [m], and that probability."""
        xy = self.particles[:, :2]
        centres = xy[np.argsort(-self.weights)[:_N_CENTRES]]
        tree = cKDTree(xy)
        chances = np.array([self.weights[one].sum() for one in tree.query_ball_point(centres, radius_m)])
        best = tree.query_ball_point(centres[int(chances.argmax())], radius_m)
        middle = np.average(xy[best], axis=0, weights=self.weights[best])
        chance = float(self.weights[tree.query_ball_point(middle, radius_m)].sum())
        return middle, chance

    @property
    def spread_m(self) -> FloatArray:
        """Standard deviations (2,) of easting and northing [m]."""
        xy = self.particles[:, :2]
        mean = np.average(xy, axis=0, weights=self.weights)
        spread: FloatArray = np.sqrt(np.average((xy - mean) ** 2, axis=0, weights=self.weights))
        return spread


@dataclass
class SourceSearch:
    """Particles of one source, conditioned on one count after the other.

    Parameters
    ----------
    response : Response
        What the detector registers of the source.
    prior : SourcePrior
        Prior distribution of the source.
    rng : numpy.random.Generator
        Stream of the particles.

    Notes
    -----
    There is one source. Two of them, or a place outside the prior's rectangle, appear as one at a wrong place.
    """

    response: Response
    prior: SourcePrior
    rng: np.random.Generator
    counts: Counts | None = None

    def __post_init__(self) -> None:
        self._share = 1.0
        self._particles = self._drawn()
        self._log_weights = np.zeros(len(self._particles))
        self._power = np.zeros(0 if self.counts is None else len(self.counts))

    @property
    def belief(self) -> Belief:
        """Posterior given all counts so far."""
        weights = np.exp(self._log_weights - self._log_weights.max())
        return Belief(self._particles, weights / weights.sum(), self._share)

    def add(self, new: Counts) -> None:
        """Condition on more counts."""
        self.counts = new if self.counts is None else self.counts + new
        self._power = np.r_[self._power, np.zeros(len(new))]
        self._condition(np.full(len(self.counts), self._share))

    def with_share(self, share: float) -> None:
        """Condition on all counts, each worth a share of one."""
        assert self.counts is not None
        self._share = share
        self._condition(np.full(len(self.counts), share))

    def _condition(self, wanted: FloatArray) -> None:
        """Bring the powers (N,) of the counts' likelihoods to those wanted, by steps that leave half of the particles their weight."""
        assert self.counts is not None
        step = 0.0
        while step < 1.0:
            gain = self._likelihood_of(self._particles, self.counts, wanted - self._power)
            step = _largest_step(self._log_weights, gain)
            self._power = wanted if step >= 1.0 else self._power + step * (wanted - self._power)
            self._log_weights = self._log_weights + step * gain
            if step < 1.0:
                self._renew()

    def independent_share(self) -> float:
        """Return the effective sample size per count, from the autocorrelation of the residuals at the particle of the largest density."""
        assert self.counts is not None
        power = np.full(len(self.counts), self._share)
        density = self._likelihood_of(self._particles, self.counts, power) + self._log_prior(self._particles)
        best, together = self._particles[[int(density.argmax())]], [1.0]
        mu, dispersion = self._expected(best, self.counts)[0], math.exp(best[0, DISPERSION])
        signal = 1.0 - self.counts.exposure_s * math.exp(best[0, BACKGROUND]) / mu
        # Gusts show in what the source gives; counts of the background alone would hide them.
        for seen in (np.ones(len(mu)), (signal > _SEEN).astype(np.float64)):
            residual = seen * (self.counts.n - mu) / np.sqrt(mu + dispersion * mu**2)
            together.append(_counts_together(residual, seen))
        return 1.0 / max(together)

    def largest_signal(self) -> float:
        """Return the largest ratio of the source's part of a count to that of the background, in the median of the particles."""
        assert self.counts is not None
        some = self.rng.choice(len(self._particles), _N_CENTRES, p=self.belief.weights)
        particles = self._particles[some]
        unit = self.response.of(self.counts, particles).unit
        ratio = np.exp(particles[:, STRENGTH] - particles[:, BACKGROUND]) * unit.max(axis=1)
        return float(np.median(ratio))

    def expected_at(self, counts: Counts, chosen: IntArray) -> FloatArray:
        """Return the expected counts (K, N) of some particles at places."""
        return self._expected(self._particles[chosen], counts)

    # -- particles ------------------------------------------------------------------------------------

    def _drawn(self) -> FloatArray:
        low, high = self.prior.limits()
        columns = [self.rng.uniform(low, high, (_N_PARTICLES, 4)), self._normal()]
        return np.concatenate(columns, axis=1)

    def _normal(self) -> FloatArray:
        centre, sd = self._normal_prior()
        return centre + sd * self.rng.standard_normal((_N_PARTICLES, len(sd)))

    def _normal_prior(self) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations of the columns with a normal prior."""
        own, own_sd = self.response.own_prior
        return np.r_[_DISPERSION[0], own], np.r_[_DISPERSION[1], own_sd]

    def _log_prior(self, particles: FloatArray) -> FloatArray:
        low, high = self.prior.limits()
        inside = ((particles[:, :4] >= low) & (particles[:, :4] <= high)).all(axis=1)
        centre, sd = self._normal_prior()
        normal = -0.5 * np.sum(((particles[:, 4:] - centre) / sd) ** 2, axis=1)
        return np.where(inside, normal, -np.inf)

    def _expected(self, particles: FloatArray, counts: Counts) -> FloatArray:
        unit = self.response.of(counts, particles).unit
        rate = np.exp(particles[:, BACKGROUND, None]) + np.exp(particles[:, STRENGTH, None]) * unit
        expected: FloatArray = counts.exposure_s * rate
        return expected

    def _likelihood_of(self, particles: FloatArray, counts: Counts, power: FloatArray) -> FloatArray:
        used = np.flatnonzero(power)
        part = Counts(
            counts.xy[used],
            counts.n[used],
            counts.exposure_s[used],
            None if counts.wind_m_s is None else counts.wind_m_s[used],
        )
        signal = self.response.of(part, particles)
        found: FloatArray = _log_likelihood(part.n, part.exposure_s, power[used], *signal, particles)
        return found

    def _renew(self) -> None:
        """Draw particles by their weights, and move them by Markov steps under the posterior with the powers of the likelihoods."""
        assert self.counts is not None
        weights, power = np.exp(self._log_weights - self._log_weights.max()), self._power
        self._log_weights = np.zeros(len(weights))
        places = (self.rng.random() + np.arange(len(weights))) / len(weights)
        chosen = np.searchsorted(np.cumsum(weights / weights.sum()), places).clip(max=len(weights) - 1)
        self._particles = self._particles[chosen]
        density = self._likelihood_of(self._particles, self.counts, power) + self._log_prior(self._particles)
        moves = 0.0
        for sweep in range(_MOST_SWEEPS):
            moved = self._proposed(sweep)
            prior = self._log_prior(moved)
            possible = np.flatnonzero(np.isfinite(prior))
            tried = np.full(len(moved), -np.inf)
            tried[possible] = self._likelihood_of(moved[possible], self.counts, power) + prior[possible]
            taken = np.log(self.rng.random(len(tried))) < tried - density
            self._particles = np.where(taken[:, None], moved, self._particles)
            density = np.where(taken, tried, density)
            moves += float(taken.mean())
            if moves >= _MOVES:
                break

    def _proposed(self, sweep: int) -> FloatArray:
        """Return particles moved along the difference of two others; every third sweep between modes, and some anywhere."""
        size = self._particles.shape[1]
        first, second = (self.rng.permutation(len(self._particles)) for _ in range(2))
        factor = 1.0 if sweep % 3 == 2 else 2.38 / math.sqrt(2.0 * size) * self.rng.uniform(0.2, 1.2)
        away = self._particles[first] - self._particles[second]
        spread = 1e-3 * (self._particles.std(axis=0) + 1e-9)
        moved: FloatArray = self._particles + factor * away + spread * self.rng.standard_normal(away.shape)
        anywhere = self.rng.random(len(moved)) < _ANYWHERE
        low, high = self.prior.limits()
        moved[anywhere] = self._particles[anywhere]
        moved[anywhere, :BACKGROUND] = self.rng.uniform(low[:3], high[:3], (int(anywhere.sum()), 3))
        return moved


def _counts_together(residual: FloatArray, seen: FloatArray) -> float:
    """Return how many successive counts deviate as one: the sum of the autocorrelation of residuals (N,) of the counts that are 1 in `seen`."""
    square, together = float(residual @ residual) / max(float(seen.sum()), 1.0), 1.0
    for lag in range(1, min(_MOST_LAGS, len(residual) // 4)):
        pairs = float(seen[lag:] @ seen[:-lag])
        if pairs < _LEAST_PAIRS or square == 0.0:
            break
        rho = float(residual[lag:] @ residual[:-lag]) / pairs / square
        if rho < 2.0 / math.sqrt(pairs):
            break
        together += 2.0 * rho
    return together


def _largest_step(log_weights: FloatArray, gain: FloatArray) -> float:
    """Return the largest share, of 1 at most, of a gain of log weights that leaves half of the particles their weight."""
    low, high = 0.0, 1.0
    if _effective(log_weights + gain) >= 0.5 * len(gain):
        return 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (
            (middle, high) if _effective(log_weights + middle * gain) >= 0.5 * len(gain) else (low, middle)
        )
    return max(low, 1e-6)


def _effective(log_weights: FloatArray) -> float:
    """Return the number of particles that carry the weight."""
    weights = np.exp(log_weights - log_weights.max())
    return float(weights.sum() ** 2 / (weights @ weights))
