"""Request of a map in tiles: settings, control points, files between the stages, and checks before work starts.

`TiledConfig` holds the settings, and `TiledJob` all that a worker needs: layout, settings and paths. `tiled_job` makes
it from point files and an extent, and refuses files without a common projected CRS and vertical datum. `begin` compares the
request with that of a run that was broken off, and `require_disk` refuses work for which the disk is too full.
"""

import logging
import shutil
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator
from pyproj import CRS

from survey.core import (
    UNSTATED,
    Bounds,
    CapacityError,
    FloatArray,
    InputError,
    Section,
    projected_crs,
    read_json,
    same_crs,
    same_vertical_datum,
    write_json,
)
from survey.core.crs import datum_of_file
from survey.core.lengths import FOOT_M
from survey.core.transformation import metric_crs
from survey.io.point_chunks import PointFileFacts, chunked_files, point_file_facts
from survey.io.point_table import PLACE, units_of_table
from survey.reconstruction.tiled.cells import Piece, holds_class, pieces_of
from survey.reconstruction.tiled.layout import CellWindow, MapTile, TileLayout


class TiledConfig(Section):
    """How a large survey is mapped tile by tile.

    >>> TiledConfig().tile_cells
    1000
    """

    cell_m: float = Field(default=1.0, gt=0)
    """Side of a cell of the map [m]."""
    tile_cells: int = Field(default=1000, ge=64, le=4000)
    """Cells along a side of a tile."""
    halo_cells: int = Field(default=96, ge=16, le=512)
    """Cells beyond the edge of a tile whose points count in its solution."""
    coarse_cells: int = Field(default=20, ge=4, le=64)
    """Cells along a side of a block of the long relief."""
    strip_offset_m: float = Field(default=0.2, gt=0)
    """Expected size of the offset of a strip, before the survey's own strips are compared [m]."""
    strip_tilt_m: float = Field(default=0.1, gt=0)
    """Expected size of the error that a strip's tilt makes at its end, before the comparison [m]."""
    withheld_share: float = Field(default=0.01, gt=0, le=0.2)
    """Share of the cells that are withheld from the map to test it."""
    n_draws: int = Field(default=24, ge=8, le=64)
    """Draws from which the standard deviation is taken."""
    ground_class: int = Field(default=2, ge=0, le=255)
    """Class of ground points; files without any such point are used entirely, noise (7 and 18) excepted."""

    @model_validator(mode="after")
    def _blocks_divide_tiles(self) -> Self:
        if self.tile_cells % self.coarse_cells:
            raise ValueError(
                f"tile_cells {self.tile_cells} is no multiple of coarse_cells {self.coarse_cells}; change one of them"
            )
        return self


class Control(NamedTuple):
    """Control points: places and heights (N, 3) [m], and standard deviations of the heights (N,) [m]."""

    xyz: FloatArray
    sigma_m: FloatArray

    @classmethod
    def none(cls) -> "Control":
        """Return no control points."""
        return cls(np.zeros((0, 3)), np.zeros(0))

    def within(self, window: CellWindow, cell_m: float) -> "Control":
        """Return the control points that lie in a window, so that each belongs to one tile."""
        column, row = np.floor(self.xyz[:, :2].T / cell_m)
        inside = (column >= window.west) & (column < window.west + window.columns)
        inside &= (row >= window.south) & (row < window.south + window.rows)
        return Control(self.xyz[inside], self.sigma_m[inside])


class TiledJob(NamedTuple):
    """A map in tiles.

    `layout`: tiles of the map. `config`: settings. `folder`: folder of the map; files between the stages are
    in its folder ``work``. `pieces`: points to sort. `crs`: CRS of the map as WKT. `vertical_datum`: name of
    the surface that heights count from. `control`: control points. `prior`: fingerprint of the raster that
    the long relief is built around; empty for none.
    """

    layout: TileLayout
    config: TiledConfig
    folder: Path
    pieces: tuple[Piece, ...]
    crs: str
    vertical_datum: str
    control: Control
    prior: str = ""

    @property
    def map_crs(self) -> CRS:
        """CRS of the map."""
        return CRS.from_wkt(self.crs)

    @property
    def work(self) -> Path:
        """Folder of the files between the stages."""
        return self.folder / "work"

    @property
    def sorted_folder(self) -> Path:
        """Folder of the sorted points."""
        return self.work / "sorted"

    def cells_file(self, tile: MapTile) -> Path:
        """Return the file of the cells of a tile."""
        return self.work / "cells" / f"{tile.name}.npy"

    def summary_file(self, tile: MapTile) -> Path:
        """Return the file of what a tile contributes to the errors of strips and to the long relief."""
        return self.work / "summaries" / f"{tile.name}.npz"

    def result_file(self, tile: MapTile) -> Path:
        """Return the file of the test of a tile by its withheld cells; the last file of a tile to be written."""
        return self.work / "withheld" / f"{tile.name}.npz"

    @property
    def shared_file(self) -> Path:
        """File of what all tiles share: errors of strips and long relief."""
        return self.work / "shared.npz"

    @property
    def prior_file(self) -> Path:
        """File of the prior's heights at the nodes of the long relief; there is none without prior."""
        return self.work / "prior.npy"


