"""Fourier basis of the weight-space engine, and the choice of its box and waves.

A stationary field on the site is written as a sum of real waves that are periodic on a box around it,

    f(x) = Σ_j d_j (a_j cos ω_j·x + b_j sin ω_j·x),     a_j, b_j ~ N(0, 1),

with ``d_j² = 2 S(ω_j) / (L_x L_y)`` (half of that for the constant), ω_j on the lattice of the box and S the
spectral density of the kernel.  The waves of one half plane suffice; they are stored as *runs* of neighbouring
lattice points, so that every loop over pairs of waves reads memory in order.

`resolve` chooses box and waves from tolerance, memory and the points' precision. `resolve_for_points` also serves kernels with
heavy spectral tails, Matérn and sums with a short scale, where not all waves fit.
"""

from dataclasses import dataclass
from typing import Self

import finufft
import numpy as np
import numpy.typing as npt

from survey.core import Bounds, CapacityError, FloatArray, IntArray
from survey.reconstruction.gp.kernels import Kernel

ComplexArray = npt.NDArray[np.complex128]

# Relative accuracy of the non-uniform transforms; the Gram matrix is scaled by up to 1e8 before it meets 1.
TRANSFORM_ACCURACY = 1e-12


@dataclass(frozen=True)
class FourierBox:
    """Rectangle on which the terrain is periodic: the site and a margin beyond which its opposite sides are uncorrelated.

    `centre_m` (2,): centre of the site, x and y [m]. `period_m` (2,): side lengths of the box [m].
    """

    centre_m: FloatArray
    period_m: FloatArray

    @classmethod
    def around(cls, bounds: tuple[float, float, float, float], halo_m: float) -> Self:
        """Return the box around (xmin, ymin, xmax, ymax) [m] whose far sides lie `halo_m` apart."""
        low, high = np.array(bounds[:2]), np.array(bounds[2:])
        return cls((low + high) / 2, high - low + halo_m)

    @property
    def area_m2(self) -> float:
        """Area of the box [m²]."""
        return float(np.prod(self.period_m))

    def phases(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the phases (N,) of the lowest waves along x and y [rad]."""
        scaled = (xy - self.centre_m) * (2 * np.pi / self.period_m)
        return np.ascontiguousarray(scaled[:, 0]), np.ascontiguousarray(scaled[:, 1])

    def omega(self, lattice: IntArray) -> FloatArray:
        """Return the angular frequencies (..., 2) of lattice points [rad/m]."""
        frequencies: FloatArray = lattice * (2 * np.pi / self.period_m)
        return frequencies

    def transform(self, xy: FloatArray, strengths: FloatArray, half: tuple[int, int]) -> ComplexArray:
        """Sum of ``strengths · exp(i(p·x + q·y))`` for ``|p| <= half[0]``, ``|q| <= half[1]``."""
        x, y = self.phases(xy)
        shape = (2 * half[0] + 1, 2 * half[1] + 1)
        result: ComplexArray = finufft.nufft2d1(
            x, y, strengths.astype(complex), shape, eps=TRANSFORM_ACCURACY, isign=1, nthreads=1
        )
        return result

    def evaluate(self, xy: FloatArray, coefficients: ComplexArray) -> FloatArray:
        """Return the value (N,) of ``Re Σ c exp(-i(p·x + q·y))`` at points; `coefficients` are centred on (0, 0)."""
        x, y = self.phases(xy)
        values: FloatArray = finufft.nufft2d2(
            x, y, coefficients, eps=TRANSFORM_ACCURACY, isign=-1, nthreads=1
        ).real
        return values

    def evaluate_on_axes(self, x: FloatArray, y: FloatArray, coefficients: ComplexArray) -> FloatArray:
        """Return the value (H, W) of ``Re Σ c exp(-i(p·x + q·y))`` on the nodes of two axes, by two matrix products."""
        half_p, half_q = (n // 2 for n in coefficients.shape)
        step_x, step_y = 2 * np.pi / self.period_m
        phase_x = np.outer(np.arange(-half_p, half_p + 1), (x - self.centre_m[0]) * step_x)
        phase_y = np.outer((y - self.centre_m[1]) * step_y, np.arange(-half_q, half_q + 1))
        along_x = coefficients.T @ np.exp(-1j * phase_x)
        # Only the real part of the second product is wanted, so that two real products do.
        values: FloatArray = np.cos(phase_y) @ along_x.real
        values += np.sin(phase_y) @ along_x.imag
        return values

    def derivative(self, coefficients: ComplexArray, axis: int) -> ComplexArray:
        """Return the coefficients of the derivative along x (`axis` 0) or y (1) [1/m]."""
        half = coefficients.shape[axis] // 2
        omega = np.arange(-half, half + 1) * (2 * np.pi / self.period_m[axis])
        derivative: ComplexArray = -1j * coefficients * (omega[:, None] if axis == 0 else omega)
        return derivative


@dataclass(frozen=True)
class FourierBasis:
    """Retained waves of the half plane, ordered along runs of neighbouring lattice points.

    `box`: where the waves are periodic. `lattice` (K, 2) int: lattice points (p, q); the first is (0, 0), the
    constant. `runs` (R, 2) int: first index of each run, and one past its last.
    """

    box: FourierBox
    lattice: IntArray
    runs: IntArray

    @classmethod
    def of(cls, box: FourierBox, lattice: IntArray) -> Self:
        """Return the basis of the lattice points of a half plane, given in the order of p, then q, from (0, 0)."""
        return cls(box, lattice, _runs(lattice))

    @property
    def n_modes(self) -> int:
        """Number of weights: a cosine and a sine per lattice point, and the constant."""
        return 2 * len(self.lattice) - 1

    @property
    def half(self) -> tuple[int, int]:
        """Largest |p| and |q|."""
        largest = np.abs(self.lattice).max(axis=0)
        return int(largest[0]), int(largest[1])

    @property
    def omega(self) -> FloatArray:
        """Angular frequencies (K, 2) [rad/m]."""
        return self.box.omega(self.lattice)

    def weights_of(self, transform: ComplexArray) -> FloatArray:
        """Return the cosine and sine sums (m,) from a centred transform of points that reaches this basis or further."""
        centre_p, centre_q = (n // 2 for n in transform.shape)
        sums = transform[self.lattice[:, 0] + centre_p, self.lattice[:, 1] + centre_q]
        return np.concatenate([sums.real, sums.imag[1:]])

    def coefficients_of(self, weights: FloatArray) -> ComplexArray:
        """Return the centred coefficients for `FourierBox.evaluate` from cosine and sine weights (m,)."""
        (half_p, half_q), n = self.half, len(self.lattice)
        coefficients = np.zeros((2 * half_p + 1, 2 * half_q + 1), dtype=complex)
        waves = weights[:n] + 1j * np.concatenate([[0.0], weights[n:]])
        coefficients[self.lattice[:, 0] + half_p, self.lattice[:, 1] + half_q] = waves
        return coefficients

    def doubled(self, per_wave: FloatArray) -> FloatArray:
        """Repeat a value per wave (K,) for its cosine and its sine (m,)."""
        return np.concatenate([per_wave, per_wave[1:]])


def _runs(lattice: IntArray) -> IntArray:
    """Return the bounds (R, 2) of the stretches in which q rises by one at constant p."""
    steps = np.diff(lattice, axis=0)
    breaks = np.flatnonzero((steps[:, 0] != 0) | (steps[:, 1] != 1)) + 1
    starts = np.concatenate([[0], breaks])
    return np.stack([starts, np.append(breaks, len(lattice))], axis=-1).astype(np.int64)


# Largest |p| or |q| of a wave of the mean; its transforms are then 1,024 squared.
LARGEST_HALF = 256
# Iterations of the solver for the mean (`MeanSystem`).
MAX_ITERATIONS = 200
TOLERABLE = 0.05
"""Error of a mean that has not settled, in posterior standard deviations, above which it is refused."""
# A share of the prior variance in the discarded waves that is still fine relief, not terrain.
LARGEST_TAIL = 0.02
# Widest margin over the side of the site, where waves are few or the surface is rough: a wider one takes waves that
# the relief needs.
_WIDEST_HALO = 0.75
# Covariance over variance below which images of a place do not count, and the most images to each side.
_FORGOTTEN, _MOST_IMAGES = 1e-9, 200


@dataclass(frozen=True)
class Resolution:
    """Box and waves of one map.

    `bounds` (xmin, ymin, xmax, ymax): the site, with its points [m]. `covariance_basis`: waves with a full
    posterior covariance; they set memory (8 m² bytes) and time (m³ operations). `mean_basis`: waves of the
    mean, a superset, almost free. `tail_m2`, `mean_tail_m2`: prior variance of the waves left out of each
    [m²]; it is treated as white noise. `tolerance_m`: error of the mean asked for [m]; that of the standard
    deviation is a tenth of it. `is_met`: whether `tail_m2` is small enough for the tolerance.  If not, the
    discarded relief is still in the predicted variance, but as noise of no extent.
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
    kernel: Kernel, bounds: Bounds, sharpest_m: float, *, tolerance_m: float, memory_mb: float
) -> Resolution:
    """Choose box and waves for one kernel as `resolve_within` does, and refuse what would not fit into memory."""
    resolution = resolve_within(kernel, bounds, sharpest_m, tolerance_m=tolerance_m, memory_mb=memory_mb)
    if resolution is None:
        box = _box(kernel, bounds, sharpest_m, tolerance_m)
        needed = _strongest(box, kernel, kernel.variance_m2 - _largest_tail_m2(sharpest_m, tolerance_m))
        shortest, (width, height) = kernel.length_scales_m[0], box.period_m
        raise CapacityError(
            f"A map of {width:.0f} m x {height:.0f} m at a length scale of {shortest:.3g} m needs "
            f"{needed.n_modes} modes ({matrix_mb(needed.n_modes):.0f} MB) where {memory_mb:.0f} MB are allowed: "
            "map it in tiles, or raise the length scale or the memory."
        )
    return resolution


