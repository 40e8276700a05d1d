"""Parameters that all tiles share: strip errors, long relief, and the prior and calibration of the fine relief.

`long_relief` is a Gaussian field on blocks of cells over the entire map, the mean of the fine relief. `solve_global` solves
for the errors of strips and the long relief from the summaries of all tiles, and stores them. `measurements` makes the
cells of a window measurements of the fine relief: residuals to the long relief, errors of strips removed. `learn` estimates
the stiffness of the fine relief by maximum likelihood on patches, and calibrates its standard deviation by cells that are
withheld in pilot windows.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

from survey.core import BoolArray, FloatArray, InputError, replacing, stream
from survey.reconstruction.lattice.calibration import LatticeCalibration, likeliest_factors
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import (
    PATCH_NODES,
    FieldPosterior,
    LatticeLikelihood,
    Part,
    Stiffness,
    likeliest_of,
    likeliest_stiffness,
)
from survey.reconstruction.nodes import NodeWindow, bilinear
from survey.reconstruction.tiled.cells import cells_in, mean_heights, slopes
from survey.reconstruction.tiled.fine_relief import (
    CellPoints,
    FineRelief,
    choose_squares,
    fine_relief,
    variance_within_cells,
)
from survey.reconstruction.tiled.job import TiledJob, load_arrays
from survey.reconstruction.tiled.layout import CellWindow, MapTile, TileLayout
from survey.reconstruction.tiled.strips import (
    Sizes,
    StripErrors,
    StripPairs,
    StripPlaces,
    as_arrays,
    from_arrays,
    solve_strips,
)
from survey.reconstruction.tiled.summaries import USUAL_M2, shrunk_variance, slopes_at

_N_DRAWS = 32
_SIGMA_M = 0.1
_LEARNT_FROM = 60_000
# With too few points to learn from: gentle ground.
_FALLBACK_LONG_RELIEF = Stiffness(1000.0, 2000.0)


class LongRelief(NamedTuple):
    """Heights and standard deviations on the nodes of a coarse lattice.

    `window`: nodes. `height` (H, W): heights [m], the first row the southern one. `std` (H, W): standard
    deviations [m]. `reach_m`: distance from points beyond which the lattice says nothing of the ground [m].
    """

    window: NodeWindow
    height: FloatArray
    std: FloatArray
    reach_m: float

    def on(self, cells: CellWindow, cell_m: float) -> tuple[FloatArray, FloatArray]:
        """Return heights by cubic splines and standard deviations, linear, at the middles of cells (rows, columns) [m]."""
        x, y = self._axes()
        spline = RectBivariateSpline(y, x, self.height, kx=3, ky=3, s=0)
        linear = RegularGridInterpolator((y, x), self.std, bounds_error=False, fill_value=None)
        north, east = np.meshgrid(cells.y(cell_m), cells.x(cell_m), indexing="ij")
        return np.asarray(spline(cells.y(cell_m), cells.x(cell_m))), np.asarray(linear((north, east)))

    def _axes(self) -> tuple[FloatArray, FloatArray]:
        w = self.window
        columns, rows = np.arange(w.columns, dtype=np.float64), np.arange(w.rows, dtype=np.float64)
        return w.step_m * (w.west + columns), w.step_m * (w.south + rows)


def coarse_nodes(layout: TileLayout, coarse_cells: int) -> NodeWindow:
    """Return the nodes of the long relief, at least four a side, over all cells."""
    step_m = coarse_cells * layout.cell_m
    x, y = layout.extent.x(layout.cell_m), layout.extent.y(layout.cell_m)
    spare = 2.0 * step_m
    return NodeWindow.over((x[0] - spare, y[0] - spare, x[-1] + spare, y[-1] + spare), step_m)


def long_relief(
    layout: TileLayout, coarse_cells: int, blocks: FloatArray, strips: StripErrors, prior: FloatArray | None
) -> LongRelief:
    """Return the long relief through the means of blocks, about a prior where there is one.

    `blocks` (N, 7): see `survey.reconstruction.tiled.summaries.relief_blocks`. `prior` (H, W): heights of a
    coarse elevation model at the nodes [m], NaN where it has none.
    """
    window = coarse_nodes(layout, coarse_cells)
    about = np.zeros(window.shape) if prior is None else _complete(prior)
    keys = blocks[:, 0].astype(np.uint32)
    height = blocks[:, 4] - strips.at(keys, blocks[:, 2:4], blocks[:, 5:7])
    places = window.coordinates(blocks[:, 2:4])
    height = height - bilinear(about, places)
    level = float(np.median(height))
    weight = blocks[:, 1] / coarse_cells**2 / _SIGMA_M**2
    xyzw = np.column_stack([blocks[:, 2:4], height - level, weight])
    stiffness = (
        likeliest_stiffness(xyzw[:: -(-len(xyzw) // _LEARNT_FROM)], window.step_m) or _FALLBACK_LONG_RELIEF
    )
    posterior = FieldPosterior.empty(window.shape, _N_DRAWS)
    posterior.information.add(np.column_stack([places, xyzw[:, 2:]]))
    all_nodes = Part(slice(0, window.rows), slice(0, window.columns))
    posterior.solve(all_nodes, window.step_m, stiffness, FieldLatticeConfig(tolerance=0.01))
    std = posterior.std(window, stiffness)
    return LongRelief(window, posterior.heights() + level + about, std, stiffness.range_m)


def _complete(prior: FloatArray) -> FloatArray:
    """Return a prior whose voids have its mean."""
    return np.where(np.isfinite(prior), prior, np.nanmean(prior))


def relief_arrays(relief: LongRelief) -> dict[str, Any]:
    """Return arrays from which `relief_of` makes the same long relief."""
    w = relief.window
    numbers = np.array([w.step_m, w.west, w.south, w.rows, w.columns, relief.reach_m])
    return {"relief_window": numbers, "relief_height": relief.height, "relief_std": relief.std}


def relief_of(arrays: Mapping[str, Any]) -> LongRelief:
    """Return the long relief from the arrays of `relief_arrays`."""
    step_m, west, south, rows, columns, reach_m = map(float, arrays["relief_window"])
    window = NodeWindow(step_m, int(west), int(south), int(rows), int(columns))
    return LongRelief(window, arrays["relief_height"], arrays["relief_std"], reach_m)


class GlobalParameters(NamedTuple):
    """What all tiles share.

    `strips`: errors of strips. `usual_m2`: variance of a point about the ground [m²]. `relief`: relief longer
    than some blocks of cells. `n_control`: differences of strips and control points. `pairs`: overlapping
    strips.
    """

    strips: StripErrors
    usual_m2: float
    relief: LongRelief
    n_control: int
    pairs: StripPairs


class ReliefHyperparameters(NamedTuple):
    """Prior of the fine relief, and factors on the standard deviations by withheld cells.

    `stiffness`: prior of the fine relief. `calibration`: factors by withheld cells. `within_cells`: variance
    of a height in a measured cell as a share of that at its middle, see `variance_within_cells`.
    """

    stiffness: Stiffness
    calibration: LatticeCalibration
    within_cells: float = 1.0

    def surface_variance(self, fine: FineRelief) -> FloatArray:
        """Return the variance (H, W) of the fine relief [m²] with the factors."""
        share = np.where(fine.away < 1.0, self.within_cells, 1.0)
        variance: FloatArray = self.calibration.surface**2 * share * fine.variance
        return variance


def solve_global(job: TiledJob, tiles: list[MapTile]) -> GlobalParameters:
    """Return what the summaries of all tiles determine, and write it; what is there is read."""
    if job.shared_file.exists():
        return read_global(job)
    found = [load_arrays(job.summary_file(tile)) for tile in tiles]
    if not found:
        raise InputError("no point lies in the map; check --area and the CRS of the points.")
    places = StripPlaces.of([np.asarray(each["strips"], np.float64) for each in found])
    overlaps = np.concatenate([each["overlaps"] for each in found])
    control = np.concatenate([each["control"] for each in found])
    expected = Sizes(job.config.strip_offset_m, job.config.strip_tilt_m)
    strips = solve_strips(places, overlaps, control, expected)
    usual, counts = np.array([each["usual_m2"] for each in found], np.float64).T
    known = np.isfinite(usual)
    usual_m2 = float(np.average(usual[known], weights=counts[known])) if known.any() else USUAL_M2
    blocks = np.concatenate([np.asarray(each["blocks"], np.float64) for each in found])
    prior = np.load(job.prior_file) if job.prior_file.exists() else None
    relief = long_relief(job.layout, job.config.coarse_cells, blocks, strips, prior)
    shared = GlobalParameters(strips, usual_m2, relief, len(control), StripPairs.of(overlaps))
    with replacing(job.shared_file) as draft:
        arrays: dict[str, Any] = {**as_arrays(strips), **relief_arrays(relief)}
        np.savez(draft, numbers=np.array([usual_m2, len(control)]), pairs=shared.pairs.table, **arrays)
    return shared


def read_global(job: TiledJob) -> GlobalParameters:
    """Return what `solve_global` wrote."""
    arrays = load_arrays(job.shared_file)
    usual_m2, n_control = (float(v) for v in np.asarray(arrays["numbers"], np.float64))
    numbers = {name: np.asarray(values, np.float64) for name, values in arrays.items()}
    return GlobalParameters(
        from_arrays(numbers), usual_m2, relief_of(numbers), int(n_control), StripPairs(numbers["pairs"])
    )


WITHHELD_SIDE = 2
"""Cells along a side of the squares that are withheld together."""
# Points of a cell agree to no less than this [m²].
_LEAST_M2 = 1e-4**2


class Measurements(NamedTuple):
    """Measurements in a window, which of them are withheld, long relief and slopes at the middles of its cells."""

    points: CellPoints
    withheld: BoolArray
    long_m: FloatArray
    long_std_m: FloatArray
    slope: FloatArray


def measurements(
    job: TiledJob, shared: GlobalParameters, tile: MapTile, window: CellWindow, share: float
) -> Measurements:
    """Return the measurements of a window about a tile."""
    cell_m = job.layout.cell_m
    cells = cells_in(job.work / "cells", job.layout, tile, window)
    long_m, long_std_m = shared.relief.on(window, cell_m)
    uv = np.column_stack(
        [cells["column"] - window.west + cells["x"] - 0.5, cells["row"] - window.south + cells["y"] - 0.5]
    ).astype(np.float64)
    inside = np.clip(uv, 0.0, (window.columns - 1, window.rows - 1))
    slope = slopes_at(cells, window) / cell_m
    xy = (uv + 0.5 + [window.west, window.south]) * cell_m
    strip_m = shared.strips.at(cells["strip"], xy, slope)
    variance = shrunk_variance(cells["variance"], cells["n"], shared.usual_m2) / cells["n"]
    points = CellPoints(
        inside,
        cells["z"] - strip_m - bilinear(long_m, inside),
        1.0 / np.maximum(variance + shared.strips.cell_m**2, _LEAST_M2),
        cells["strip"].astype(np.int64),
        cells["row"].astype(np.int64),
        cells["column"].astype(np.int64),
    )
    withheld = choose_squares(points.column, points.row, WITHHELD_SIDE, share) > 0
    heights = mean_heights(cells, window, strip_m)
    return Measurements(points, withheld, long_m, long_std_m, _node_slopes(heights, cell_m))


def _node_slopes(heights: FloatArray, cell_m: float) -> FloatArray:
    """Return the slopes eastwards and northwards (rows, columns, 2) [m/m]."""
    return np.stack(slopes(heights), axis=-1) / cell_m


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


def learn(
    job: TiledJob, shared: GlobalParameters, tiles: Sequence[MapTile], run: Run
) -> ReliefHyperparameters:
    """Return the prior of the fine relief and the factors on its standard deviation."""
    patches = _patches(job, shared, _places(job, tiles, PATCH_NODES, _N_PATCHES))
    ranges = [n * job.layout.cell_m for n in _RANGES_IN_CELLS]
    stiffness = likeliest_of(patches, ranges) if patches else _FALLBACK
    pilots = _places(job, tiles, _PILOT_CELLS, _N_PILOTS)
    if not pilots:
        return ReliefHyperparameters(stiffness, LatticeCalibration())
    found = dict(run(partial(_pilot, job, shared, stiffness), pilots))
    errors = np.concatenate([found[place][0] for place in pilots])
    within_cells = float(np.mean([found[place][1] for place in pilots]))
    return ReliefHyperparameters(stiffness, likeliest_factors(*errors.T), within_cells)


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


def _patches(job: TiledJob, shared: GlobalParameters, places: Sequence[Place]) -> list[LatticeLikelihood]:
    patches = []
    for place in places:
        points = measurements(job, shared, place.tile, place.window, 0.0).points
        if len(points.weight) >= _LEAST_POINTS and place.window.shape == (PATCH_NODES, PATCH_NODES):
            rows = points.rows(points.residual)
            patches.append(LatticeLikelihood(rows, place.window.shape, job.layout.cell_m))
    return patches


def _pilot(
    job: TiledJob, shared: GlobalParameters, stiffness: Stiffness, place: Place
) -> tuple[FloatArray, float]:
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
