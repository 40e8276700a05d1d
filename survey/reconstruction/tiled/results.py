"""Files of a map in tiles: mosaics, coverage map, and the record."""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from survey.core.files.writing import replacing
from survey.core.runs.manifest import with_checksum
from survey.io.raster.mosaic import MosaicBand, MosaicTile, write_mosaic
from survey.io.raster.reading import NODATA
from survey.io.raster.writing import write_raster
from survey.reconstruction.reconstruction_file import FACTS_SHA256
from survey.reconstruction.tiled.job import TiledJob, load_arrays
from survey.reconstruction.tiled.layout import MapTile
from survey.reconstruction.tiled.relief.shared import Learnt, Shared
from survey.reconstruction.tiled.withheld import CoverageMap, WithheldTest, coverage_map

_METHOD = "tiles"
_DEM_BANDS = (MosaicBand("elevation", "Float32", NODATA), MosaicBand("standard_deviation", "Float32", NODATA))
_SUPPORT_BANDS = (MosaicBand("support", "Byte", None),)


class TiledResult(NamedTuple):
    """A map in tiles: the record of what was found, and the test by withheld cells, over all and in blocks."""

    facts: dict[str, Any]
    test: WithheldTest
    coverage: CoverageMap


def write_results(
    job: TiledJob, tiles: Sequence[MapTile], shared: Shared, learnt: Learnt, n_points: int
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
    facts = {
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
    with replacing(job.folder / "reconstruction.json") as draft:
        text = json.dumps(with_checksum(facts, FACTS_SHA256), indent=2, sort_keys=True)
        draft.write_text(text + "\n", encoding="utf-8")
    return TiledResult(facts, test, coverage)


def _hyperparameters(shared: Shared, learnt: Learnt) -> dict[str, float]:
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
