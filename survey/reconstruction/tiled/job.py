"""What every worker of a map in tiles is given: layout, settings and the places of the files between the stages."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.reconstruction.tiled.cells.pieces import Piece
from survey.reconstruction.tiled.config import TiledConfig
from survey.reconstruction.tiled.layout import CellWindow, MapTile, TileLayout


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

    Parameters
    ----------
    layout : TileLayout
        Tiles of the map.
    config : TiledConfig
        Settings.
    folder : pathlib.Path
        Folder of the map; files between the stages are in its folder ``work``.
    pieces : tuple of Piece
        Points to sort.
    crs : str
        CRS of the map as WKT.
    vertical_datum : str
        Name of the surface that heights count from.
    control : Control
        Control points.
    prior : str
        Fingerprint of the raster that the long relief is built around; empty for none.
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
