"""Map of each tile, its test by withheld cells, and the files of the entire map.

`map_tile` writes height, standard deviation and support of a tile as rasters, and the normalised errors of cells that were withheld
from it. `coverage_map` summarises these over the map: coverage of the 95 % bounds in blocks, and reliability.
`write_results` joins the tiles to mosaics and writes the record.
"""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri
from threadpoolctl import threadpool_limits

from survey.core import Bounds, FloatArray, IntArray, replacing
from survey.core.documents import with_checksum
from survey.io.raster.large import MosaicBand, MosaicTile, write_mosaic
from survey.io.raster.reading import NODATA
from survey.io.raster.writing import write_categories, write_raster
from survey.reconstruction.nodes import bilinear
from survey.reconstruction.observations import Blunders, Contradictions
from survey.reconstruction.terrain_map import FACTS_SHA256, INTERPOLATED, MEASURED, SUPPORT_NAMES, UNSEEN
from survey.reconstruction.tiled.fine_relief import FineRelief, fine_relief, strip_variance
from survey.reconstruction.tiled.global_parameters import (
    GlobalParameters,
    Measurements,
    ReliefHyperparameters,
    measurements,
)
from survey.reconstruction.tiled.job import TiledJob, load_arrays
from survey.reconstruction.tiled.layout import CellWindow, MapTile
from survey.reconstruction.tiled.strips import N_TERMS, StripErrors


class TileMap(NamedTuple):
    """Height [m], standard deviation [m] and support codes (rows, columns) of a tile, the first row the southern one."""

    height: FloatArray
    std: FloatArray
    support: npt.NDArray[np.uint8]


def map_tile(job: TiledJob, shared: GlobalParameters, learnt: ReliefHyperparameters, tile: MapTile) -> int:
    """Write the rasters of a tile and its test; return the number of withheld cells. A tile that is there stays."""
    if job.result_file(tile).exists():
        return 0
    # One thread: the same sums in the same order, whatever the number of workers.
    with threadpool_limits(limits=1, user_api="blas"):
        made, tested = tile_map(job, shared, learnt, tile)
    folder, window = job.folder / "tiles", job.layout.window(tile)
    _raise_to_scatter(
        made.std, np.asarray(load_arrays(job.summary_file(tile))["conflicts"]), window, job.layout.cell_m
    )
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