def resolve_within(
    kernel: Kernel, bounds: Bounds, sharpest_m: float, *, tolerance_m: float, memory_mb: float
) -> Resolution | None:
    """Choose box and waves for one kernel; None where the waves that fit into memory leave out too much relief.

    The margin of the box is where the covariance has fallen so far that the images of the site shift the mean
    by less than the tolerance.  Waves are kept, strongest first, until the variance of the others is small
    beside the tolerance of the standard deviation times `sharpest_m`, the smallest standard deviation of the map:
    precise data resolve weaker waves.
    """
    box = _box(kernel, bounds, sharpest_m, tolerance_m)
    largest_tail = _largest_tail_m2(sharpest_m, tolerance_m)
    wanted = kernel.variance_m2 - largest_tail
    needed = _strongest(box, kernel, wanted)
    largest = modes_within(memory_mb)
    fitting = needed if needed.n_modes <= largest else _strongest(box, kernel, wanted, largest)
    tail = tail_variance(kernel, fitting)
    if tail > max(LARGEST_TAIL * kernel.variance_m2, largest_tail):
        return None
    # Waves of the mean cost little, so that a thousandth of the tail is left out of it.
    mean_basis = _strongest(box, kernel, kernel.variance_m2 - 1e-3 * largest_tail)
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


