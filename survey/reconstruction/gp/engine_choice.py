r"""Choice of the Gaussian-process engine by what each engine would need, and conditioning with it.

`choose_engine` computes memory and convergence before any engine is built, in this order:

1. the dense engine for few points, where its cubic work is small (or where it is stated);
2. one solve in Fourier waves, where the covariance of enough waves fits the memory and their mean can converge;
3. tiles in Fourier waves, where those of one tile with its halo do, for smooth covariances;
4. neighbourhoods, which need the same small memory for every site: for Matérn's class, under which near points screen
   those farther away (Stein 2002), and for all others that fit nowhere else.

The mean takes more waves than the covariance holds, by conjugate gradients which the covariance preconditions
(`MeanSystem`). On the waves beyond it the fit_process number is about

.. math::  \kappa = 1 + \max S(\omega) \; \max \rho(x)

with the spectral density S of these waves [m⁴] and the information ρ of the points [1/m⁴], the sum of 1 / noise variance
over an area. `expected_error` follows from it. It excludes the means that cannot converge; between these and the ones that
surely do, convergence depends on how the points lie, and the engine that was built states it.
"""

from typing import Any, Literal, NamedTuple

import numpy as np

from survey.core import Bounds, FloatArray, Progress
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engines.fourier_basis import (
    MAX_ITERATIONS,
    Resolution,
    line_variances,
    resolve_for_points,
    resolve_within,
    sharpest_std_m,
)
from survey.reconstruction.gp.engines.regression import (
    DenseGaussianProcess,
    NoisyValues,
    Process,
    TrendName,
    dense_mb,
)
from survey.reconstruction.gp.engines.tiles import N_NEAREST, TileGrid
from survey.reconstruction.gp.families import parts_of
from survey.reconstruction.gp.kernels import Kernel, Matern

EngineName = Literal["gp", "dense"]
"""The fast engine, which depends on the size of the task, or the dense one."""
Division = Literal["tiled", "local"]
"""The engines that solve parts of the site one by one."""
Engine = Literal["dense", "fourier"] | Division
"""The engine that was chosen."""
# Up to this many points the dense factorization is the cheaper one: about 450 at a length scale of 18 m on 600 × 600 m.
# With few nodes it is for more: their number times the square of that of the points, and the most points.
_N_DENSE, _DENSE_WORK, _MOST_DENSE = 400, 3e10, 2500
# Means with a larger estimate do not converge. Measured on squared exponentials, Matérn kernels and sums, with 450 to
# 30,000 points at random and on swaths: those that converged had estimates up to 7e4, because few points converge
# earlier than the bound.
_HOPELESS = 1e6


class EngineTask(NamedTuple):
    """Points to fit_process on, as far as the choice of the engine depends on them.

    `xy` (N, 2) [m], `noise_m2` (N,) [m²]: places and noise variances of the points. `site` (xmin, ymin, xmax, ymax):
    extent of map and points [m]. `tolerance_m`: largest error of the mean that the waves may add [m]. `memory_mb`:
    memory that the covariance of the waves may take [MB]. `n_nodes`: number of nodes of the map, None where it is
    not known.
    """

    kernel: Kernel
    xy: FloatArray
    noise_m2: FloatArray
    site: Bounds
    tolerance_m: float
    memory_mb: float
    n_nodes: int | None = None

    @property
    def limits(self) -> dict[str, float]:
        """Tolerance and memory, as arguments."""
        return {"tolerance_m": self.tolerance_m, "memory_mb": self.memory_mb}

    @property
    def sharpest_m(self) -> float:
        """Order of the smallest standard deviation of the map [m]."""
        return sharpest_std_m(self.kernel, self.xy, self.noise_m2)


