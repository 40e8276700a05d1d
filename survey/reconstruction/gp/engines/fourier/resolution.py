"""Choice of box and waves of the Fourier engine from tolerance, memory and the points' precision."""

from dataclasses import dataclass

import numpy as np

from survey.core.arrays import Bounds, FloatArray, IntArray
from survey.core.errors import CapacityError
from survey.reconstruction.gp.covariance.stationary import Kernel
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis, FourierBox

# Largest |p| or |q| of a wave of the mean; its transforms are then 1,024 squared.
LARGEST_HALF = 256
# A share of the prior variance in the discarded waves that is still fine relief, not terrain.
LARGEST_TAIL = 0.02
# Widest margin over the side of the site, where waves are few: a wider one takes waves that the relief needs.
_WIDEST_HALO = 0.75
# Covariance over variance below which images of a place do not count, and the most images to each side.
_FORGOTTEN, _MOST_IMAGES = 1e-9, 200


@dataclass(frozen=True)
class Resolution:
    """Box and waves of one map.

    Parameters
    ----------
    bounds : (xmin, ymin, xmax, ymax)
        The site, with its points [m].
    covariance_basis : FourierBasis
        Waves with a full posterior covariance; they set memory (8 m² bytes) and time (m³ operations).
    mean_basis : FourierBasis
        Waves of the mean, a superset, almost free.
    tail_m2, mean_tail_m2 : float
        Prior variance of the waves left out of each [m²]; it is treated as white noise.
    tolerance_m : float
        Error of the mean asked for [m]; that of the standard deviation is a tenth of it.
    is_met : bool
        Whether `tail_m2` is small enough for the tolerance.  If not, the discarded relief is still in the
        predicted variance, but as noise of no extent.
    """

    bounds: Bounds
    covariance_basis: FourierBasis
    mean_basis: FourierBasis
    tail_m2: float
    mean_tail_m2: float
    tolerance_m: float
    is_met: bool

    @property
    def box(self) -> FourierBox:
        """The box on which all waves are periodic."""
        return self.covariance_basis.box

    @property
    def n_modes(self) -> int:
        """Number of weights m with a full covariance."""
        return self.covariance_basis.n_modes

    @property
    def memory_mb(self) -> float:
        """Memory of the covariance [MB]."""
        return matrix_mb(self.n_modes)


def matrix_mb(n_modes: int) -> float:
    """Return the memory of one matrix of that many modes squared [MB]."""
    return 8e-6 * n_modes**2


def line_variances(kernel: Kernel, basis: FourierBasis) -> FloatArray:
    """Prior variance [m²] of each complex wave of the whole plane: the spectrum's mass at its lattice point."""
    return kernel.spectral_density(basis.omega) / basis.box.area_m2


def amplitudes(kernel: Kernel, basis: FourierBasis) -> FloatArray:
    """Prior standard deviation [m] of each real wave."""
    result: FloatArray = np.sqrt(2 * line_variances(kernel, basis))
    result[0] *= np.sqrt(0.5)
    return result


def tail_variance(kernel: Kernel, basis: FourierBasis) -> float:
    """Prior variance [m²] of the waves that a basis leaves out."""
    kept = float(np.sum(amplitudes(kernel, basis) ** 2))
    return max(kernel.variance_m2 - kept, 0.0)


def periodic_variance(kernel: Kernel, box: FourierBox) -> float:
    """Return the prior variance [m²] of all waves of a box: the covariances of a place with itself and all its images."""
    largest = np.minimum(np.ceil(kernel.decay_m(_FORGOTTEN) / box.period_m), _MOST_IMAGES)
    p, q = (np.arange(-n, n + 1) for n in largest)
    images = np.stack(np.meshgrid(p, q), axis=-1).reshape(-1, 2)
    return float(kernel.covariance_of_lag(images * box.period_m).sum())


def variance_left_out(kernel: Kernel, basis: FourierBasis) -> float:
    """Return the prior variance [m²] of the waves of the box that a basis leaves out, for boxes of any margin."""
    kept = float(np.sum(amplitudes(kernel, basis) ** 2))
    return max(periodic_variance(kernel, basis.box) - kept, 0.0)


def sharpest_std_m(kernel: Kernel, xy: FloatArray, noise_variance: FloatArray) -> float:
    """Order of the smallest posterior standard deviation [m]: that of the best-measured square length scale.

    Such a square has about three degrees of freedom, among which its points share their information.
    """
    cell = np.floor((xy - xy.min(axis=0)) / kernel.length_scales_m[0]).astype(np.int64)
    _, index = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True)
    shared = np.bincount(index, weights=1 / noise_variance) / np.minimum(np.bincount(index), 3)
    return float(np.sqrt(1 / (shared.max() + 1 / kernel.variance_m2)))


