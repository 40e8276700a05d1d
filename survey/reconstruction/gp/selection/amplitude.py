"""Posterior mean of a kernel's variance where the points do not determine it.

The likelihood of a few points that show nothing but their own noise is greatest for a variance of 0, and a map with that
kernel would claim no error. Its posterior is broad: relief that the noise hides is possible.
"""

from dataclasses import replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.stationary import Stationary
from survey.reconstruction.gp.selection.kernel_fit import Hyperparameters, KernelFit

# Kernels that are likelier than none by less than this are not determined [nats].
_DETERMINED_NATS = 2.0
# Amplitudes over the spread of the values, length scales over the extent of the points, and the share of none.
_AMPLITUDES, _LENGTHS = np.geomspace(1e-3, 1.0, 13), np.geomspace(0.02, 1.0, 6)
_NONE = 1e-6


def with_undetermined_variance(search: KernelFit, found: Hyperparameters) -> Hyperparameters:
    """Return a fit with the posterior mean of its variance, where a variance of 0 is about as likely as the fitted one.

    Amplitudes up to the spread of the values and length scales of 2 % to 100 % of the extent have uniform priors, the
    length scales in their logarithm.

    Parameters
    ----------
    search : KernelFit
        Likelihood of the points.
    found : Hyperparameters
        Its maximum; a kernel of several scales is returned as it is.
    """
    kernel = found.kernel
    if not isinstance(kernel, Stationary) or kernel.anisotropy != 1.0:
        return found
    spread = search.spread_m2
    none = search.log_likelihood(replace(kernel, variance_m2=_NONE * spread), found.nugget_m)
    if found.log_likelihood - none > _DETERMINED_NATS:
        return found
    variance, length = (
        axis.ravel() for axis in np.meshgrid(spread * _AMPLITUDES**2, search.extent_m * _LENGTHS)
    )
    kernels = [
        replace(kernel, variance_m2=float(one), length_scale_m=float(other))
        for one, other in zip(variance, length, strict=True)
    ]
    logs = np.array([search.log_likelihood(one, found.nugget_m) for one in kernels])
    return replace(found, kernel=_averaged(kernel, variance, length, logs))


def _averaged(kernel: Stationary, variance: FloatArray, length: FloatArray, logs: FloatArray) -> Stationary:
    """Return the kernel with the mean variance, and the mean length scale that goes with it."""
    weights = np.sqrt(variance) * np.exp(logs - logs.max())
    weights /= weights.sum()
    mean = float(weights @ variance)
    log_length = float((weights * variance) @ np.log(length)) / mean
    return replace(kernel, variance_m2=mean, length_scale_m=float(np.exp(log_length)))