def load_arrays(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a file between the stages."""
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}


_ENDS_BYTES = 65_536
_FEET_TOLERANCE = 0.02


def tiled_job(
    sources: Sequence[Path],
    folder: Path,
    config: TiledConfig,
    *,
    crs: Any = None,
    bounds: Bounds | None = None,
    control: Control | None = None,
    units: str | None = None,
) -> TiledJob:
    """Return the request of a map of point files, checked; places and heights in feet are converted, and the log states it.

    `bounds` (xmin, ymin, xmax, ymax): extent of the map [m]; that of the points by default.
    """
    files = chunked_files(list(sources))
    facts = [point_file_facts(file, crs) for file in files]
    metres = [_metres(file, own, crs, units) for file, own in zip(files, facts, strict=True)]
    facts = [
        own._replace(bounds=(b[0] * m, b[1] * m, b[2] * m, b[3] * m))
        for own, b, (m, _) in ((own, own.bounds, each) for own, each in zip(facts, metres, strict=True))
    ]
    _refuse_feet_among_metres(files, facts, metres)
    common, datum = _common_crs(files, facts, crs)
    layout = TileLayout.over(bounds or _bounds(facts), config.cell_m, config.tile_cells)
    pieces = []
    for number, (file, own, in_file) in enumerate(zip(files, facts, metres, strict=True)):
        ground = config.ground_class if holds_class(file, own.n_points, config.ground_class) else None
        if ground is None and file.suffix.lower() in (".las", ".laz"):
            logging.getLogger(__name__).warning(
                "%s: no point is classified as ground (class %d), and maps in tiles do not filter: all points but noise are mapped.",
                file,
                config.ground_class,
            )
        pieces += pieces_of(file.absolute(), number, own.n_points, ground, in_file)
    return TiledJob(
        layout, config, folder.absolute(), tuple(pieces), common.to_wkt(), datum, control or Control.none()
    )


def _bounds(facts: Sequence[PointFileFacts]) -> Bounds:
    each = np.array([own.bounds for own in facts])
    low, high = each[:, :2].min(axis=0), each[:, 2:].max(axis=0)
    # A point upon the edge of the last cell belongs to the map.
    return float(low[0]), float(low[1]), float(high[0]) + 1e-6, float(high[1]) + 1e-6


def _metres(file: Path, own: PointFileFacts, crs: Any, units: str | None) -> tuple[float, float]:
    """Return the metres in a unit of the places and of the heights of a file."""
    where = f"the point file {file}"
    asked = own.crs if crs is None else crs
    if asked is None:
        return 1.0, 1.0  # refused by `_common_crs`
    system, named = (metric_crs(each, where) for each in (asked if own.crs is None else own.crs, asked))
    found = units_of_table(own.lengths, system, named.height_m, units, where)
    return found[PLACE[0]], found[PLACE[2]]


def _refuse_feet_among_metres(
    files: Sequence[Path], facts: Sequence[PointFileFacts], metres: Sequence[tuple[float, float]]
) -> None:
    """Refuse a file whose heights are 3.28 times those of another one on the same ground, by the headers."""
    known = [
        (file, own.bounds, height_m * own.heights[0], height_m * own.heights[1])
        for file, own, (_, height_m) in zip(files, facts, metres, strict=True)
        if own.heights is not None and own.heights[0] > 0.0
    ]
    known.sort(key=lambda each: each[2])
    for k, (file, a, low, high) in enumerate(known):
        for other, b, other_low, other_high in known[k + 1 :]:
            is_beside = a[0] > b[2] or b[0] > a[2] or a[1] > b[3] or b[1] > a[3]
            ratio = (other_low + other_high) / (low + high) * FOOT_M
            if not is_beside and other_low > high and abs(ratio - 1.0) < _FEET_TOLERANCE:
                raise InputError(
                    f"the heights of {other} ({other_low:.0f} to {other_high:.0f} m) are 3.28 times those of {file} ({low:.0f} to {high:.0f} m) "
                    f"on the same ground, as feet are; map {other.name} alone with --units ft or us-ft, or state its unit in its header."
                )


def _common_crs(files: Sequence[Path], facts: Sequence[PointFileFacts], given: Any) -> tuple[CRS, str]:
    """Return the projected CRS of all files and their vertical datum."""
    found: CRS | None = None
    datum = UNSTATED
    for file, own in zip(files, facts, strict=True):
        stated = own.crs if own.crs is not None else given
        if stated is None:
            raise InputError(f"the point file {file} names no CRS; give it with --crs.")
        stated_crs = metric_crs(stated, f"the point file {file}").crs
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
    """Make the folders of the work, or check that they hold the same request; return the disk space needed [bytes]."""
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
    in_feet = {piece.file: list(piece.metres) for piece in job.pieces if piece.metres != (1.0, 1.0)}
    return {
        "settings": job.config.model_dump(mode="json"),
        "cells": list(job.layout.extent),
        "crs": job.crs,
        "prior": job.prior,
        "files": {file: fingerprint(Path(file)) for file in files},
        **({"metres": in_feet} if in_feet else {}),
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


_BYTES_PER_POINT = 16
# Cells with their strips, solutions and maps of a tile, beside the sorted points.
_BYTES_PER_CELL = 90


def disk_bytes(n_points: int, n_cells: int) -> int:
    """Return the disk space that sorted points and cells take.

    >>> disk_bytes(1_000_000_000, 100_000_000)
    25000000000
    """
    return n_points * _BYTES_PER_POINT + n_cells * _BYTES_PER_CELL


def require_disk(folder: Path, n_points: int, n_cells: int) -> int:
    """Return the disk space that the work takes, or refuse one that is not free."""
    needed = disk_bytes(n_points, n_cells)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise CapacityError(
            f"the work takes {needed / 1e9:.3g} GB of disk for {n_points:,} points and {n_cells:,} cells, and {free / 1e9:.3g} GB "
            f"are free at {folder}; free space, or choose another disk with --out."
        )
    return needed