def _raise_to_scatter(
    std: FloatArray, conflicts: npt.NDArray[np.void], window: CellWindow, cell_m: float
) -> None:
    """Let no standard deviation (rows, columns) [m] in or beside the cell of contradicting heights be below their scatter."""
    for each in conflicts:
        column, row = int(each["x"] // cell_m) - window.west, int(each["y"] // cell_m) - window.south
        about = std[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        np.maximum(about, each["scatter"], out=about)


def tile_map(
    job: TiledJob, shared: GlobalParameters, learnt: ReliefHyperparameters, tile: MapTile
) -> tuple[TileMap, FloatArray]:
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
    learnt: ReliefHyperparameters,
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
    learnt: ReliefHyperparameters,
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


LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Nominal coverages of the reliability diagram."""
_LEAST_COVERAGE = 0.5
"""Share of withheld cells within the 95 % interval below which a map is not to be used."""
_BLOCK_CELLS, _SMALLEST_BLOCK = 250, 31
_LEAST_CELLS = 10


class WithheldTest(NamedTuple):
    """Errors at withheld cells against the standard deviations that the map states.

    `n`: withheld cells. `coverage_95`: share of them within the 95 % interval; NaN without cells.
    `rms_ratio`: root mean square of error over standard deviation. `reliability`: share of the cells within
    the central interval of each nominal coverage.
    """

    n: int
    coverage_95: float
    rms_ratio: float
    reliability: dict[float, float]

    @classmethod
    def of(cls, error: FloatArray, sigma: FloatArray) -> "WithheldTest":
        """Return the test of errors (N,) with standard deviations (N,) [m]."""
        ratio = np.abs(error) / sigma
        within = {level: float(np.mean(ratio <= ndtri(0.5 + 0.5 * level))) for level in LEVELS if len(ratio)}
        rms = float(np.sqrt(np.mean(ratio**2))) if len(ratio) else float("nan")
        return cls(len(ratio), within.get(0.95, float("nan")), rms, within)

    def warning(self) -> str:
        """State that the map fails its own check, and what to look for."""
        return (
            f"the map fails its own check: {100.0 * self.coverage_95:.0f} % of {self.n:,} withheld cells lie within the 95 % interval, so do not "
            "use it; its files disagree, for instance in the unit or datum of heights, so map each one alone, and name the unit with --units"
        )

    def facts(self) -> dict[str, Any]:
        """Return the test for the record."""
        return {
            "n_withheld": self.n,
            "coverage_95": self.coverage_95,
            "rms_ratio": self.rms_ratio,
            "reliability": [[nominal, found] for nominal, found in self.reliability.items()],
        }


class CoverageMap(NamedTuple):
    """Share of withheld cells within the 95 % interval over blocks of cells.

    `share` (H, W): the first row is the southern one; NaN with fewer than ten cells. `blocks`: the blocks,
    counted in blocks from the origin of the CRS. `side_m`: side of a block [m].
    """

    share: FloatArray
    blocks: CellWindow
    side_m: float

    @property
    def bounds(self) -> Bounds:
        """West, south, east and north edge [m]."""
        west, south, columns, rows = (n * self.side_m for n in self.blocks)
        return west, south, west + columns, south + rows


def coverage_map(tested: FloatArray, extent: CellWindow, cell_m: float) -> CoverageMap:
    """Return how often the 95 % intervals held the withheld cells, in blocks of 250 cells, fewer on small maps.

    `tested` (N, 4): easting, northing, error and standard deviation [m]. `cell_m`: side of a cell [m].
    """
    n = _BLOCK_CELLS
    while n > _SMALLEST_BLOCK and min(extent.shape) < 2 * n:
        n //= 2
    blocks = CellWindow(
        extent.west // n,
        extent.south // n,
        (extent.west + extent.columns - 1) // n - extent.west // n + 1,
        (extent.south + extent.rows - 1) // n - extent.south // n + 1,
    )
    column, row = np.floor(tested[:, :2].T / (cell_m * n)).astype(np.int64)
    flat = np.clip(row - blocks.south, 0, blocks.rows - 1) * blocks.columns
    flat = flat + np.clip(column - blocks.west, 0, blocks.columns - 1)
    inside = np.abs(tested[:, 2]) <= ndtri(0.975) * tested[:, 3]
    count = np.bincount(flat, minlength=blocks.rows * blocks.columns)
    total = np.bincount(flat, inside, blocks.rows * blocks.columns)
    share: FloatArray = np.full(len(count), np.nan)
    np.divide(total, count, out=share, where=count >= _LEAST_CELLS)
    return CoverageMap(share.reshape(blocks.shape), blocks, n * cell_m)


_METHOD = "tiles"
_DEM_BANDS = (MosaicBand("elevation", "Float32", NODATA), MosaicBand("standard_deviation", "Float32", NODATA))
_SUPPORT_BANDS = (MosaicBand("support", "Byte", None),)


class TiledResult(NamedTuple):
    """A map in tiles: the record of what was found, and the test by withheld cells, over all and in blocks."""

    facts: dict[str, Any]
    test: WithheldTest
    coverage: CoverageMap


def write_results(
    job: TiledJob,
    tiles: Sequence[MapTile],
    shared: GlobalParameters,
    learnt: ReliefHyperparameters,
    n_points: int,
) -> TiledResult:
    """Write ``dem.vrt``, ``support.vrt``, ``coverage.tif`` and ``reconstruction.json`` about the tiles that are there."""
    found = [load_arrays(job.result_file(tile)) for tile in tiles]
    tested = np.concatenate([np.asarray(each["tested"], np.float64) for each in found])
    counts = np.sum([np.asarray(each["counts"], np.int64) for each in found], axis=0)
    _write_mosaics(job, tiles)
    coverage = coverage_map(tested, job.layout.extent, job.layout.cell_m)
    transform = coverage.blocks.transform(coverage.side_m)
    write_raster(job.folder / "coverage.tif", {"coverage_95": coverage.share[::-1]}, transform, job.map_crs)
    test = WithheldTest.of(tested[:, 2], tested[:, 3])
    facts: dict[str, Any] = {
        "method": _METHOD,
        "quantity": "elevation_m",
        "hyperparameters": _hyperparameters(shared, learnt),
        "diagnostics": {
            "n_points": n_points,
            "n_tiles": len(tiles),
            "support_cells": counts.tolist(),
            "strips": shared.strips.facts(),
            "overlaps": shared.pairs.facts(shared.strips),
            "n_overlap_blocks": shared.pairs.n_blocks,
            "n_control": shared.n_control,
            "calibration": learnt.calibration.facts(),
            "withheld": test.facts(),
        },
    }
    blunders = _blunders(job, tiles)
    if blunders:
        facts["diagnostics"]["blunders"] = blunders
    conflicts = np.concatenate(
        [np.asarray(load_arrays(job.summary_file(tile))["conflicts"]) for tile in tiles]
    )
    if len(conflicts):
        facts["diagnostics"]["contradictions"] = [contradiction_facts(conflicts)]
    if test.n >= _LEAST_CELLS and test.coverage_95 < _LEAST_COVERAGE:
        facts["diagnostics"]["warnings"] = [test.warning()]
    with replacing(job.folder / "reconstruction.json") as draft:
        text = json.dumps(with_checksum(facts, FACTS_SHA256), indent=2, sort_keys=True)
        draft.write_text(text + "\n", encoding="utf-8")
    return TiledResult(facts, test, coverage)


def contradiction_facts(conflicts: npt.NDArray[np.void]) -> dict[str, Any]:
    """Return the record of the places (K,) of contradicting heights, the largest scatter first."""
    worst = conflicts[np.argsort(-conflicts["scatter"], kind="stable")]
    found = Contradictions(
        np.zeros(0, np.int64), np.column_stack([worst["x"], worst["y"]]), worst["n"], worst["low"], worst["high"], worst["scatter"], 0.0
    )  # fmt: skip
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in found.facts().items()
    }


def _blunders(job: TiledJob, tiles: Sequence[MapTile]) -> list[dict[str, Any]]:
    """Return the record of the points that were left out as blunders, the largest first; none where there are none."""
    rows = np.concatenate([np.asarray(load_arrays(job.summary_file(tile))["blunders"]) for tile in tiles])
    if not len(rows):
        return []
    rows = rows[np.argsort(-np.abs(rows[:, 2]), kind="stable")]
    found = Blunders(np.arange(len(rows)), rows[:, :2], rows[:, 2])
    facts = {name: np.asarray(value).tolist() for name, value in found.facts().items() if name != "rows"}
    return [{"sentence": found.sentence(by_row=False), **facts}]


def _hyperparameters(shared: GlobalParameters, learnt: ReliefHyperparameters) -> dict[str, float]:
    sizes = {f"strip_{name}": value for name, value in shared.strips.sizes._asdict().items()}
    return {
        "stiffness": learnt.stiffness.stiffness,
        "range_m": learnt.stiffness.range_m,
        "variance_within_cells": learnt.within_cells,
        "noise_factor": learnt.stiffness.noise_factor,
        "point_sigma_m": float(np.sqrt(shared.usual_m2)),
        "cell_sigma_m": shared.strips.cell_m,
        **sizes,
    }


def _write_mosaics(job: TiledJob, tiles: Sequence[MapTile]) -> None:
    extent, cell_m = job.layout.extent, job.layout.cell_m
    for name, bands in (("dem", _DEM_BANDS), ("support", _SUPPORT_BANDS)):
        parts = []
        for tile in tiles:
            window = job.layout.window(tile)
            row = extent.south + extent.rows - window.south - window.rows
            file = job.folder / "tiles" / f"{name}_{tile.name}.tif"
            parts.append(MosaicTile(file, window.west - extent.west, row, window.columns, window.rows))
        datum = job.vertical_datum if name == "dem" else ""
        transform = extent.transform(cell_m)
        write_mosaic(
            job.folder / f"{name}.vrt",
            parts,
            bands,
            shape=extent.shape,
            transform=transform,
            crs=job.map_crs,
            vertical_datum=datum,
        )
