"""Derivatives of a sum of covariance functions by their parameters, at the lags between pairs of points."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.kernel_sum import Sum
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.covariance.stationary import Stationary

# Relative step of the derivative of the covariance with respect to a parameter: error 1e-9.
_STEP = 1e-4
# Numbers of parameters of a part of one scaled distance: isotropic and turned.
_N_PLAIN = (2, 4)


@dataclass(frozen=True)
class Term:
    """Covariance of every pair by one part of a sum, and its derivatives by each parameter.

    A derivative is that of the covariances of pairs and that of the variance.
    """

    covariance: FloatArray
    derivatives: list[tuple[FloatArray, float]]


def term_of(part: Kernel, lags_m: FloatArray) -> Term:
    """Return the term of one part of a sum at lags (N, 2) [m]."""
    if isinstance(part, Stationary) and len(part.log_parameters) in _N_PLAIN:
        return _stationary_term(part, lags_m)
    covariance = part.covariance_of_lag(lags_m)
    derivatives = [(covariance, part.variance_m2)]
    for step in _STEP * np.eye(len(part.log_parameters))[1:]:
        above = part.with_log_parameters(part.log_parameters + step)
        below = part.with_log_parameters(part.log_parameters - step)
        change = above.covariance_of_lag(lags_m) - below.covariance_of_lag(lags_m)
        derivatives.append((change / (2 * _STEP), 0.0))
    return Term(covariance, derivatives)


def parts_of(kernel: Kernel) -> tuple[Kernel, ...]:
    """Return the parts of a sum; every part's first parameter is the logarithm of its variance."""
    return kernel.parts if isinstance(kernel, Sum) else (kernel,)


def _stationary_term(part: Stationary, lags_m: FloatArray) -> Term:
    """Return the term of a part of one scaled distance; anisotropy and angle follow from the length by the chain rule."""
    squared = part.squared_along(lags_m)
    covariance = part.covariance_of_squared(squared)
    up, down = (_longer(part, step).covariance_of_squared(squared) for step in (_STEP, -_STEP))
    by_length = (up - down) / (2 * _STEP)
    derivatives = [(covariance, part.variance_m2), (by_length, 0.0)]
    if part.anisotropy != 1.0:
        derivatives += [(one, 0.0) for one in _turned_derivatives(part, lags_m, by_length)]
    return Term(covariance, derivatives)


def _longer(part: Stationary, step: float) -> Stationary:
    """Return a part whose length scale is longer by a step of its logarithm."""
    if part.anisotropy == 1.0:
        return part.with_log_parameters(part.log_parameters + [0.0, step])
    return replace(part, length_scale_m=part.length_scale_m * float(np.exp(step)))


def _turned_derivatives(part: Stationary, lags_m: FloatArray, by_length: FloatArray) -> Iterator[FloatArray]:
    """Yield how the covariance at lags moves with log anisotropy and angle."""
    along, across = part._along_and_across(lags_m)
    wide = np.square(part.anisotropy * across)
    scaled = by_length / np.maximum(np.square(along) + wide, 1e-12)
    yield -scaled * wide
    yield scaled * along * across * (part.anisotropy**2 - 1.0)
