"""Choice of box and waves for kernels with heavy spectral tails: Matérn, and sums with a short scale."""

import numpy as np

from survey.core.arrays import Bounds, FloatArray, IntArray
from survey.core.errors import CapacityError
from survey.reconstruction.gp.covariance.kernels import Kernel
from survey.reconstruction.gp.engines.fourier.resolution import (
    LARGEST_HALF,
    Resolution,
    modes_within,
    resolve,
    sharpest_std_m,
)
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis, FourierBox

# On a rough surface the far side is uncorrelated: three quarters of the site suffice.
_LARGEST_HALO = 0.75
_FORGOTTEN = 1e-6
_MEMORY_MB = 90.0
_N_MEAN_MODES = 40_000
# Shares of the prior variance that waves left out of the mean, and of the spread, may hold; beyond, it is no map.
_LARGEST_MEAN_TAIL, _LARGEST_TAIL = 0.1, 0.5


def resolution_for(
    kernel: Kernel,
    site: Bounds,
    xy: FloatArray,
    noise_m2: FloatArray,
    *,
    tolerance_m: float,
    memory_mb: float,
) -> Resolution:
    """Return the resolution that meets the tolerance where one fits, else the strongest waves that do.

    The relief of the waves left out is then in the predicted variance as noise of no
    extent: right far from points, too cautious beside them, where the nearest points
    give a better bound (`variance_from_nearest`).

    Raises
    ------
    CapacityError
        When the waves that fit would leave out a tenth of the prior variance of the mean, or half of the spread's.
    """
    sharpest = sharpest_std_m(kernel, xy, noise_m2)
    try:
        exact = resolve(kernel, site, sharpest, tolerance_m=tolerance_m, memory_mb=memory_mb)
    except CapacityError:
        exact = None
    if exact is not None and exact.is_met:
        return exact
    widest = _LARGEST_HALO * max(site[2] - site[0], site[3] - site[1])
    box = FourierBox.around(site, min(widest, kernel.decay_m(_FORGOTTEN)))
    few, tail = _strongest(box, kernel, modes_within(min(memory_mb, _MEMORY_MB)))
    many, mean_tail = _strongest(box, kernel, _N_MEAN_MODES)
    if mean_tail > _LARGEST_MEAN_TAIL * kernel.variance_m2 or tail > _LARGEST_TAIL * kernel.variance_m2:
        raise CapacityError(
            f"a map of {site[2] - site[0]:.0f} × {site[3] - site[1]:.0f} m at a length scale of "
            f"{kernel.length_scales_m[0]:.3g} m needs more than the {memory_mb:.0f} MB allowed; it is mapped in tiles."
        )
    return Resolution(site, few, many, tail, mean_tail, tolerance_m, is_met=False)


def _strongest(box: FourierBox, kernel: Kernel, n_modes: int) -> tuple[FourierBasis, float]:
    """Return the strongest waves of a box, and the variance of those left out [m²]."""
    lattice = _half_plane(box, kernel)
    variance = kernel.spectral_density(box.omega(lattice)) / box.area_m2
    weakest = np.sort(variance)[::-1][min(n_modes // 2, len(lattice) - 1)]
    # Waves as strong as the weakest kept one stay too, so that no direction is preferred.
    kept = variance >= weakest * (1 - 1e-9)
    kept[0] = True
    outside = max(kernel.variance_m2 - float(2 * variance.sum() - variance[0]), 0.0)
    return FourierBasis.of(box, lattice[kept]), float(2 * variance[~kept].sum()) + outside


def _half_plane(box: FourierBox, kernel: Kernel) -> IntArray:
    """Return the lattice out to forty times the shortest length scale's frequency, or what a transform holds."""
    reach = 40.0 / kernel.length_scales_m[0]
    half = np.minimum(np.ceil(reach * box.period_m / (2 * np.pi)), LARGEST_HALF).astype(np.int64)
    p, q = np.meshgrid(np.arange(half[0] + 1), np.arange(-half[1], half[1] + 1), indexing="ij")
    lattice = np.stack([p.ravel(), q.ravel()], axis=-1)
    plane: IntArray = lattice[(lattice[:, 0] > 0) | (lattice[:, 1] >= 0)]
    return plane