_ROUGH_DECAY = 1e-6
_MEMORY_MB = 90.0
_N_MEAN_MODES = 40_000
# Shares of the prior variance that waves left out of the mean, and of the spread, may hold; beyond, it is no map.
_LARGEST_MEAN_TAIL, _LARGEST_SPREAD_TAIL = 0.1, 0.5


def resolve_for_points(
    kernel: Kernel,
    site: Bounds,
    xy: FloatArray,
    noise_m2: FloatArray,
    *,
    tolerance_m: float,
    memory_mb: float,
) -> Resolution | None:
    """Return the resolution that meets the tolerance where one fits, else the strongest waves, else None.

    The relief of the waves left out is then in the predicted variance as noise of no
    extent: right far from points, too cautious beside them, where the nearest points
    give a better bound (`nearest_variance_bound`).
    """
    sharpest = sharpest_std_m(kernel, xy, noise_m2)
    exact = resolve_within(kernel, site, sharpest, tolerance_m=tolerance_m, memory_mb=memory_mb)
    if exact is not None and exact.is_met:
        return exact
    # On a rough surface the far side is uncorrelated: three quarters of the site suffice.
    widest = _WIDEST_HALO * max(site[2] - site[0], site[3] - site[1])
    box = FourierBox.around(site, min(widest, kernel.decay_m(_ROUGH_DECAY)))
    few, tail = _strongest_modes(box, kernel, modes_within(min(memory_mb, _MEMORY_MB)))
    many, mean_tail = _strongest_modes(box, kernel, _N_MEAN_MODES)
    if (
        mean_tail > _LARGEST_MEAN_TAIL * kernel.variance_m2
        or tail > _LARGEST_SPREAD_TAIL * kernel.variance_m2
    ):
        return None
    return Resolution(site, few, many, tail, mean_tail, tolerance_m, is_met=False)


def _strongest_modes(box: FourierBox, kernel: Kernel, n_modes: int) -> tuple[FourierBasis, float]:
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
