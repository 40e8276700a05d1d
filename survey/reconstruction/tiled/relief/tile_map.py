"""Map of one tile: height, standard deviation and support, written as rasters, and its test by withheld cells."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from threadpoolctl import threadpool_limits

from survey.core.arrays import FloatArray, IntArray
from survey.core.files.writing import replacing
from survey.io.raster.categories import write_categories
from survey.io.raster.writing import write_raster
from survey.reconstruction.base import INTERPOLATED, MEASURED, SUPPORT_NAMES, UNSEEN
from survey.reconstruction.nodes import bilinear
from survey.reconstruction.tiled.job import TiledJob
from survey.reconstruction.tiled.layout import CellWindow, MapTile
from survey.reconstruction.tiled.relief.fine_relief import FineRelief, fine_relief, strip_variance
from survey.reconstruction.tiled.relief.measurements import Measurements, measurements
from survey.reconstruction.tiled.relief.shared import Learnt, Shared
from survey.reconstruction.tiled.strips.places import N_TERMS
from survey.reconstruction.tiled.strips.strip_errors import StripErrors


class TileMap(NamedTuple):
    """Height [m], standard deviation [m] and support codes (rows, columns) of a tile, the first row the southern one."""

    height: FloatArray
    std: FloatArray
    support: npt.NDArray[np.uint8]


def map_tile(job: TiledJob, shared: Shared, learnt: Learnt, tile: MapTile) -> int:
    """Write the rasters of a tile and its test; return the number of withheld cells. A tile that is there stays."""
    if job.result_file(tile).exists():
        return 0
    # One thread: the same sums in the same order, whatever the number of workers.
    with threadpool_limits(limits=1, user_api="blas"):
        made, tested = tile_map(job, shared, learnt, tile)
    folder, window = job.folder / "tiles", job.layout.window(tile)
    transform = window.transform(job.layout.cell_m)
    bands = {"elevation": made.height[::-1], "standard_deviation": made.std[::-1]}
    write_raster(folder / f"dem_{tile.name}.tif", bands, transform, job.map_crs, job.vertical_datum)
    support = np.ascontiguousarray(made.support[::-1])
    write_categories(
        folder / f"support_{tile.name}.tif", support, SUPPORT_NAMES, transform=transform, crs=job.map_crs
    )
    with replacing(job.result_file(tile)) as draft:
        np.savez(draft, tested=tested, counts=np.bincount(support.ravel(), minlength=4))
    return len(tested)


def tile_map(job: TiledJob, shared: Shared, learnt: Learnt, tile: MapTile) -> tuple[TileMap, FloatArray]:
    """Return the map of a tile, and its withheld cells: easting, northing [m], error and standard deviation [m] (N, 4)."""
    window, cell_m = job.layout.window(tile), job.layout.cell_m
    about = window.grown(job.config.halo_cells, job.layout.extent)
    found = measurements(job, shared, tile, about, job.config.withheld_share)
    used = found.points.where(~found.withheld)
    fine = fine_relief(used, about, cell_m, learnt.stiffness, job.config.n_draws)
    std = np.sqrt(_variance(fine, found, about, shared.strips, learnt=learnt, cell_m=cell_m))
    support = _support(fine, shared.relief.reach_m / cell_m)
    height = found.long_m + fine.height
    if not job.prior_file.exists():
        height, std = (np.where(support == UNSEEN, np.nan, values) for values in (height, std))
    inner = about.part(window)
    tested = _tested(fine, found, window, about, learnt=learnt, cell_m=cell_m)
    return TileMap(height[inner], std[inner], support[inner]), tested


def _variance(
    fine: FineRelief,
    found: Measurements,
    window: CellWindow,
    strips: StripErrors,
    *,
    learnt: Learnt,
    cell_m: float,
) -> FloatArray:
    """Return the variance of the heights [m²]: fine relief, long relief where points lack, and errors of strips."""
    variance = learnt.surface_variance(fine) + (fine.long_share() * found.long_std_m) ** 2
    for share in fine.shares.values():
        variance += (share * strips.sizes.rest_m()) ** 2
    keys = np.array(list(fine.shares), np.uint32)
    if len(keys) == 0:
        return variance
    index = strips.places.numbers(keys)
    design = {
        int(key): _design(strips, int(k), window, cell_m, found.slope)
        for key, k in zip(keys, index, strict=True)
    }
    terms = (index[:, None] * N_TERMS + np.arange(N_TERMS)).ravel()
    total: FloatArray = variance + strip_variance(
        fine.shares, design, strips.covariance[np.ix_(terms, terms)]
    )
    return total


def _design(
    strips: StripErrors, strip: int, window: CellWindow, cell_m: float, slope: FloatArray
) -> FloatArray:
    """Return the rows (H, W, 5) that make the error of a strip at the middles of cells."""
    x, y = np.meshgrid(window.x(cell_m), window.y(cell_m))
    xy = np.column_stack([x.ravel(), y.ravel()])
    numbers: IntArray = np.full(len(xy), strip)
    return strips.places.design(numbers, xy, slope.reshape(-1, 2)).reshape(*window.shape, N_TERMS)


def _support(fine: FineRelief, reach_cells: float) -> npt.NDArray[np.uint8]:
    near = np.where(fine.away <= reach_cells, INTERPOLATED, UNSEEN)
    return np.where(fine.away <= 1.0, MEASURED, near).astype(np.uint8)


def _tested(
    fine: FineRelief,
    found: Measurements,
    window: CellWindow,
    about: CellWindow,
    *,
    learnt: Learnt,
    cell_m: float,
) -> FloatArray:
    """Return place, error and its standard deviation (N, 4) of the withheld cells of the tile proper.

    Map and withheld cell share the errors of strips, which this test does not see.
    """
    held = found.points.where(found.withheld)
    column, row = held.column - window.west, held.row - window.south
    held = held.where((column >= 0) & (column < window.columns) & (row >= 0) & (row < window.rows))
    surface = learnt.calibration.surface**2 * bilinear(fine.variance, held.uv)
    own = (learnt.calibration.points * learnt.stiffness.noise_factor) ** 2 / held.weight
    xy = (held.uv + 0.5 + [about.west, about.south]) * cell_m
    error = held.residual - bilinear(fine.height, held.uv)
    return np.column_stack([xy, error, np.sqrt(surface + own)])
