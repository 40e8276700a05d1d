"""Conditioning on points with one kernel or an average of several, and on the cells of a prior.

`condition_all` conditions one process for each kernel. A prior whose errors are stated is no mean: its cells are measurements
beside the points, their evidence enters the weights of the kernels, and a prior whose level contradicts the points counts
twice, with a free level and with the stated one.
"""

from typing import NamedTuple

import numpy as np
from pyproj import CRS

from survey.core import Bounds, FloatArray, Progress
from survey.data import Dem
from survey.reconstruction.gp.averaged_process import AveragedProcess
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engine_choice import (
    Conditioned,
    DividedSiteError,
    Division,
    EngineName,
    fit_process,
)
from survey.reconstruction.gp.engines.regression import NoisyValues, Process, TrendName
from survey.reconstruction.gp.kernel_average import lightened, with_evidence
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters, KernelInAverage
from survey.reconstruction.gp.prior_measurements import CellMeans, ProcessAtLevels, ProcessWithCells
from survey.reconstruction.gp.satellite_cells import JudgedCells, SatelliteCells, in_blocks, judge_cells
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.prior_likelihood import misfit_log_likelihood

# Cells that are measurements: the work for their covariance grows with the square of their number, for every kernel.
_MOST_CELLS = 500
# Kernels that are averaged where each costs a solve in Fourier waves.
_MOST_IN_WAVES = 2


class PriorMeasurements(NamedTuple):
    """A prior elevation model and the error model of its cells."""

    dem: Dem
    errors: PriorErrors

    def cells(self, crs: CRS, bounds: Bounds) -> tuple[SatelliteCells, PriorErrors]:
        """Return the cells that meet the map, in blocks where there are thousands of them."""
        dem, errors = in_blocks(self.dem, bounds, self.errors)
        return SatelliteCells.of(dem, crs, bounds, errors), errors


class ConditioningTask(NamedTuple):
    """Engine, settings, extent of the map [m], trend, prior as measurements, number of nodes, and a progress callback.

    ``division``: engine that is known to be needed since one solve will not do.
    """

    engine: EngineName
    config: GaussianProcessConfig
    bounds: Bounds | None
    trend: TrendName
    prior: PriorMeasurements | None = None
    n_nodes: int | None = None
    progress: Progress | None = None
    division: Division | None = None


def condition_all(
    task: ConditioningTask, found: Hyperparameters, xy: FloatArray, values: FloatArray, variance: FloatArray
) -> Conditioned:
    """Condition a process with every kernel, and return their average.

    `xy`, `values`, `variance` (N, 2), (N,) and (N,): places, values, and variances of their errors without the nugget.

    Raise `DividedSiteError` where there are cells, and they are many or the site is too large for one solve.
    """
    data = NoisyValues.of(xy, values, np.sqrt(variance))
    site = data.extent(task.bounds)
    given = None if task.prior is None else task.prior.cells(task.prior.dem.crs, site)
    if given is not None and len(given[0]) > _MOST_CELLS:
        raise DividedSiteError
    if given is not None:
        task = task._replace(bounds=_around(site, given[0]))
    kernels = found.kernels
    first = _condition(task, kernels[0], data)
    if first.choice.engine != "dense" and all(one.patch is None for one in kernels):
        kernels = lightened(kernels, _MOST_IN_WAVES if first.choice.engine == "fourier" else 1)
    rest = (_condition(task, one, data).process for one in kernels[1:])
    parts = [_Part(one, process) for one, process in zip(kernels, (first.process, *rest), strict=True)]
    if given is not None:
        parts = _with_cells(parts, *given)
    if len(parts) == 1:
        return first._replace(process=parts[0].process)
    weights = np.array([part.kernel.weight for part in parts])
    nuggets_m2 = np.array([part.kernel.nugget_m**2 for part in parts])
    processes, patches = tuple(part.process for part in parts), tuple(part.kernel.patch for part in parts)
    return Conditioned(AveragedProcess(processes, weights, nuggets_m2, patches), first.choice)


class _Part(NamedTuple):
    """A kernel with its weight, and the process that it was conditioned to."""

    kernel: KernelInAverage
    process: Process


def _condition(task: ConditioningTask, one: KernelInAverage, data: NoisyValues) -> Conditioned:
    return fit_process(
        task.engine,
        one.kernel,
        data.xy,
        data.values,
        np.sqrt(data.noise_m2 + one.nugget_m**2),
        bounds=task.bounds,
        trend=task.trend,
        config=task.config,
        progress=task.progress,
        n_nodes=task.n_nodes,
        may_divide=task.prior is None,
        division=task.division,
    )


def _with_cells(parts: list[_Part], cells: SatelliteCells, errors: PriorErrors) -> list[_Part]:
    """Return the parts given the cells, with the evidence of the cells in their weights, the heaviest first.

    The sizes of the cells' errors and their conflicts are those with the heaviest kernel.
    """
    means = [CellMeans(part.process, cells) for part in parts]
    judged = judge_cells(cells, errors, means[0].expected, means[0].covariance)
    evidence = [misfit_log_likelihood(judged.cells.misfits(one.expected, one.covariance)) for one in means]
    weights = with_evidence(np.array([part.kernel.weight for part in parts]), np.array(evidence))
    found = [
        _Part(part.kernel._replace(weight=float(weight)), _given(judged, over_cells))
        for part, weight, over_cells in zip(parts, weights, means, strict=True)
    ]
    return sorted(found, key=lambda part: -part.kernel.weight)


def _given(judged: JudgedCells, means: CellMeans) -> Process:
    """Return a process given cells, at one level or at two with their probabilities."""

    def at(cells: SatelliteCells) -> ProcessWithCells:
        return ProcessWithCells(means.process, cells, judged.conflicts, means)

    if judged.stated is None:
        return at(judged.cells)
    stated = judged.stated.probability
    return ProcessAtLevels.of([at(judged.cells), at(judged.stated.cells)], np.array([1.0 - stated, stated]))


def _around(site: Bounds, cells: SatelliteCells) -> Bounds:
    """Return the smallest rectangle that holds a site and the cells that meet it."""
    reach = 0.5 * np.abs(cells.sides).sum(axis=1)
    low = np.minimum(site[:2], (cells.centre - reach).min(axis=0))
    high = np.maximum(site[2:], (cells.centre + reach).max(axis=0))
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
