"""Hyperparameters by maximum marginal likelihood: one family, or the likeliest of several."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds as Limits
from scipy.optimize import minimize

from survey.core.arrays import Bounds, FloatArray
from survey.core.errors import InputError
from survey.reconstruction.gp.covariance.kernels import Kernel, Matern32, Matern52, SquaredExponential, Sum
from survey.reconstruction.gp.engines.evidence import MarginalLikelihood
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend, TrendName
from survey.reconstruction.gp.engines.resolution import affordable_basis, modes_within, sharpest_std_m


class Stage(NamedTuple):
    """How many waves an evaluation may use: those that the tolerance asks for, within two caps."""

    tolerance: float  # of the mean, in units of the map's smallest standard deviation
    memory_mb: float
    modes_per_point: float  # waves shorter than the points are dense act on them as noise


COARSE = Stage(3.0, 24.0, 1.0)
POLISH = Stage(0.3, 75.0, 4.0)
# Length scales tried, in units of the one given.
_START_FACTORS = (0.5, 1.0, 2.0)
# A gain in log likelihood, or a slope of it, at which a climb ends.
_ENOUGH = 0.03


@dataclass(frozen=True)
class FittedKernel:
    """Hyperparameters at a maximum of the marginal likelihood.

    Parameters
    ----------
    kernel : Kernel
        Covariance function with its fitted parameters.
    nugget_m2 : float
        Fitted variance of relief without extent, to be added to the noise [m²]; 0 if not fitted.
    noise_scale : float
        Factor on the stated standard deviations; 1 if not fitted.
    log_likelihood : float
        Log marginal likelihood there.
    n_parameters : int
        Number of fitted parameters.
    n_points : int
        Number of points fitted to.
    n_evaluations : int
        Evaluations of the likelihood that it took.
    """

    kernel: Kernel
    nugget_m2: float
    noise_scale: float
    log_likelihood: float
    n_parameters: int
    n_points: int
    n_evaluations: int

    @property
    def penalized(self) -> float:
        """Log likelihood less ``½ P log N`` (Schwarz 1978), by which families are compared."""
        return self.log_likelihood - 0.5 * self.n_parameters * float(np.log(self.n_points))

    def sigma_m(self, sigma_m: FloatArray) -> FloatArray:
        """Return the standard deviations for the process, from the stated ones (N,) [m]."""
        noise: FloatArray = np.sqrt((self.noise_scale * sigma_m) ** 2 + self.nugget_m2)
        return noise


@dataclass(frozen=True)
class KernelFit:
    """What is fitted to what.

    Parameters
    ----------
    data : NoisyValues
        The points.
    bounds : (xmin, ymin, xmax, ymax)
        The site, with its points [m].
    trend : {"none", "constant", "plane"}
        Mean whose coefficients are integrated out.
    shortest_length_m : float
        Lower bound of every length scale [m]; a step below costs its inverse sixth power in time.
    with_nugget, with_noise_scale : bool
        Whether a white variance, and a factor on the stated standard deviations, are fitted too.
    """

    data: NoisyValues
    bounds: Bounds
    trend: TrendName
    shortest_length_m: float
    with_nugget: bool = False
    with_noise_scale: bool = False

    def objective(self, theta: FloatArray, kernel: Kernel, stage: Stage) -> tuple[float, FloatArray]:
        """Negative log likelihood and its gradient at the kernel's parameters and those of the noise."""
        n_kernel = len(kernel.parameter_names)
        kernel = kernel.with_log_parameters(theta[:n_kernel])
        nugget, scale = self.noise_parameters(theta[n_kernel:])
        stated = self.data.noise_m2
        n_modes = min(modes_within(stage.memory_mb), int(stage.modes_per_point * len(self.data)) + 200)
        sharpest = self._sharpest_m
        basis = affordable_basis(kernel, self.bounds, sharpest, stage.tolerance * sharpest, n_modes)
        trend = PolynomialTrend(self.trend, basis.box)
        extra = (scale**2 - 1) * stated + nugget
        evidence = MarginalLikelihood.of(kernel, basis, self.data, trend, extra)
        gradient = [evidence.kernel_gradient]
        if self.with_nugget:
            gradient.append(np.array([nugget * evidence.noise_gradient.sum()]))
        if self.with_noise_scale:
            gradient.append(np.array([2 * scale**2 * float(evidence.noise_gradient @ stated)]))
        return -evidence.value, -np.concatenate(gradient)

    def noise_parameters(self, theta: FloatArray) -> tuple[float, float]:
        """Nugget [m²] and noise factor from the end of the parameter vector."""
        values = list(np.exp(theta))
        nugget = float(values.pop(0)) if self.with_nugget else 0.0
        return nugget, float(values.pop(0)) if self.with_noise_scale else 1.0

    @cached_property
    def _sharpest_m(self) -> float:
        """Smallest standard deviation of a map with waves as short as allowed; the same in a whole fit."""
        prior = SquaredExponential(float(np.var(self.data.values)) + 1e-12, 2 * self.shortest_length_m)
        nugget = 0.002 * prior.variance_m2 if self.with_nugget else 0.0
        return sharpest_std_m(prior, self.data.xy, self.data.noise_m2 + nugget)

    def limits(self, kernel: Kernel) -> Limits:
        """Box in which the optimizer stays."""
        variance = float(np.var(self.data.values)) + 1e-12
        longest = 3 * max(self.bounds[2] - self.bounds[0], self.bounds[3] - self.bounds[1])
        by_name = {
            "log variance_m2": (np.log(1e-4 * variance), np.log(1e2 * variance)),
            "log length_scale_m": (np.log(self.shortest_length_m), np.log(longest)),
            "log anisotropy": (-np.log(5.0), np.log(5.0)),
            "angle_rad": (-np.pi, np.pi),
            "log(shape - 1)": (-2.0, 3.0),
        }
        # the parameters of a sum carry the number of their part
        pairs = [
            by_name[name.rstrip("0123456789").rstrip() if name not in by_name else name]
            for name in kernel.parameter_names
        ]
        if self.with_nugget:
            pairs.append((np.log(1e-4 * float(self.data.noise_m2.min())), np.log(variance)))
        if self.with_noise_scale:
            pairs.append((np.log(0.2), np.log(5.0)))
        low, high = zip(*pairs, strict=True)
        return Limits(np.array(low), np.array(high))

    def maximize(self, start: Kernel) -> FittedKernel:
        """Climb from several length scales with few waves, then from the best place with more."""
        limits = self.limits(start)
        places = [np.clip(theta, limits.lb, limits.ub) for theta in self._starts(start)]
        values = [self.objective(theta, start, COARSE)[0] for theta in places]
        order = np.argsort(values)[:2]
        climbs = [self._climb(places[k], start, COARSE, 30) for k in order]
        best = min(climbs, key=lambda climb: climb[1])
        final = self._climb(best[0], start, POLISH, 8)
        n_evaluations = len(values) + sum(climb[2] for climb in climbs) + final[2]
        n_kernel = len(start.parameter_names)
        nugget, scale = self.noise_parameters(final[0][n_kernel:])
        kernel = start.with_log_parameters(final[0][:n_kernel])
        return FittedKernel(kernel, nugget, scale, -final[1], len(final[0]), len(self.data), n_evaluations)

    def _starts(self, start: Kernel) -> list[FloatArray]:
        """Parameter vectors with all length scales halved, kept and doubled."""
        lengths = np.array(["length_scale_m" in name for name in start.parameter_names])
        noise = []
        if self.with_nugget:
            noise.append(float(np.log(0.02 * np.var(self.data.values) + 1e-12)))
        if self.with_noise_scale:
            noise.append(0.0)
        return [
            np.concatenate([start.log_parameters + np.log(factor) * lengths, noise])
            for factor in _START_FACTORS
        ]

    def _climb(
        self, theta: FloatArray, kernel: Kernel, stage: Stage, n_steps: int
    ) -> tuple[FloatArray, float, int]:
        """Return the place, the objective there, and the evaluations of one climb."""
        _, slope = self.objective(theta, kernel, stage)
        # The optimizer's first step is the gradient: half a unit of a logarithm is a step, thousands are a leap.
        scale = 0.5 / max(float(np.linalg.norm(slope)), 1.0)

        def scaled(place: FloatArray) -> tuple[float, FloatArray]:
            value, gradient = self.objective(place, kernel, stage)
            return scale * value, scale * gradient

        found = minimize(
            scaled,
            theta,
            jac=True,
            method="L-BFGS-B",
            bounds=self.limits(kernel),
            options={"maxiter": n_steps, "ftol": _ENOUGH * scale, "gtol": _ENOUGH * scale},
        )
        return np.asarray(found.x, dtype=np.float64), float(found.fun) / scale, int(found.nfev) + 1


