"""Gaussian random fields, drawn wave by wave from their spectrum, and conditional simulation.

Fields have a squared exponential, Matérn or power-law (fractional Brownian) covariance, or that of a kernel. Waves that
the grid does not resolve are refused. A conditional simulation is a random surface whose means over coarse cells agree
with a prior: the difference between a free draw and the prior's cells is kriged and added (Journel and Huijbregts 1978).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.linalg import cho_factor, cho_solve

from survey.core import BoolArray, FloatArray, InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.gp.kernels import Kernel, Matern32, Matern52, SquaredExponential

SpectralDensity = Callable[[FloatArray], FloatArray]

# Beyond this correlation two places count as independent: it sets how far the box is padded.
_NEGLIGIBLE = 1e-3
_LEAST_SHARE_OF_VARIANCE = 0.95


def squared_exponential_field(
    grid: Grid, rng: np.random.Generator, *, relief_m: float = 25.0, length_scale_m: float = 220.0
) -> Dem:
    r"""Draw terrain of squared-exponential covariance, on which the glacier paper's swath counts hold.

    The covariance is :math:`\exp(-h^2 / 2 l^2)` before the heights are scaled to the relief.

    `relief_m`: highest minus lowest node [m]; the lowest is at 0. `length_scale_m`: the length l [m].

    Scaling to one relief makes the variance a random number: the drawn terrain has the
    shape of the stated covariance, not its height.

    >>> grid = Grid((0.0, 0.0, 600.0, 600.0), 50.0)
    >>> dem = squared_exponential_field(grid, np.random.default_rng(1), relief_m=25.0)
    >>> dem.shape, dem.relief_m
    ((13, 13), 25.0)
    """
    return _kernel_terrain(grid, rng, SquaredExponential(1.0, length_scale_m), relief_m)


def matern_field(
    grid: Grid,
    rng: np.random.Generator,
    *,
    relief_m: float = 25.0,
    nu: float = 1.5,
    length_scale_m: float = 200.0,
) -> Dem:
    """Draw terrain with one (ν = 3/2) or two (ν = 5/2) derivatives, rougher than the squared exponential.

    Parameters
    ----------
    grid : Grid
        Nodes of the terrain.
    rng : numpy.random.Generator
        For the draw.
    relief_m : float
        Difference between the highest and the lowest node [m].
    nu : {1.5, 2.5}
        Smoothness of the Matérn covariance.
    length_scale_m : float
        Length scale of the covariance [m].

    Returns
    -------
    Dem
        On the grid.

    Examples
    --------
    >>> matern_field(Grid((0.0, 0.0, 60.0, 60.0), 2.0), np.random.default_rng(1), nu=2.5).shape
    (31, 31)
    """
    kernels = {1.5: Matern32, 2.5: Matern52}
    if nu not in kernels:
        raise InputError(f"the Matérn smoothness is {nu}; 1.5 or 2.5 was expected.")
    return _kernel_terrain(grid, rng, kernels[nu](1.0, length_scale_m), relief_m)


def fractional_brownian(
    grid: Grid, rng: np.random.Generator, *, relief_m: float = 25.0, hurst: float = 0.9
) -> Dem:
    r"""Draw self-similar terrain: fractional Brownian motion of two variables.

    The mean squared height difference grows with the distance as :math:`h^{2H}`, from a
    spectrum :math:`S(\omega) \propto \omega^{-2H-2}` [Mandelbrot, 1982].

    `relief_m`: difference between the highest and the lowest node [m].

    Waves longer than the padded box (three times the site) are missing, so the growth
    slackens over distances near the site's width.

    >>> fractional_brownian(Grid((0.0, 0.0, 60.0, 60.0), 2.0), np.random.default_rng(1)).relief_m
    25.0
    """
    if not 0.0 < hurst < 1.0:
        raise InputError(f"the Hurst exponent is {hurst}; a number between 0 and 1 was expected.")

    def density(omega: FloatArray) -> FloatArray:
        squared: FloatArray = (omega**2).sum(axis=-1)
        return np.where(squared > 0.0, np.where(squared > 0.0, squared, 1.0) ** (-hurst - 1.0), 0.0)

    xmin, ymin, xmax, ymax = grid.bounds
    heights, _ = spectral_field(grid, rng, density, padding_m=2.0 * max(xmax - xmin, ymax - ymin))
    return with_relief(grid, heights, relief_m)


def kernel_field(grid: Grid, rng: np.random.Generator, kernel: Kernel) -> FloatArray:
    """Draw heights (H, W) [m] with mean 0 and the kernel's covariance; refuse a step too coarse for it."""
    heights, variance_m2 = spectral_field(
        grid, rng, kernel.spectral_density, padding_m=kernel.decay_m(_NEGLIGIBLE)
    )
    require_resolved(grid, variance_m2 / kernel.variance_m2, kernel.length_scales_m[0])
    return heights


