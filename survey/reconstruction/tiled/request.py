"""Request of a map in tiles: files, extent and settings, checked before work starts and compared before it goes on."""

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from survey.core.arrays import Bounds
from survey.core.crs.agreement import same_crs
from survey.core.crs.checks import projected_crs
from survey.core.crs.vertical_datum import UNSTATED, datum_of_file, same_vertical_datum
from survey.core.documents import read_json, write_json
from survey.core.errors import InputError
from survey.io.points.chunks import PointFileFacts, chunked_files, point_file_facts
from survey.reconstruction.tiled.cells.disk_space import require_disk
from survey.reconstruction.tiled.cells.pieces import holds_class, pieces_of
from survey.reconstruction.tiled.config import TiledConfig
from survey.reconstruction.tiled.job import Control, TiledJob
from survey.reconstruction.tiled.layout import TileLayout

_ENDS_BYTES = 65_536


def tiled_job(
    sources: Sequence[Path],
    folder: Path,
    config: TiledConfig,
    *,
    crs: Any = None,
    bounds: Bounds | None = None,
    control: Control | None = None,
) -> TiledJob:
    """Return the request of a map of point files, checked.

    Parameters
    ----------
    sources : sequence of pathlib.Path
        Point files and folders of them: LAS, LAZ, COPC, PLY, Parquet.
    folder : pathlib.Path
        Folder of the map.
    config : TiledConfig
        Settings.
    crs : str or pyproj.CRS, optional
        Of files that state none.
    bounds : (xmin, ymin, xmax, ymax), optional
        Extent of the map [m]; that of the points by default.
    control : Control, optional
        Control points.

    Returns
    -------
    TiledJob
        What `map_in_tiles` runs.

    Raises
    ------
    InputError
        Files that are damaged, empty, in other CRSs or in none.
    CapacityError
        More tiles than can be numbered.
    """
    files = chunked_files(list(sources))
    facts = [point_file_facts(file) for file in files]
    common, datum = _common_crs(files, facts, crs)
    layout = TileLayout.over(bounds or _bounds(facts), config.cell_m, config.tile_cells)
    pieces = []
    for number, (file, own) in enumerate(zip(files, facts, strict=True)):
        ground = config.ground_class if holds_class(file, own.n_points, config.ground_class) else None
        pieces += pieces_of(file.absolute(), number, own.n_points, ground)
    return TiledJob(
        layout, config, folder.absolute(), tuple(pieces), common.to_wkt(), datum, control or Control.none()
    )


def _bounds(facts: Sequence[PointFileFacts]) -> Bounds:
    each = np.array([own.bounds for own in facts])
    low, high = each[:, :2].min(axis=0), each[:, 2:].max(axis=0)
    # A point upon the edge of the last cell belongs to the map.
    return float(low[0]), float(low[1]), float(high[0]) + 1e-6, float(high[1]) + 1e-6


def _common_crs(files: Sequence[Path], facts: Sequence[PointFileFacts], given: Any) -> tuple[CRS, str]:
    """Return the projected CRS of all files and their vertical datum."""
    found: CRS | None = None
    datum = UNSTATED
    for file, own in zip(files, facts, strict=True):
        stated = own.crs if own.crs is not None else given
        if stated is None:
            raise InputError(f"the point file {file} names no CRS; give it with --crs.")
        stated_crs = CRS.from_user_input(stated)
        own_crs = projected_crs(stated_crs, f"the point file {file}")
        own_datum = datum_of_file(own.vertical_datum, stated_crs, f"the point file {file}")
        found = own_crs if found is None else found
        same_crs(found, own_crs, f"{files[0]} and {file}")
        same_vertical_datum(datum, own_datum, f"{file} and the files before it")
        datum = datum or own_datum
    if found is None:
        raise InputError("there is no point file; name at least one.")
    return found, datum


def begin(job: TiledJob) -> int:
    """Make the folders of the work, or check that they hold the same request; return the disk space needed [bytes].

    Raises
    ------
    InputError
        The folder holds the work of another request.
    CapacityError
        The disk is too full.
    """
    stated = _stated(job)
    file = job.work / "request.json"
    if file.exists() and read_json(file, "the request of the map") != stated:
        raise InputError(
            f"{job.folder} holds a part of another map (its points or settings differ); go on with the same command, or add --force."
        )
    for name in ("sorted", "cells", "summaries", "withheld"):
        (job.work / name).mkdir(parents=True, exist_ok=True)
    (job.folder / "tiles").mkdir(exist_ok=True)
    extent = job.layout.extent
    n_points = 0 if file.exists() else sum(piece.n for piece in job.pieces)
    needed = require_disk(job.folder, n_points, extent.rows * extent.columns)
    write_json(file, stated)
    return needed


def _stated(job: TiledJob) -> dict[str, Any]:
    """Return what must be the same for the work to go on."""
    files = {piece.file: None for piece in job.pieces}
    return {
        "settings": job.config.model_dump(mode="json"),
        "cells": list(job.layout.extent),
        "crs": job.crs,
        "prior": job.prior,
        "files": {file: fingerprint(Path(file)) for file in files},
        "control": f"{zlib.crc32(np.column_stack([*job.control.xyz.T, job.control.sigma_m]).tobytes()):08x}",
    }


def fingerprint(file: Path) -> str:
    """Return size and checksum of the beginning and the end of a file."""
    size = file.stat().st_size
    with file.open("rb") as stream:
        crc = zlib.crc32(stream.read(_ENDS_BYTES))
        stream.seek(max(size - _ENDS_BYTES, 0))
        crc = zlib.crc32(stream.read(_ENDS_BYTES), crc)
    return f"{size}:{crc:08x}"