class EngineChoice(NamedTuple):
    """Engine for a task, and why.

    `reason`: why it was chosen. `needed_mb`: memory of its largest matrix [MB]. `resolution`: waves of one solve.
    `tiles`: division of the site. `is_stated`: whether it was stated, and nothing may be interpolated.
    """

    engine: Engine
    reason: str
    needed_mb: float
    resolution: Resolution | None = None
    tiles: TileGrid | None = None
    is_stated: bool = False

    @property
    def division(self) -> Division | None:
        """The engine where it solves parts of the site one by one."""
        return self.engine if self.engine in ("tiled", "local") else None

    def record(self) -> dict[str, Any]:
        """Return the reason and the memory, for the record."""
        return {"reason": self.reason, "needed_mb": self.needed_mb}


class DividedSiteError(Exception):
    """A site that one solve does not hold, where only one solve is of use."""


class Conditioned(NamedTuple):
    """A process conditioned on points, and the choice of its engine."""

    process: Process
    choice: EngineChoice


def is_little_work(n: int, n_nodes: int | None) -> bool:
    """Return whether the dense engine is the cheaper one for n points and as many nodes as are known."""
    return n <= _N_DENSE or (n_nodes is not None and n <= _MOST_DENSE and n**2 * n_nodes <= _DENSE_WORK)


def choose_engine(
    task: EngineTask, *, is_dense: bool = False, division: Division | None = None
) -> EngineChoice:
    """Choose the engine by what each would need; `is_dense` states the dense one, `division` one that divides."""
    n = len(task.xy)
    if is_dense or is_little_work(n, task.n_nodes):
        few = f"there are no more than {_N_DENSE} points" if n <= _N_DENSE else f"{n} points have few nodes"
        reason = "the dense engine was stated" if is_dense else few
        return EngineChoice("dense", reason, dense_mb(n), is_stated=is_dense)
    if division == "local":
        return choose_local(task, "neither one solve nor tiles did for these points before")
    if division == "tiled":
        return choose_divided(task, "one solve did not do for these points before")
    resolution = resolve_for_points(task.kernel, task.site, task.xy, task.noise_m2, **task.limits)
    if resolution is None:
        return choose_divided(task, f"the waves of the site do not fit {task.memory_mb:g} MB")
    if not can_converge(task, resolution):
        return choose_divided(task, "the mean of the site's waves cannot converge")
    reason = f"{resolution.n_modes} waves of the site fit {task.memory_mb:g} MB"
    return EngineChoice("fourier", reason, resolution.memory_mb, resolution)


def choose_divided(task: EngineTask, reason: str) -> EngineChoice:
    """Choose tiles, or neighbourhoods where no tile fits, the one with the most points cannot converge, or near points screen others."""
    if all(isinstance(part, Matern) for part in parts_of(task.kernel)):
        return choose_local(task, f"{reason}, and near points screen those farther away")
    tiles = TileGrid.largest_within(task.kernel, task.site, task.sharpest_m, **task.limits)
    if tiles is None:
        return choose_local(task, f"{reason}, and no tile fits the memory")
    fullest = _fullest_tile(task, tiles)
    needed = resolve_within(task.kernel, fullest.site, fullest.sharpest_m, **task.limits)
    if needed is None or not can_converge(fullest, needed):
        return choose_local(task, f"{reason}, nor can that of the tile with the most points")
    return EngineChoice("tiled", reason, needed.memory_mb, tiles=tiles)


def choose_local(task: EngineTask, reason: str) -> EngineChoice:
    """Choose neighbourhoods, whose memory does not depend on the task."""
    return EngineChoice("local", reason, dense_mb(min(N_NEAREST, len(task.xy))))


def _fullest_tile(task: EngineTask, tiles: TileGrid) -> EngineTask:
    """Return the part of a task in the tile that holds the most points, with those in its halo."""
    tile, _ = tiles.fullest(task.xy)
    near = tiles.near(tile, task.xy)
    data = NoisyValues(task.xy[near], np.zeros((int(near.sum()), 0)), task.noise_m2[near])
    return task._replace(xy=data.xy, noise_m2=data.noise_m2, site=data.extent(tiles.bounds(tile)))


def can_converge(task: EngineTask, resolution: Resolution) -> bool:
    """Return whether the mean may converge within the largest number of iterations."""
    return expected_error(task, resolution) <= _HOPELESS