def spectral_field(
    grid: Grid, rng: np.random.Generator, density: SpectralDensity, *, padding_m: float
) -> tuple[FloatArray, float]:
    r"""Draw a stationary Gaussian field as a sum of waves on a box larger than the grid.

    .. math::  z(x) = \mathrm{Re} \sum_k a_k e^{i \omega_k x}, \qquad
               E|a_k|^2 \propto S(\omega_k) / A

    with A the area of the box [Shinozuka and Jan, 1972, J. Sound Vib. 25]. The box repeats
    itself; it is at least `padding_m` wider than the grid, so no two nodes of the grid
    are nearer around the box than that.

    `density`: maps angular frequencies (..., 2), east and north [rad/m], to the spectral density [m⁴], whose
    integral over the plane is (2π)² times the variance. `padding_m`: distance beyond which correlations may
    be neglected [m]. Returns `heights` (H, W): height [m], mean 0 over the draws. `variance_m2`: variance
    that the waves on the box carry [m²]: what is lost beyond the grid's shortest wave (two steps) is missing
    here.

    >>> grid = Grid((0.0, 0.0, 40.0, 40.0), 1.0)
    >>> kernel = SquaredExponential(4.0, 5.0)
    >>> heights, variance = spectral_field(
    ...     grid, np.random.default_rng(1), kernel.spectral_density, padding_m=20.0
    ... )
    >>> heights.shape, round(variance, 6)
    ((41, 41), 4.0)
    """
    (n_y, height_m), (n_x, width_m) = (_padded(nodes, grid.step_m, padding_m) for nodes in grid.shape)
    south = fft.fftfreq(n_y, 1.0 / n_y)[:, None]
    east = np.arange(n_x // 2 + 1)[None, :]
    wave_numbers = np.stack(np.broadcast_arrays(east / width_m, -south / height_m), axis=-1)
    power = density(2.0 * np.pi * wave_numbers) / (width_m * height_m)
    resolved = (np.abs(south) < n_y / 2) & (east < n_x / 2)
    power = np.where(resolved, power, 0.0)
    variance_m2 = float(power[:, 0].sum() + 2.0 * power[:, 1:].sum())
    # The waves without an east component stand once in the half plane, their mirror images too.
    power[:, 0] *= 2.0
    amplitudes = np.sqrt(power) * _waves(rng, np.abs(wave_numbers).max(axis=-1), resolved)
    heights = fft.irfft2(amplitudes, s=(n_y, n_x), norm="forward", overwrite_x=True)
    return np.ascontiguousarray(heights[: grid.shape[0], : grid.shape[1]]), variance_m2


def _padded(nodes: int, step_m: float, padding_m: float) -> tuple[int, float]:
    """Return nodes and length of the box along one axis: a whole multiple of the site at every step."""
    side_m = (nodes - 1) * step_m
    repeats = 1 + max(1, int(np.ceil(padding_m / side_m - 1e-9)))
    return repeats * (nodes - 1), repeats * side_m


def _waves(
    rng: np.random.Generator, wave_number: FloatArray, resolved: BoolArray
) -> npt.NDArray[np.complex128]:
    """Draw complex unit-variance amplitudes, the longest waves first."""
    order = np.argsort(np.where(resolved, wave_number, np.inf), axis=None, kind="stable")
    order = order[: int(resolved.sum())]
    draws = rng.standard_normal((len(order), 2)) / np.sqrt(2.0)
    amplitudes = np.zeros(wave_number.shape, dtype=np.complex128)
    amplitudes.ravel()[order] = draws[:, 0] + 1j * draws[:, 1]
    return amplitudes


def require_resolved(grid: Grid, share: float, length_m: float) -> None:
    """Refuse a grid whose shortest wave leaves out much of the field's variance."""
    if share < _LEAST_SHARE_OF_VARIANCE:
        raise InputError(
            f"nodes {grid.step_m:g} m apart hold {100.0 * share:.0f} % of the variance of terrain that is correlated "
            f"over {length_m:g} m; use a finer grid or longer waves."
        )


def with_relief(grid: Grid, heights: FloatArray, relief_m: float) -> Dem:
    """Scale heights to lie between 0 and the relief."""
    if not (np.isfinite(relief_m) and relief_m > 0.0):
        raise InputError(f"the relief is {relief_m} m; it must be greater than 0.")
    lowest, highest = float(heights.min()), float(heights.max())
    return Dem.on(grid, (heights - lowest) / (highest - lowest) * relief_m)


def _kernel_terrain(grid: Grid, rng: np.random.Generator, kernel: Kernel, relief_m: float) -> Dem:
    return with_relief(grid, kernel_field(grid, rng, kernel), relief_m)


_MOST_CELLS = 1600
_MOST_PLACES = 2500


@dataclass(frozen=True, eq=False)
class CoarseCells:
    r"""What the cells of a coarse DEM say of a stationary field: their covariance with it and among them.

    A cell shows the mean of the field over its square, with an error of its own. Means are taken over
    n × n places, three by three where there are few cells:

    .. math::  Q_{ij} = \frac{1}{n^4} \sum_{p \in i, q \in j} k(p, q) + \sigma^2 \delta_{ij}

    (block kriging, Journel and Huijbregts 1978).

    `prior`: coarse elevations; cells without a height are left out. `sigma_m`: standard deviation of a cell's
    error, independent from cell to cell [m].
    """

    prior: Dem
    sigma_m: float

    def __post_init__(self) -> None:
        n = int(np.isfinite(self.prior.elevation).sum())
        if not 9 <= n <= _MOST_CELLS:
            raise InputError(
                f"the prior has {n} known cells on the area; 9 to {_MOST_CELLS} are needed to estimate how the terrain varies, "
                "take a coarser or a finer prior."
            )

    @cached_property
    def height_m(self) -> FloatArray:
        """Heights (C,) of the known cells [m]."""
        height: FloatArray = self.prior.elevation[np.isfinite(self.prior.elevation)]
        return height

    @cached_property
    def places(self) -> FloatArray:
        """Places (C, P, 2) within each cell that its mean is taken over [m]."""
        n = int(np.clip(np.sqrt(_MOST_PLACES / len(self.height_m)), 1, 3))
        share = (np.arange(n) + 0.5) / n - 0.5
        east, north = np.meshgrid(share, share)
        offsets = self.prior.step_m * np.column_stack([east.ravel(), north.ravel()])
        centres = self.prior.xy[np.isfinite(self.prior.elevation).ravel()]
        return np.asarray(centres[:, None, :] + offsets[None, :, :], dtype=np.float64)

    def covariance(self, kernel: Kernel) -> FloatArray:
        """Return the covariance (C, C) of the cells' means, without their errors [m²].

        On a regular grid it depends on how many rows and columns two cells are apart, and on no more.
        """
        rows, columns = np.nonzero(np.isfinite(self.prior.elevation))
        apart, weight = self._within
        down = np.arange(np.ptp(rows) + 1)
        right = np.arange(-np.ptp(columns), np.ptp(columns) + 1)
        steps = self.prior.step_m * np.stack(np.meshgrid(right, -down), axis=-1)
        means = kernel.covariance_of_lag(steps[:, :, None, :] + apart) @ weight
        d_row = rows[:, None] - rows
        d_column = np.where(d_row < 0, -1, 1) * (columns[:, None] - columns)
        covariance: FloatArray = means[np.abs(d_row), d_column + np.ptp(columns)]
        return covariance

    @cached_property
    def _within(self) -> tuple[FloatArray, FloatArray]:
        """Lags (K, 2) [m] between the places of one cell and those of another at the same spot, and their shares (K,)."""
        offsets = self.places[0] - self.places[0].mean(axis=0)
        lags = (offsets[:, None] - offsets).reshape(-1, 2)
        distinct, counts = np.unique(np.round(lags, 9), axis=0, return_counts=True)
        return distinct, counts / len(lags)

    def covariance_with(self, kernel: Kernel, xy: FloatArray) -> FloatArray:
        """Return the covariance (C, M) of the cells' means with the field at places (M, 2) [m²]."""
        n, per_cell, _ = self.places.shape
        fine = kernel.covariance(self.places.reshape(-1, 2), xy)
        means: FloatArray = fine.reshape(n, per_cell, -1).mean(axis=1)
        return means

    def seen_in(self, field: Dem) -> FloatArray:
        """Return the mean (C,) of a fine field over each cell [m]."""
        n, per_cell, _ = self.places.shape
        means: FloatArray = field.at(self.places.reshape(-1, 2)).reshape(n, per_cell).mean(axis=1)
        return means


@dataclass(frozen=True, eq=False)
class ConditionalTerrain:
    """Draws terrain with a covariance that agrees with coarse cells.

    A free draw of the field is corrected by kriging the difference between what the cells show and what
    they would have shown of the draw (Journel and Huijbregts 1978, conditioning by kriging).

    `cells`: mean elevations of coarse cells [m], as measured. `kernel`: covariance of the terrain about an
    unknown constant [m²]. `grid`: nodes of the terrain, on the cells' ground.

    >>> from survey.reconstruction.gp.kernels import Matern52
    >>> coarse = Dem.on(Grid((37.5, 37.5, 562.5, 562.5), 75.0), np.arange(64.0).reshape(8, 8))
    >>> drawn = ConditionalTerrain(
    ...     CoarseCells(coarse, sigma_m=0.1), Matern52(30.0, 150.0), Grid((0.0, 0.0, 600.0, 600.0), 10.0)
    ... )
    >>> terrain = drawn.draw(np.random.default_rng(1))
    >>> bool(np.abs(drawn.cells.seen_in(terrain) - drawn.cells.height_m).max() < 1.0)
    True
    """

    cells: CoarseCells
    kernel: Kernel
    grid: Grid

    def draw(self, rng: np.random.Generator) -> Dem:
        """Return one surface."""
        return self.conditioned(Dem.on(self.wide, kernel_field(self.wide, rng, self.kernel)), rng)

    @cached_property
    def wide(self) -> Grid:
        """The nodes and a margin: cells reach half a cell beyond nodes that end at their centres."""
        xmin, ymin, xmax, ymax = self.grid.bounds
        margin = self.grid.step_m * np.ceil(self.cells.prior.step_m / self.grid.step_m)
        return Grid(
            (xmin - margin, ymin - margin, xmax + margin, ymax + margin), self.grid.step_m, self.grid.crs
        )

    def conditioned(self, free: Dem, rng: np.random.Generator) -> Dem:
        """Return a surface on the `wide` nodes corrected so that it agrees with the cells.

        `free`: any surface on the `wide` nodes [m]; relief that the cells do not show stays.
        """
        missing = self.cells.height_m - self.cells.seen_in(free)
        if np.isnan(missing).any():
            raise InputError(
                "cells of the prior lie beyond the terrain to be drawn; cut the prior to the area."
            )
        missing = missing + self.cells.sigma_m * rng.standard_normal(len(missing))
        level, weights = self._kriged(missing)
        correction = level + self._reach.T @ weights
        heights = free.at(self.grid.xy) + correction
        return Dem.on(self.grid, heights.reshape(self.grid.shape), self.cells.prior.vertical_datum)

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        covariance = self.cells.covariance(self.kernel)
        covariance[np.diag_indices(len(covariance))] += self.cells.sigma_m**2 + 1e-6 * self.kernel.variance_m2
        return cho_factor(covariance, lower=True)

    @cached_property
    def _reach(self) -> FloatArray:
        """Covariance (C, M) of the cells with the nodes."""
        nodes = self.grid.xy
        blocks = [
            self.cells.covariance_with(self.kernel, nodes[i : i + 2000]) for i in range(0, len(nodes), 2000)
        ]
        return np.hstack(blocks)

    def _kriged(self, values: FloatArray) -> tuple[float, FloatArray]:
        """Return the constant and the weights (C,) that interpolate values at the cells."""
        ones = cho_solve(self._factor, np.ones(len(values)))
        level = float(ones @ values / ones.sum())
        weights: FloatArray = cho_solve(self._factor, values - level)
        return level, weights
