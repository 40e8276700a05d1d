"""Stiffness of the fine relief by likelihood on patches, and calibration of its standard deviation on pilot windows."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.reconstruction.lattice.calibration import LatticeCalibration, likeliest_factors
from survey.reconstruction.lattice.stiffness import PATCH_NODES, LatticeLikelihood, Stiffness, likeliest_of
from survey.reconstruction.nodes import bilinear
from survey.reconstruction.tiled.cells.statistics import cells_in
from survey.reconstruction.tiled.job import TiledJob
from survey.reconstruction.tiled.layout import CellWindow, MapTile
from survey.reconstruction.tiled.relief.fine_relief import fine_relief, variance_within_cells
from survey.reconstruction.tiled.relief.measurements import Measurements, measurements
from survey.reconstruction.tiled.relief.shared import Learnt, Shared

Run = Callable[[Callable[[Any], Any], Sequence[Any]], Iterator[tuple[Any, Any]]]
"""Runs a function on pieces, and yields each piece with its result, in any order."""
_N_PATCHES, _N_PILOTS, _PILOT_CELLS = 16, 6, 160
_MOST_TRIES = 100
_LEAST_POINTS = 60
_CELL_DRAWS = 8
_RANGES_IN_CELLS = (60.0, 30.0, 15.0, 8.0)
_WITHHELD_OF_PILOTS = 0.1
# Where nothing can be learnt: gentle ground.
_FALLBACK = Stiffness(1000.0, 60.0)


class Place(NamedTuple):
    """A window in a tile."""

    tile: MapTile
    window: CellWindow


def learn(job: TiledJob, shared: Shared, tiles: Sequence[MapTile], run: Run) -> Learnt:
    """Return the prior of the fine relief and the factors on its standard deviation.

    Parameters
    ----------
    job : TiledJob
        The map.
    shared : Shared
        Errors of strips and long relief.
    tiles : sequence of MapTile
        Tiles with points.
    run : callable
        Runs the pilot windows.
    """
    patches = _patches(job, shared, _places(job, tiles, PATCH_NODES, _N_PATCHES))
    ranges = [n * job.layout.cell_m for n in _RANGES_IN_CELLS]
    stiffness = likeliest_of(patches, ranges) if patches else _FALLBACK
    pilots = _places(job, tiles, _PILOT_CELLS, _N_PILOTS)
    if not pilots:
        return Learnt(stiffness, LatticeCalibration())
    found = dict(run(partial(_pilot, job, shared, stiffness), pilots))
    errors = np.concatenate([found[place][0] for place in pilots])
    within_cells = float(np.mean([found[place][1] for place in pilots]))
    return Learnt(stiffness, likeliest_factors(*errors.T), within_cells)


def _places(job: TiledJob, tiles: Sequence[MapTile], side: int, n: int) -> list[Place]:
    """Return square windows that hold points, at random places of the map, the same ones for every size of the tiles."""
    rng, extent, found = stream(0, "tiled map", side), job.layout.extent, dict[Place, None]()
    columns, rows = min(side, extent.columns), min(side, extent.rows)
    for _ in range(_MOST_TRIES):
        west = extent.west + int(rng.integers(extent.columns - columns + 1))
        south = extent.south + int(rng.integers(extent.rows - rows + 1))
        middle = np.array([[west + columns // 2, south + rows // 2]])
        tile = MapTile(*divmod(int(job.layout.tile_numbers(middle)[0]), job.layout.shape[1]))
        place = Place(tile, CellWindow(west, south, columns, rows))
        if tile in tiles and _is_seen(job, place):
            found[place] = None
        if len(found) == n:
            break
    return list(found)


def _is_seen(job: TiledJob, place: Place) -> bool:
    """Return whether an eighth of the cells of a window hold points."""
    cells = cells_in(job.work / "cells", job.layout, place.tile, place.window)
    return len(cells) >= place.window.rows * place.window.columns // 8


def _patches(job: TiledJob, shared: Shared, places: Sequence[Place]) -> list[LatticeLikelihood]:
    patches = []
    for place in places:
        points = measurements(job, shared, place.tile, place.window, 0.0).points
        if len(points.weight) >= _LEAST_POINTS and place.window.shape == (PATCH_NODES, PATCH_NODES):
            rows = points.rows(points.residual)
            patches.append(LatticeLikelihood(rows, place.window.shape, job.layout.cell_m))
    return patches


def _pilot(job: TiledJob, shared: Shared, stiffness: Stiffness, place: Place) -> tuple[FloatArray, float]:
    """Return errors [m], variances of the surface and of the cells [m²] (N, 3) at the withheld cells of a window.

    The second value is that of `variance_within_cells`.
    """
    found = measurements(job, shared, place.tile, place.window, _WITHHELD_OF_PILOTS)
    setting = place.window, job.layout.cell_m, stiffness
    errors = withheld_errors(found, *setting, job.config.n_draws)
    return errors, variance_within_cells(found.points, *setting, _CELL_DRAWS)


def withheld_errors(
    found: Measurements, window: CellWindow, cell_m: float, stiffness: Stiffness, n_draws: int
) -> FloatArray:
    """Return errors [m], variances of the surface and of the cells [m²] (N, 3) at withheld cells."""
    held = found.points.where(found.withheld)
    if len(held.weight) == 0:
        return np.zeros((0, 3))
    fine = fine_relief(found.points.where(~found.withheld), window, cell_m, stiffness, n_draws)
    return np.column_stack(
        [
            held.residual - bilinear(fine.height, held.uv),
            bilinear(fine.variance, held.uv),
            stiffness.noise_factor**2 / held.weight,
        ]
    )


__all__ = ["Place", "Run", "learn", "withheld_errors"]
