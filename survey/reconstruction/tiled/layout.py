"""Tiles of a map: which cells belong to which tile, and which cells lie about it."""

import math
from collections.abc import Iterator
from typing import NamedTuple, Self

import numpy as np
from affine import Affine

from survey.core import Bounds, CapacityError, FloatArray, InputError, IntArray

_MOST_TILES = 100_000
_MOST_CELLS = 2**30
_SMALLEST_SHARE = 10


class CellWindow(NamedTuple):
    """A rectangle of cells.

    `west`, `south`: numbers of the first column and row, counted from the origin of the CRS. `columns`,
    `rows`: cells along the sides.
    """

    west: int
    south: int
    columns: int
    rows: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    def grown(self, cells: int, within: "CellWindow") -> "CellWindow":
        """Return the window with so many cells more on every side, cut at the edges of another one."""
        west, south = max(self.west - cells, within.west), max(self.south - cells, within.south)
        east = min(self.west + self.columns + cells, within.west + within.columns)
        north = min(self.south + self.rows + cells, within.south + within.rows)
        return CellWindow(west, south, east - west, north - south)

    def part(self, inner: "CellWindow") -> tuple[slice, slice]:
        """Return the rows and columns of this window in which another one lies."""
        south, west = inner.south - self.south, inner.west - self.west
        return slice(south, south + inner.rows), slice(west, west + inner.columns)

    def overlaps(self, other: "CellWindow") -> bool:
        """Return whether two windows share a cell."""
        return (
            self.west < other.west + other.columns
            and other.west < self.west + self.columns
            and self.south < other.south + other.rows
            and other.south < self.south + self.rows
        )

    def x(self, cell_m: float) -> FloatArray:
        """Return the eastings of the middles of the columns (columns,) [m]."""
        values: FloatArray = (self.west + np.arange(self.columns, dtype=np.float64) + 0.5) * cell_m
        return values

    def y(self, cell_m: float) -> FloatArray:
        """Return the northings of the middles of the rows (rows,) [m], ascending."""
        values: FloatArray = (self.south + np.arange(self.rows, dtype=np.float64) + 0.5) * cell_m
        return values

    def transform(self, cell_m: float) -> Affine:
        """Return the georeference of a raster whose first row is the northern one."""
        return Affine(cell_m, 0.0, self.west * cell_m, 0.0, -cell_m, (self.south + self.rows) * cell_m)


class MapTile(NamedTuple):
    """Row and column of a tile, counted from the south-west."""

    row: int
    column: int

    @property
    def name(self) -> str:
        """Name of the tile's files."""
        return f"r{self.row:04d}_c{self.column:04d}"


class TileLayout(NamedTuple):
    """Division of a map into tiles.

    A rest of less than a tenth of a tile at the eastern or northern edge belongs to the tiles beside it.

    `cell_m`: side of a cell [m]. `tile_cells`: cells along a side of a tile. `extent`: all cells of the map.

    >>> layout = TileLayout.over((0.5, 0.5, 2300.0, 900.0), 1.0, 1000)
    >>> layout.shape, layout.window(MapTile(0, 2))
    ((1, 3), CellWindow(west=2000, south=0, columns=300, rows=900))
    """

    cell_m: float
    tile_cells: int
    extent: CellWindow

    @classmethod
    def over(cls, bounds: Bounds, cell_m: float, tile_cells: int) -> Self:
        """Return the division of the cells that cover bounds [m]."""
        west, south = (math.floor(v / cell_m + 1e-9) for v in bounds[:2])
        east, north = (math.ceil(v / cell_m - 1e-9) for v in bounds[2:])
        if east <= west or north <= south:
            raise InputError(
                f"the bounds {bounds} of the map enclose no cell of {cell_m:g} m; check the points."
            )
        layout = cls(cell_m, tile_cells, CellWindow(west, south, east - west, north - south))
        rows, columns = layout.shape
        if rows * columns > _MOST_TILES or max(map(abs, (west, south, east, north))) > _MOST_CELLS:
            raise CapacityError(
                f"the map has {rows:,} × {columns:,} tiles of {tile_cells * cell_m:g} m; {_MOST_TILES:,} are possible, name a "
                "smaller --area or leave out files that lie far away."
            )
        return layout

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of tiles."""
        rest = self.tile_cells // _SMALLEST_SHARE
        rows, columns = (max(-(-(n - rest) // self.tile_cells), 1) for n in self.extent.shape)
        return rows, columns

    @property
    def tiles(self) -> list[MapTile]:
        """All tiles, row by row from the south-west."""
        rows, columns = self.shape
        return [MapTile(j, i) for j in range(rows) for i in range(columns)]

    def window(self, tile: MapTile) -> CellWindow:
        """Return the cells of a tile."""
        n, extent, (rows, columns) = self.tile_cells, self.extent, self.shape
        south, west = tile.row * n, tile.column * n
        return CellWindow(
            extent.west + west,
            extent.south + south,
            n if tile.column < columns - 1 else extent.columns - west,
            n if tile.row < rows - 1 else extent.rows - south,
        )

    def near(self, tile: MapTile, cells: int) -> Iterator[MapTile]:
        """Yield the tiles that share a cell with a tile's window grown by so many cells, itself included."""
        about = self.window(tile).grown(cells, self.extent)
        reach, (rows, columns) = -(-cells // self.tile_cells), self.shape
        for j in range(max(tile.row - reach, 0), min(tile.row + reach + 1, rows)):
            for i in range(max(tile.column - reach, 0), min(tile.column + reach + 1, columns)):
                if about.overlaps(self.window(MapTile(j, i))):
                    yield MapTile(j, i)

    def tile_numbers(self, cells: IntArray) -> IntArray:
        """Return the number of the tile (N,) of each cell (N, 2), column and row; -1 beyond the map."""
        extent = self.extent
        column, row = cells[:, 0] - extent.west, cells[:, 1] - extent.south
        inside = (column >= 0) & (row >= 0) & (column < extent.columns) & (row < extent.rows)
        rows, columns = self.shape
        row_of_tile = np.minimum(row // self.tile_cells, rows - 1)
        number = row_of_tile * columns + np.minimum(column // self.tile_cells, columns - 1)
        return np.where(inside, number, -1)