def expected_error(task: EngineTask, resolution: Resolution) -> float:
    r"""Return the expected error of the mean after the last iteration n, in posterior standard deviations.

    .. math::  2 e_0 \left( \frac{\sqrt\kappa - 1}{\sqrt\kappa + 1} \right)^n, \qquad
               e_0^2 = (\kappa - 1) \sum_i \frac{k(0)}{\sigma_i^2}

    the bound of conjugate gradients (Saad 2003, section 6.11), from the energy of data as large as the prior.
    """
    kappa = condition_number(task, resolution)
    start = np.sqrt((kappa - 1.0) * np.sum(task.kernel.variance_m2 / task.noise_m2))
    rate = (np.sqrt(kappa) - 1.0) / (np.sqrt(kappa) + 1.0)
    return float(2.0 * start * rate**MAX_ITERATIONS)


def condition_number(task: EngineTask, resolution: Resolution) -> float:
    """Return κ of the waves of the mean beyond those of the covariance; 1 where there are none."""
    mean, held = resolution.mean_basis, resolution.covariance_basis
    places = np.array([2 * mean.half[1] + 1, 1])
    beyond = ~np.isin(mean.lattice @ places, held.lattice @ places)
    if not beyond.any():
        return 1.0
    density = line_variances(task.kernel, mean)[beyond].max() * mean.box.area_m2
    # In cells of half the shortest wavelength: points that are closer together are one place to the waves.
    cell_m = np.pi / np.abs(mean.omega).max()
    cells = np.floor((task.xy - task.xy.min(axis=0)) / cell_m).astype(np.int64)
    _, index = np.unique(cells, axis=0, return_inverse=True)
    information = np.bincount(index.ravel(), weights=1.0 / (task.noise_m2 + resolution.mean_tail_m2))
    return float(1.0 + density * information.max() / cell_m**2)


def fit_process(
    engine: EngineName,
    kernel: Kernel,
    xy: FloatArray,
    values: FloatArray,
    sigma_m: FloatArray,
    *,
    bounds: Bounds | None,
    trend: TrendName,
    config: GaussianProcessConfig,
    progress: Progress | None = None,
    n_nodes: int | None = None,
    may_divide: bool = True,
    division: Division | None = None,
) -> Conditioned:
    """Condition on points with the dense engine, or with the one that the size of the task demands.

    `division`: engine that was needed for these points before; no other one is tried first. Raise `DividedSiteError` for a task that needs parts unless `may_divide`.
    """
    data = NoisyValues.of(xy, values, sigma_m)
    task = EngineTask(
        kernel, data.xy, data.noise_m2, data.extent(bounds), config.tolerance_m, config.memory_mb, n_nodes
    )
    choice = choose_engine(task, is_dense=engine == "dense", division=division)
    points = xy, values, sigma_m, kernel
    if choice.engine == "dense":
        return Conditioned(DenseGaussianProcess.fit(*points, trend=trend), choice)
    # Here, because compiling support costs half a second that other methods need not pay.
    from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
    from survey.reconstruction.gp.engines.local_gp import LocalGaussianProcess
    from survey.reconstruction.gp.engines.tiled_gp import TiledGaussianProcess

    if choice.engine == "fourier":
        one = FourierGaussianProcess.solve(*points, bounds=bounds, trend=trend, resolution=choice.resolution)
        if one.has_converged:
            return Conditioned(one, choice)
        choice = choose_divided(task, "the mean of the site's waves did not converge")
    if not may_divide:
        raise DividedSiteError
    if choice.engine == "tiled":
        tiled = TiledGaussianProcess.fit(
            *points,
            bounds=bounds,
            trend=trend,
            tolerance_m=task.tolerance_m,
            memory_mb=task.memory_mb,
            tiles=choice.tiles,
            progress=progress,
        )
        if tiled.has_converged:
            return Conditioned(tiled, choice)
        choice = choose_local(task, f"{choice.reason}, nor did that of the tile with the most points")
    local = LocalGaussianProcess.fit(*points, bounds=bounds, trend=trend, progress=progress)
    return Conditioned(local, choice)