def resolve(
    kernel: Kernel,
    bounds: Bounds,
    sharpest_m: float,
    *,
    tolerance_m: float,
    memory_mb: float,
) -> Resolution:
    """Choose box and waves for one kernel, and refuse what would not fit into memory.

    The margin of the box is where the covariance has fallen so far that the images of the site shift the mean
    by less than the tolerance.  Waves are kept, strongest first, until the variance of the others is small
    beside the tolerance of the standard deviation times `sharpest_m`, the smallest standard deviation of the map:
    precise data resolve weaker waves.

    Raises
    ------
    CapacityError
        If the waves that fit leave out more than 2 % of the prior variance.
    """
    box = _box(kernel, bounds, sharpest_m, tolerance_m)
    largest_tail = _largest_tail_m2(sharpest_m, tolerance_m)
    wanted = kernel.variance_m2 - largest_tail
    mean_basis = _strongest(box, kernel, kernel.variance_m2 - 1e-3 * largest_tail)
    needed = _strongest(box, kernel, wanted)
    largest = modes_within(memory_mb)
    fitting = needed if needed.n_modes <= largest else _strongest(box, kernel, wanted, largest)
    tail = tail_variance(kernel, fitting)
    if tail > max(LARGEST_TAIL * kernel.variance_m2, largest_tail):
        shortest, (width, height) = kernel.length_scales_m[0], box.period_m
        raise CapacityError(
            f"A map of {width:.0f} m x {height:.0f} m at a length scale of {shortest:.3g} m needs "
            f"{needed.n_modes} modes ({matrix_mb(needed.n_modes):.0f} MB) where {memory_mb:.0f} MB are allowed: "
            "map it in tiles, or raise the length scale or the memory."
        )
    mean_tail = tail_variance(kernel, mean_basis)
    return Resolution(bounds, fitting, mean_basis, tail, mean_tail, tolerance_m, tail <= 1.001 * largest_tail)


def affordable_basis(
    kernel: Kernel, bounds: Bounds, sharpest_m: float, tolerance_m: float, n_modes: int
) -> FourierBasis:
    """Choose waves as `resolve` does, but never more than `n_modes`, and refuse nothing.

    Where they do not meet the tolerance, the margin of the box is at most three quarters of the site: landforms of a
    length beyond the site would have a box of ten times its side, whose waves are too long for what the points show.
    """
    box, tail_m2 = _box(kernel, bounds, sharpest_m, tolerance_m), _largest_tail_m2(sharpest_m, tolerance_m)
    basis = _affordable(box, kernel, tail_m2, n_modes)
    sides = np.array([bounds[2] - bounds[0], bounds[3] - bounds[1]])
    widest = _WIDEST_HALO * float(sides.max())
    is_met = variance_left_out(kernel, basis) <= 1.001 * tail_m2
    if is_met or (box.period_m - sides).max() <= widest:
        return basis
    return _affordable(FourierBox.around(bounds, widest), kernel, tail_m2, n_modes)


def modes_within(memory_mb: float) -> int:
    """Return how many modes have a covariance that fits the memory."""
    return int(np.sqrt(memory_mb / 8e-6))


def _box(kernel: Kernel, bounds: Bounds, sharpest_m: float, tolerance_m: float) -> FourierBox:
    # Measured on landmarks beside swaths: the images then shift the mean by half of the tolerance.
    ratio = 6.0 * tolerance_m * sharpest_m / kernel.variance_m2
    return FourierBox.around(bounds, kernel.decay_m(float(np.clip(ratio, 1e-9, 1e-2))))


def _largest_tail_m2(sharpest_m: float, tolerance_m: float) -> float:
    # Counted at a point and again at a node beside it, a tail adds its own size over the standard deviation.
    return 0.08 * tolerance_m * sharpest_m


def _affordable(box: FourierBox, kernel: Kernel, tail_m2: float, n_modes: int) -> FourierBasis:
    return _strongest(box, kernel, periodic_variance(kernel, box) - tail_m2, n_modes)


def _strongest(box: FourierBox, kernel: Kernel, wanted_m2: float, largest: int | None = None) -> FourierBasis:
    """Return the strongest waves that hold at least `wanted_m2`, or those of the `largest` number of modes."""
    lattice = _lattice(box, kernel, wanted_m2, largest)
    variance = kernel.spectral_density(box.omega(lattice)) / box.area_m2
    order = np.argsort(-variance, kind="stable")
    mass = np.cumsum(2 * variance[order]) - variance[0]
    n_needed = int(np.searchsorted(mass, wanted_m2)) + 1
    n_kept = min(n_needed, len(order), len(order) if largest is None else (largest + 1) // 2)
    # Waves as strong as the weakest kept one stay too, so that no direction is preferred.
    kept = variance >= variance[order[n_kept - 1]] * (1 - 1e-9)
    kept[0] = True
    return FourierBasis.of(box, lattice[kept])


def _lattice(box: FourierBox, kernel: Kernel, wanted_m2: float, largest: int | None) -> IntArray:
    """Return the half plane of lattice points out to where the spectrum holds `wanted_m2`, or amply enough."""
    reach = 4.0 / kernel.length_scales_m[0]
    while True:
        half = np.minimum(np.ceil(reach * box.period_m / (2 * np.pi)), LARGEST_HALF).astype(np.int64)
        p, q = np.meshgrid(np.arange(half[0] + 1), np.arange(-half[1], half[1] + 1), indexing="ij")
        lattice = np.stack([p.ravel(), q.ravel()], axis=-1)
        lattice = lattice[(lattice[:, 0] > 0) | (lattice[:, 1] >= 0)]
        variance = kernel.spectral_density(box.omega(lattice)) / box.area_m2
        held = 2 * variance.sum() - variance[0]
        is_ample = largest is not None and len(lattice) > 4 * largest
        if held >= wanted_m2 or is_ample or np.all(half == LARGEST_HALF):
            return lattice
        reach *= 1.2
