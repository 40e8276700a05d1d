"""Digital elevation models: square cells of terrain height in a projected CRS."""

import logging
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from affine import Affine
from pyproj import CRS

from survey.core.arrays import Bounds, DataObject, FloatArray, frozen, lattice_places
from survey.core.crs import ELLIPSOIDAL, UNSTATED, datum_of_file, projected_crs, refuse_far
from survey.core.errors import InputError
from survey.core.transformation import is_geographic, metric_crs
from survey.data.conversions import drawing, html_table, optional, plot_raster, raster_of, value_range
from survey.data.grid import Grid
from survey.io.raster import Raster, read_raster, write_raster
from survey.io.raster.netcdf import dataset_of, height_attributes
from survey.io.raster.opening import check_transform
from survey.io.raster.reading import NODATA
from survey.io.raster.values import log_plateau, refuse_detached, refuse_impossible
from survey.io.raster.warping import in_metres, window_crs

if TYPE_CHECKING:
    import xdem
    from matplotlib.axes import Axes
    from xarray import DataArray

_METRES_PER_DEGREE = 111_000.0


@dataclass(frozen=True, eq=False, repr=False)
class Dem(DataObject):
    """Terrain elevation at the centres of square, north-up cells.

    Parameters
    ----------
    elevation : (H, W) array_like
        Height [m] above the vertical datum; the first row is the northern one; NaN where
        the height is not known.
    transform : affine.Affine
        Maps (column, row) of a cell's upper left corner to easting and northing [m].
    crs : str or pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        Name of the surface that heights count from; ``""`` when unstated.

    Raises
    ------
    InputError
        Fewer than 2 × 2 cells, no valid cell, a rotated or south-up transform, cells
        that are not square to one part in a thousand, a CRS in degrees.

    Notes
    -----
    A `Dem` holds one height per place: it cannot show overhangs or open crevasses.

    Examples
    --------
    >>> dem = Dem.on(Grid((0.0, 0.0, 2.0, 1.0), 1.0), [[1.0, 2.0, 3.0], [0.0, 1.0, 2.0]])
    >>> dem.at([[0.5, 0.5]])
    array([1.])
    """

    elevation: FloatArray
    transform: Affine
    crs: CRS
    vertical_datum: str = UNSTATED

    def __post_init__(self) -> None:
        elevation = frozen(self.elevation)
        object.__setattr__(self, "elevation", elevation)
        object.__setattr__(self, "crs", projected_crs(self.crs, "the DEM"))
        check_transform(self.transform)
        if elevation.ndim != 2 or min(elevation.shape) < 2:
            raise InputError(f"the DEM has the shape {elevation.shape}; at least 2 × 2 cells are needed.")
        refuse_far(self.bounds, "the DEM")
        if np.isinf(elevation).any():
            raise InputError("the DEM holds infinite heights; mark unknown cells as nodata.")
        if not np.isfinite(elevation).any():
            raise InputError(
                "the DEM holds no height at all (every cell is nodata); choose another file or window."
            )

    @classmethod
    def on(cls, grid: Grid, elevation: Any, vertical_datum: str = UNSTATED) -> Self:
        """Return the DEM whose cell centres are the grid's nodes.

        Parameters
        ----------
        grid : Grid
            Its nodes become the centres of the cells.
        elevation : (H, W) array_like
            Height [m] at the nodes, NaN where it is not known.
        vertical_datum : str
            Name of the surface that heights count from.

        Returns
        -------
        Dem
            In the grid's CRS.
        """
        values = np.asarray(elevation, dtype=np.float64)
        if values.shape != grid.shape:
            raise InputError(
                f"the heights have the shape {values.shape}, the grid {grid.shape}; they must agree."
            )
        return cls(values, grid.transform, grid.crs, vertical_datum)

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        crs: Any = None,
        vertical_datum: str | None = None,
        band: int = 1,
        bounds: Bounds | None = None,
        mask: bool = False,
        units: str | None = None,
    ) -> Self:
        """Read a raster; scale, offset and unit are applied, so that heights are in metres.

        Places and heights in feet are converted, and the log states it.

        Parameters
        ----------
        path : str or pathlib.Path
            GeoTIFF, Esri ASCII grid, NetCDF, VRT of local files, SRTM ``.hgt``, …
        crs : str or pyproj.CRS, optional
            For files that carry none or a local one (LOCAL_CS), and the projected CRS to which a file in
            degrees is warped; refused when the file names another projected one.
        vertical_datum : str, optional
            For files that do not state it.
        band : int
            Counted from 1.
        bounds : (4,) tuple of float, optional
            West, south, east, north [m] in the CRS of the result. Only the cells from which heights within
            are interpolated are read, so that a raster of any size can be used; its checksum is
            then not verified.
        mask : bool
            Read a mask of two values, such as no-go ground, instead of elevations.
        units : {"m", "ft", "us-ft"}, optional
            Unit of heights for rasters of which neither band nor vertical CRS states it.

        Returns
        -------
        Dem
            In the raster's CRS, NaN for nodata. A raster in degrees is warped once to `crs`, or to its UTM
            zone (polar stereographic beyond 84° N and 80° S) on the same geodetic datum: to square cells
            of the same area, by cubic interpolation where they are no more than 1.5 times as wide as the
            narrower side of the source's cells, else bilinearly; heights and their datum are unchanged
            and voids stay voids. The log states it.

        Raises
        ------
        InputError
            The file is missing, damaged, rotated, empty, outside the bounds, in a unit that is
            no length, or it is a picture or a mask, or unknown cells hold a number that is not declared.
        CapacityError
            It has more than `survey.io.raster.LARGEST_CELLS` cells, and no `bounds` within them are named.
        """
        raster = read_raster(
            path, band=band, bounds=bounds, bounds_crs=window_crs(path, crs, bounds), units=units
        )
        if crs is not None and raster.crs is not None:
            crs = metric_crs(crs, str(path)).crs
        if not mask:
            _refuse_mask(raster, path)
            refuse_detached(raster.values, _step_m(raster), str(path))
            log_plateau(raster.values, str(path))
            if raster.n_bands > 1 and band == 1:
                logging.getLogger(__name__).warning("%s has %d bands; band 1 is read.", path, raster.n_bands)
            refuse_impossible(raster.values, str(path))
        raster = in_metres(raster, crs, str(path), bounds=bounds, nearest=mask)
        if vertical_datum and raster.vertical_datum and vertical_datum != raster.vertical_datum:
            raise InputError(
                f"{path} states {raster.vertical_datum!r}, but {vertical_datum!r} was named; correct one of them."
            )
        datum = datum_of_file(raster.vertical_datum or vertical_datum or UNSTATED, crs, str(path))
        try:
            return cls(raster.values, raster.transform, raster.crs, datum)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    @classmethod
    def from_xarray(cls, array: "DataArray", *, crs: Any = None, vertical_datum: str | None = None) -> Self:
        """Return the DEM of an xarray object, such as `to_xarray` or rioxarray give.

        Parameters
        ----------
        array : xarray.DataArray
            Heights [m] with coordinates of the cells' centres [m] along both dimensions, in either order of each. The CRS
            is that of the coordinate which ``grid_mapping`` names, ``spatial_ref`` by default; ``_FillValue`` marks unknown
            heights where they are not NaN.
        crs : str or pyproj.CRS, optional
            For arrays that state none.
        vertical_datum : str, optional
            Name of the surface that heights count from, for arrays whose attribute ``vertical_datum`` does not state it.

        Returns
        -------
        Dem
            In the array's CRS; nothing is warped.

        Raises
        ------
        InputError
            Another unit than metres, uneven steps, cells that are not square, no CRS, or one in degrees.

        Examples
        --------
        >>> dem = Dem.on(Grid((0.0, 0.0, 2.0, 1.0), 1.0, "EPSG:32608"), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
        >>> float(Dem.from_xarray(dem.to_xarray()).at([[2.0, 1.0]])[0])
        3.0
        """
        values, transform, stated = raster_of(array, crs)
        datum = vertical_datum or str(array.attrs.get("vertical_datum", UNSTATED))
        return cls(values, transform, stated, datum)

    def write(self, path: str | Path, name: str = "elevation") -> None:
        """Write a Cloud-Optimized GeoTIFF (float32, nodata -9999).

        Parameters
        ----------
        path : str or pathlib.Path
            The file; ``.asc`` and ``.nc`` give an ASCII grid and NetCDF, anything else a GeoTIFF.
        name : str
            Name of the band.
        """
        write_raster(path, {name: self.elevation}, self.transform, self.crs, self.vertical_datum)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.elevation.shape
        return rows, columns

    @property
    def step_m(self) -> float:
        """Width of a cell [m]."""
        return float(self.transform.a)

    @cached_property
    def x(self) -> FloatArray:
        """Easting of the cell centres [m], (W,), ascending."""
        array: FloatArray = frozen(self.transform.c + self.transform.a * (np.arange(self.shape[1]) + 0.5))
        return array

    @cached_property
    def y(self) -> FloatArray:
        """Northing of the cell centres [m], (H,), descending."""
        array: FloatArray = frozen(self.transform.f + self.transform.e * (np.arange(self.shape[0]) + 0.5))
        return array

    @property
    def xy(self) -> FloatArray:
        """Easting and northing of every cell centre [m], (H * W, 2), row by row."""
        return lattice_places(self.x, self.y)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)`` of the cells' outer edges [m]."""
        rows, columns = self.shape
        t = self.transform
        return float(t.c), float(t.f + rows * t.e), float(t.c + columns * t.a), float(t.f)

    @property
    def relief_m(self) -> float:
        """Highest minus lowest valid cell [m]."""
        return float(np.nanmax(self.elevation) - np.nanmin(self.elevation))

    def grid(self) -> Grid:
        """Return the grid whose nodes are the cell centres.

        Returns
        -------
        Grid
            In the CRS of the DEM.
        """
        xmin, xmax, ymin, ymax = float(self.x[0]), float(self.x[-1]), float(self.y[-1]), float(self.y[0])
        return Grid((xmin, ymin, xmax, ymax), self.step_m, self.crs)

    def at(self, xy: Any) -> FloatArray:
        """Interpolate bilinearly between cell centres.

        Within the outer half cell the outermost patch is continued linearly.

        Parameters
        ----------
        xy : (N, 2) array_like
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray
            Height [m]; NaN outside the cells and where one of the four cells is nodata.
        """
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        rows, columns = self.shape
        u = (points[:, 0] - self.transform.c) / self.transform.a - 0.5
        v = (points[:, 1] - self.transform.f) / self.transform.e - 0.5
        # Half a micrometre of slack, so that a point on the edge is inside whatever the rounding.
        slack = 5e-7 / self.step_m + 0.5
        inside = (u >= -slack) & (u <= columns - 1 + slack) & (v >= -slack) & (v <= rows - 1 + slack)
        column = np.clip(np.floor(np.where(inside, u, 0.0)), 0, columns - 2).astype(np.int64)
        row = np.clip(np.floor(np.where(inside, v, 0.0)), 0, rows - 2).astype(np.int64)
        s, t = u - column, v - row
        z = self.elevation
        upper = _between(z[row, column], z[row, column + 1], s)
        lower = _between(z[row + 1, column], z[row + 1, column + 1], s)
        return np.where(inside, _between(upper, lower, t), np.nan)

    def gradient(self) -> tuple[FloatArray, FloatArray]:
        """Return dz/dx and dz/dy (east and north positive), each (H, W), by central differences.

        Returns
        -------
        to_east, to_north : tuple of (H, W) ndarray
            Rise per metre; NaN beside unknown cells.
        """
        to_north: FloatArray = np.asarray(np.gradient(self.elevation, self.transform.e, axis=0))
        to_east: FloatArray = np.asarray(np.gradient(self.elevation, self.transform.a, axis=1))
        return to_east, to_north

    def slope(self) -> Self:
        """Return the steepest slope [deg] as a raster on the same cells.

        Returns
        -------
        Dem
            Slope [deg] in place of heights; NaN beside unknown cells.
        """
        to_east, to_north = self.gradient()
        return self._with(np.degrees(np.arctan(np.hypot(to_east, to_north))))

    def window(self, bounds: tuple[float, float, float, float]) -> Self:
        """Return the cells whose centres lie within ``(xmin, ymin, xmax, ymax)``.

        Parameters
        ----------
        bounds : (4,) tuple of float
            ``(xmin, ymin, xmax, ymax)`` [m].

        Returns
        -------
        Dem
            The cells within, on the same lattice.

        Raises
        ------
        InputError
            When fewer than 2 × 2 centres lie inside.
        """
        xmin, ymin, xmax, ymax = bounds
        slack = 1e-6 * self.step_m
        columns = np.flatnonzero((self.x >= xmin - slack) & (self.x <= xmax + slack))
        rows = np.flatnonzero((self.y >= ymin - slack) & (self.y <= ymax + slack))
        if len(columns) < 2 or len(rows) < 2:
            raise InputError(
                f"the window {tuple(round(b, 2) for b in bounds)} holds {len(rows)} × {len(columns)} cells of the DEM, "
                f"whose bounds are {tuple(round(b, 2) for b in self.bounds)}; at least 2 × 2 are needed."
            )
        shifted = self.transform @ Affine.translation(columns[0], rows[0])
        values = self.elevation[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        return self._with(values, shifted)

    def block_mean(self, cell_m: float) -> Self:
        """Average square blocks of cells.

        A block is valid when at least half of its cells are; rows and columns left over at
        the south and east are dropped.

        Parameters
        ----------
        cell_m : float
            Side of the blocks [m].

        Returns
        -------
        Dem
            Means [m], NaN where more than half of a block is unknown.

        Raises
        ------
        InputError
            When `cell_m` is no whole multiple of the cell's width or leaves fewer than 2 × 2 blocks.
        """
        n = round(cell_m / self.step_m)
        if n < 1 or abs(n * self.step_m - cell_m) > 1e-6 * cell_m:
            raise InputError(
                f"blocks of {cell_m:g} m are no whole multiple of the DEM's {self.step_m:g} m cells; choose another size."
            )
        rows, columns = self.shape[0] // n, self.shape[1] // n
        if rows < 2 or columns < 2:
            raise InputError(
                f"blocks of {cell_m:g} m leave {rows} × {columns} of them; at least 2 × 2 are needed."
            )
        blocks = self.elevation[: rows * n, : columns * n].reshape(rows, n, columns, n)
        n_valid = np.isfinite(blocks).sum(axis=(1, 3))
        mean = np.where(n_valid * 2 >= n * n, np.nansum(blocks, axis=(1, 3)) / np.maximum(n_valid, 1), np.nan)
        return self._with(mean, self.transform @ Affine.scale(n))

    @drawing
    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the elevation as a coloured raster.

        $axes

        Notes
        -----
        Of rasters beyond 1,000 rows or columns, every second, third … cell is drawn.
        """
        return plot_raster(ax, self.elevation, self.bounds, "Elevation [m]")

    def to_xarray(self) -> "DataArray":
        """Return the elevation as an xarray object with CF metadata.

        Returns
        -------
        xarray.DataArray
            Dimensions y and x [m]; the CRS is the coordinate ``spatial_ref``.

        Raises
        ------
        InputError
            When xarray is not installed.
        """
        optional("xarray", "to_xarray")
        elevation = self.elevation, height_attributes(self.vertical_datum)
        dataset = dataset_of({"elevation": elevation}, self.transform, self.crs, self.vertical_datum)
        datum = {"vertical_datum": self.vertical_datum} if self.vertical_datum else {}
        return dataset["elevation"].assign_attrs(datum)

    def to_xdem(self) -> "xdem.DEM":
        """Return the elevation as a DEM of xdem, which is a raster of geoutils as well.

        Returns
        -------
        xdem.DEM
            The heights as float64 with the transform and the CRS; its vertical CRS is the ellipsoid, EGM96 or EGM2008 where
            that is the vertical datum, and not stated for any other: xdem knows no more by name.

        Raises
        ------
        InputError
            When xdem is not installed.
        """
        xdem = optional("xdem", "to_xdem", "xdem")
        known = {ELLIPSOIDAL: "Ellipsoid", "EGM96 height": "EGM96", "EGM2008 height": "EGM08"}
        heights = np.ma.masked_invalid(self.elevation)
        return xdem.DEM.from_array(
            heights, self.transform, self.crs, nodata=NODATA, vcrs=known.get(self.vertical_datum)
        )

    def _facts(self) -> dict[str, str]:
        rows, columns = self.shape
        return {
            "cells": f"{rows} × {columns} of {self.step_m:g} m",
            "elevation": value_range(self.elevation),
            "CRS": self.crs.name,
        }

    def _summary(self) -> str:
        return ", ".join(self._facts().values())

    def _repr_html_(self) -> str:
        return html_table("Dem", self._facts(), self.plot)

    def _with(self, elevation: FloatArray, transform: Affine | None = None) -> Self:
        return type(self)(elevation, transform or self.transform, self.crs, self.vertical_datum)


def _between(a: FloatArray, b: FloatArray, t: FloatArray) -> FloatArray:
    """Interpolate linearly; exact at both ends, so a nodata neighbour of weight 0 does not count."""
    return np.where(t == 0.0, a, np.where(t == 1.0, b, a + (b - a) * t))


def _refuse_mask(raster: Raster, path: str | Path) -> None:
    """Refuse bytes of at most two values: a mask that was taken for elevations."""
    if raster.stored_as not in ("uint8", "int8"):
        return
    found = np.unique(raster.values[np.isfinite(raster.values)])
    if 0 < len(found) <= 2:
        values = " and ".join(f"{value:g}" for value in found)
        raise InputError(
            f"{path} holds bytes of the values {values} alone, so it is a mask; a raster of elevations in metres was expected."
        )


def _step_m(raster: Raster) -> float:
    """Return about the width of a raster's cells [m]."""
    return abs(raster.transform.e) * (_METRES_PER_DEGREE if is_geographic(raster.crs) else 1.0)
