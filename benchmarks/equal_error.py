"""Distance at equal error: how far each pattern drives for a map of the same mean error.

Every survey is mapped by a Gaussian process that is fitted to its own samples
(squared exponential, Matérn 5/2 or 3/2, by likelihood). Curves of mean error against
distance are compared at equal errors, interpolated in logarithms, so that no pattern is
punished for whole numbers of swaths.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

import planners
from survey import Dem, Grid, Route, SurveyArea
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.reconstruction.gp.kernels import Kernel, Matern32, Matern52, SquaredExponential, Stationary
from survey.terrain import random_dem

SIDE_M = 600.0
CLASS_3_M = 0.4572
SAMPLE_STEP_M = 15.0
AREA = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), "EPSG:32608")
_FINE = Grid((0.0, 0.0, SIDE_M, SIDE_M), 5.0)
_CENTRES = Grid((10.0, 10.0, 590.0, 590.0), 20.0).xy
_SCALES_M = np.geomspace(30.0, 600.0, 15)
_VARIANCES = (0.5, 1.0, 2.0, 4.0, 8.0)
_MOST_FITTED = 160


@dataclass(frozen=True)
class Family:
    """A kind of random terrain, and how many swaths are worth trying on it."""

    name: str
    generator: str
    parameters: tuple[tuple[str, object], ...]
    is_smooth: bool
    swaths: tuple[int, ...]

    def dems(self, seed: int, n: int) -> list[Dem]:
        """Draw terrain; equal seeds give equal terrain."""
        return [
            random_dem(self.generator, _FINE, stream(seed, self.name, i), 25.0, **dict(self.parameters))
            for i in range(n)
        ]


FAMILIES = (
    Family(
        "squared exponential, 150 m",
        "squared-exponential",
        (("length_scale_m", 150.0),),
        True,
        (2, 3, 4, 5, 6, 7),
    ),
    Family(
        "squared exponential, 100 m",
        "squared-exponential",
        (("length_scale_m", 100.0),),
        True,
        (3, 4, 5, 6, 8, 10),
    ),
    Family("hills, 80 to 160 m", "gaussian_hills", (), True, (2, 3, 4, 5, 6, 8)),
    Family("Matérn 3/2, 200 m", "matern-3/2", (("length_scale_m", 200.0),), False, (3, 4, 6, 8, 10, 12)),
    Family("diamond-square", "diamond_square", (), False, (3, 4, 6, 8, 10, 12)),
)


@dataclass(frozen=True)
class Curve:
    """Mean distance [m] and errors (n_sizes, n_dems) [m] of one pattern, size by size."""

    distance_m: FloatArray
    rmse_m: FloatArray

    @property
    def mean_m(self) -> FloatArray:
        """Mean error of each size [m], made monotone so that it can be inverted."""
        return np.minimum.accumulate(self.rmse_m.mean(axis=1))

    def distance_at(self, rmse_m: FloatArray) -> FloatArray:
        """Return the distance at which a mean error is reached [m]; NaN beyond the curve."""
        order = slice(None, None, -1)
        return np.exp(
            np.interp(
                np.log(rmse_m),
                np.log(self.mean_m[order]),
                np.log(self.distance_m[order]),
                left=np.nan,
                right=np.nan,
            )
        )


def ratios(pattern: Curve, rival: Curve) -> tuple[float, float]:
    """Return the ratio of distances at Class 3, and the largest one over all errors that both reach.

    Where the two do not both reach Class 3, the middle of their common errors stands for it.
    """
    low = max(pattern.mean_m.min(), rival.mean_m.min())
    high = min(pattern.mean_m.max(), rival.mean_m.max())
    errors = np.geomspace(low * 1.0001, high * 0.9999, 41)
    at = CLASS_3_M if low < CLASS_3_M < high else float(np.sqrt(low * high))
    everywhere = pattern.distance_at(errors) / rival.distance_at(errors)
    here = pattern.distance_at(np.array([at])) / rival.distance_at(np.array([at]))
    return float(here[0]), float(np.nanmax(everywhere))


RouteMaker = Callable[[int, Sequence[Dem]], list[Route]]
"""Routes of a given number of swaths: one for all terrain, or one for each."""


def curve(make: RouteMaker, sizes: Sequence[int], dems: Sequence[Dem], noise_m: float, seed: int) -> Curve:
    """Survey all terrain at every size."""
    distances, errors = [], []
    for n in sizes:
        routes = make(n, dems)
        distances.append(np.mean([route.length_m for route in routes]))
        if len(routes) == 1:
            errors.append(surveyed(routes[0], dems, noise_m, seed)[0])
        else:
            pairs = zip(routes, dems, strict=True)
            errors.append(
                np.array(
                    [surveyed(route, [dem], noise_m, seed + i)[0][0] for i, (route, dem) in enumerate(pairs)]
                )
            )
    order = np.argsort(distances)
    return Curve(np.array(distances)[order], np.array(errors)[order])


def surveyed(
    route: Route, dems: Sequence[Dem], noise_m: float, seed: int
) -> tuple[FloatArray, list[Stationary]]:
    """Sample the same route on each terrain, fit a kernel, map, and return errors [m] and kernels."""
    xy = route.sample(SAMPLE_STEP_M).xy
    heights = np.column_stack([dem.at(xy) for dem in dems])
    heights += noise_m * stream(seed, "noise", len(xy)).standard_normal(heights.shape)
    fitted = fit(xy, heights, noise_m)
    errors = np.empty(len(dems))
    for kernel, variance in dict.fromkeys(fitted):
        mine = [i for i, found in enumerate(fitted) if found == (kernel, variance)]
        mapped = _mapped(xy, heights[:, mine], _scaled(kernel, variance), noise_m)
        actual = np.column_stack([dems[i].at(_CENTRES) for i in mine])
        errors[mine] = np.sqrt(np.mean((mapped - actual) ** 2, axis=0))
    return errors, [_scaled(kernel, variance) for kernel, variance in fitted]


def fit(xy: FloatArray, heights: FloatArray, noise_m: float) -> list[tuple[Stationary, float]]:
    """Return the likeliest unit kernel and variance of each column of heights; the noise is known."""
    part = np.linspace(0, len(xy) - 1, min(len(xy), _MOST_FITTED)).astype(int)
    y = heights[part] - heights[part].mean(axis=0)
    spread = y.var(axis=0)
    best = np.full(y.shape[1], -np.inf)
    found: list[tuple[Stationary, float]] = [(SquaredExponential(1.0, 100.0), 1.0)] * y.shape[1]
    centre = float(np.median(spread))
    for family in (SquaredExponential, Matern52, Matern32):
        for scale in _SCALES_M:
            kernel = family(1.0, float(scale))
            unit = kernel.covariance(xy[part], xy[part])
            for share in _VARIANCES:
                variance = share * centre
                likelihood = _log_likelihood(unit, y, variance, noise_m)
                for i in np.flatnonzero(likelihood > best):
                    best[i], found[i] = likelihood[i], (kernel, variance)
    return found


def _log_likelihood(unit: FloatArray, y: FloatArray, variance: float, noise_m: float) -> FloatArray:
    """Log likelihood of each column, less a constant."""
    matrix = variance * unit
    matrix[np.diag_indices(len(y))] += noise_m**2 + 1e-6 * variance
    factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    fits = (y * cho_solve(factor, y, check_finite=False)).sum(axis=0)
    result: FloatArray = -0.5 * fits - np.log(np.diag(factor[0])).sum()
    return result


def _scaled(kernel: Stationary, variance: float) -> Stationary:
    return replace(kernel, variance_m2=variance)


def _mapped(xy: FloatArray, heights: FloatArray, kernel: Kernel, noise_m: float) -> FloatArray:
    """Posterior mean (M, n_dems) [m] at the centres; the constant mean by generalised least squares."""
    matrix = kernel.covariance(xy, xy)
    matrix[np.diag_indices(len(xy))] += noise_m**2 + 1e-6 * kernel.variance_m2
    factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    ones = cho_solve(factor, np.ones(len(xy)), check_finite=False)
    mean = (ones @ heights) / ones.sum()
    weights = cho_solve(factor, heights - mean, check_finite=False)
    mapped: FloatArray = mean + kernel.covariance(_CENTRES, xy) @ weights
    return mapped


def pilot_kernel(family: Family, noise_m: float, seed: int) -> Kernel:
    """Return the covariance that pilot surveys of other terrain of the same kind agree upon."""
    dems = family.dems(seed, 9)
    pilot = planners.plan(AREA, None, planners.LawnmowerConfig(swaths=6))
    kernels = surveyed(pilot, dems, noise_m, seed)[1]
    kinds = [type(kernel) for kernel in kernels]
    kind = max(set(kinds), key=lambda k: (kinds.count(k), k.__name__))
    alike = [kernel for kernel in kernels if type(kernel) is kind]
    scale = float(np.median([kernel.length_scale_m for kernel in alike]))
    variance = float(np.median([kernel.variance_m2 for kernel in alike]))
    return replace(alike[0], variance_m2=variance, length_scale_m=scale)
