"""Kernel selection by marginal likelihood, on at most 640 of the points."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.covariance.families import KernelFamily
from survey.reconstruction.gp.selection.amplitude import with_undetermined_variance
from survey.reconstruction.gp.selection.kernel_fit import (
    N_SEARCHED,
    Hyperparameters,
    KernelFit,
    SharedCovariance,
    stated_family,
)

CANDIDATES: tuple[KernelFamily, ...] = ("squared-exponential", "matern-3/2", "two-scale", "two-scale-matern")
"""What ``family = "auto"`` chooses from."""
SMOOTH_TO_ROUGH: tuple[KernelFamily, ...] = ("squared-exponential", "matern-5/2", "matern-3/2")
"""Candidates for cells of a prior, which show one scale: the error on rough ground falls slowly with the number of swaths."""

# Least longest scale over the extent of the points, where a landform scale is wanted.
_LANDFORM_SHARE = 0.08
# Families that are tried anisotropic too.
_TURNED: tuple[KernelFamily, ...] = ("two-scale-matern", "two-scale-mixed")
# Least width of the points over their length, by standard deviations, where kernels are tried anisotropic.
_LEAST_WIDTH = 0.5
# Points of the first comparison, and the number of kernels that are fitted to more of them.
_N_FIRST, _N_REFINED = 320, 3


def likeliest(
    xy: FloatArray,
    values: FloatArray,
    noise_m2: FloatArray,
    config: GaussianProcessConfig,
    shared: SharedCovariance | None = None,
    *,
    candidates: tuple[KernelFamily, ...] = CANDIDATES,
) -> Hyperparameters:
    """Fit the families that `config` allows to at most 640 of the points, and return the likeliest.

    Where the points do not determine its variance, the posterior mean of it is returned.

    Half of them come in clusters of neighbours, which determine the short scales and the
    nugget; the others are spread over all, which determines the long scale.

    Parameters
    ----------
    xy, values, noise_m2 : (N, 2), (N,) and (N,) ndarray
        Places [m], values about their mean and noise variances.
    config : GaussianProcessConfig
        The family, or ``auto``; starts of the search.
    shared : callable, optional
        Covariance of errors that points have in common; it would pass for terrain.
    candidates : tuple of str
        The families that ``auto`` chooses from.
    """
    search = KernelFit.of_few(xy, values, noise_m2, config.nugget_m, shared)
    fitted = [search.fit(family, config) for family in _families(config, candidates)]
    return with_undetermined_variance(search, max(fitted, key=_score))


def with_landforms(
    xy: FloatArray,
    values: FloatArray,
    noise_m2: FloatArray,
    config: GaussianProcessConfig,
    shared: SharedCovariance | None = None,
    *,
    candidates: tuple[KernelFamily, ...],
) -> list[Hyperparameters]:
    """Fit kernels that have a landform scale, isotropic and anisotropic ones, and return them, the likeliest first.

    The longest scale of each is at least a share of the site, so that what lies between the points does not revert to
    the mean within a few metres. Kernels are compared on 320 points, and the best three fitted to 640. The score counts
    correlated points by their effective number. Points along one line, such as a single swath, do not determine a length
    across it: kernels that are fitted to them are isotropic.

    Parameters
    ----------
    xy, values, noise_m2, config, shared
        As in `likeliest`.
    candidates : tuple of str
        The families of several scales that ``auto`` compares.
    """
    few = comparison(xy, values, noise_m2, config, shared)
    more = comparison(xy, values, noise_m2, config, shared, n_most=N_SEARCHED)
    fitted = [few.fit(family, config) for family in _families(config, candidates)]
    if config.family == "auto" and config.kernel is None and _are_wide(xy):
        fitted += [few.turned(found) for found in fitted if found.family in _TURNED]
    first = sorted((few.counted(found) for found in fitted), key=_score, reverse=True)[:_N_REFINED]
    if len(more.values) > len(few.values):
        first = [more.counted(more.refined(found)) for found in first]
    return sorted(first, key=_score, reverse=True)


def comparison(
    xy: FloatArray,
    values: FloatArray,
    noise_m2: FloatArray,
    config: GaussianProcessConfig,
    shared: SharedCovariance | None,
    *,
    n_most: int = _N_FIRST,
) -> KernelFit:
    """Return the likelihood of kernels with a landform scale, on 320 points by default.

    Parameters
    ----------
    xy, values, noise_m2, config, shared
        As in `likeliest`.
    n_most : int
        Largest number of points.
    """
    return KernelFit.of_few(
        xy, values, noise_m2, config.nugget_m, shared, n_most=n_most, landform_share=_LANDFORM_SHARE
    )


def _are_wide(xy: FloatArray) -> bool:
    """Return whether points are at least half as wide as they are long."""
    longest, widest = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    return bool(widest >= _LEAST_WIDTH * longest)


def _score(found: Hyperparameters) -> float:
    return found.score


def _families(
    config: GaussianProcessConfig, candidates: tuple[KernelFamily, ...]
) -> tuple[KernelFamily, ...]:
    return candidates if config.family == "auto" and config.kernel is None else (stated_family(config),)