def fit_kernel(
    xy: FloatArray,
    values: FloatArray,
    sigma_m: FloatArray,
    start: Kernel,
    *,
    bounds: Bounds | None = None,
    trend: TrendName = "none",
    shortest_length_m: float | None = None,
    with_nugget: bool = False,
    with_noise_scale: bool = False,
) -> FittedKernel:
    """Fit the hyperparameters of one family by its marginal likelihood.

    Parameters
    ----------
    xy, values, sigma_m : (N, 2), (N,), (N,) ndarray
        Points as in `FourierGaussianProcess.fit` [m].
    start : Kernel
        The family, and where to begin.  A kernel with an anisotropy other than 1 has it fitted.
    bounds, trend : optional
        As in `FourierGaussianProcess.fit`.
    shortest_length_m : float, optional
        Lower bound of the length scales [m]; by default the shortest that 6,000 waves resolve.
    with_nugget, with_noise_scale : bool
        Whether white relief, and a factor on the stated standard deviations, are fitted too.

    Raises
    ------
    InputError
        For fewer than 3 points, or points that cannot be used.

    Notes
    -----
    The optimum is local; three length scales are tried, and the better two climbed from.  Spectra that decay
    slowly are fitted with the relief of the discarded waves as noise.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> xy = rng.uniform(0, 100, (60, 2))
    >>> values = np.sin(xy[:, 0] / 15) + 0.05 * rng.standard_normal(60)
    >>> fitted = fit_kernel(xy, values, np.full(60, 0.05), SquaredExponential(1.0, 20.0))
    >>> bool(15 < fitted.kernel.length_scales_m[0] < 60)
    True
    """
    data = NoisyValues.of(xy, values, sigma_m)
    if len(data) < 3:
        raise InputError(f"{len(data)} points cannot tell a length scale; give at least 3, or fixed values.")
    site = data.extent(bounds)
    shortest = shortest_length_m or shortest_resolved_m(site)
    return KernelFit(data, site, trend, shortest, with_nugget, with_noise_scale).maximize(start)


def choose_kernel(
    xy: FloatArray,
    values: FloatArray,
    sigma_m: FloatArray,
    *,
    bounds: Bounds | None = None,
    trend: TrendName = "none",
    shortest_length_m: float | None = None,
    with_nugget: bool = False,
    with_noise_scale: bool = False,
) -> tuple[FittedKernel, ...]:
    """Fit squared exponential, Matérn 3/2 and 5/2 and two scales; the likeliest, penalized, comes first.

    Parameters and errors are those of `fit_kernel`.
    """
    data = NoisyValues.of(xy, values, sigma_m)
    site = data.extent(bounds)

    def fit(start: Kernel) -> FittedKernel:
        return fit_kernel(
            data.xy,
            data.values,
            np.sqrt(data.noise_m2),
            start,
            bounds=site,
            trend=trend,
            shortest_length_m=shortest_length_m,
            with_nugget=with_nugget,
            with_noise_scale=with_noise_scale,
        )

    variance = float(np.var(data.values)) + 1e-12
    length = 0.06 * max(site[2] - site[0], site[3] - site[1])
    single = [fit(family(variance, length)) for family in (SquaredExponential, Matern32, Matern52)]
    smooth = single[0].kernel
    v, scale = smooth.variance_m2, smooth.length_scales_m[0]
    double = fit(Sum(SquaredExponential(v, 1.5 * scale), SquaredExponential(0.05 * v, 0.6 * scale)))
    return tuple(sorted([*single, double], key=lambda fitted: -fitted.penalized))


def shortest_resolved_m(bounds: Bounds) -> float:
    """Length scale [m] of a squared exponential that 6,000 waves resolve to a few parts in a thousand."""
    area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    cut, n_modes = 3.5, 6000
    return max(cut * float(np.sqrt(area / (4 * np.pi * n_modes))), 1e-3)
