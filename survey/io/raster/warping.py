"""Reprojection of rasters: from degrees to square cells of a projected CRS."""

import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine
from pyproj import CRS, Transformer

from survey.core import Bounds, CapacityError, FloatArray, InputError, agreed_crs
from survey.core.crs import known_crs
from survey.core.transformation import chosen_crs, geographic_of, is_geographic
from survey.io.raster.opening import LARGEST_CELLS
from survey.io.raster.reading import Raster, raster_header

_COARSEST_CUBIC = 1.5
_MARGIN_CELLS = 2
_WIDEST_M = 2e6
_ALL_KNOWN = 1.0 - 1e-6
_EDGE_POINTS = 101
# GDAL interpolates its transformation between places that differ by less than this [source cells].
_TOLERANCE_CELLS = 0.001


def window_crs(path: str | Path, crs: Any, bounds: Bounds | None) -> CRS | None:
    """Return the CRS in which the bounds of a window count, where it is not the raster's own.

    `bounds` (4,): the window [m]. Returns: the named CRS where it is projected; for a raster in degrees the
    chosen one; else None.
    """
    if crs is not None and not is_geographic(crs):
        return known_crs(crs, "the request")
    if bounds is None:
        return None
    header = raster_header(path)
    stated = crs if header.crs is None else header.crs
    return _chosen(header.transform, header.shape, stated) if is_geographic(stated) else None


def in_metres(
    raster: Raster, crs: Any, where: str, *, bounds: Bounds | None = None, nearest: bool = False
) -> Raster:
    """Return a raster in a projected CRS: as it is, or warped once where it is in degrees, and log that.

    `bounds` (4,): what is needed of a raster in degrees, in the projected CRS [m].
    """
    stated = crs if raster.crs is None else raster.crs
    if not is_geographic(stated):
        return raster._replace(crs=agreed_crs(raster.crs, crs, where))
    target = known_crs(crs, where) if crs is not None and not is_geographic(crs) else None
    target = target or _chosen(raster.transform, raster.values.shape, stated)
    warped, method = _warped(raster._replace(crs=geographic_of(stated)), target, bounds, where, nearest)
    datum = f", {raster.vertical_datum} unchanged" if raster.vertical_datum else ""
    logging.getLogger(__name__).warning(
        "%s is in degrees (%s); it is warped to %s, cells of %g m, %s interpolation%s.",
        where,
        geographic_of(stated).name,
        target.name,
        warped.transform.a,
        method,
        datum,
    )
    return warped


def cell_m(path: str | Path, crs: CRS) -> float:
    """Return the width that the cells of a raster have in a projected CRS [m]."""
    header = raster_header(path)
    if not is_geographic(header.crs):
        return abs(float(header.transform.a))
    return _step(_sides_m(header.transform, header.shape, geographic_of(header.crs), crs))


def _chosen(transform: Affine, shape: tuple[int, ...], geographic: Any) -> CRS:
    """Return the projected CRS of the middle of a raster in degrees."""
    longitude, latitude = transform @ (0.5 * shape[1], 0.5 * shape[0])
    return chosen_crs(np.array([longitude]), np.array([latitude]), geographic)


def _warped(raster: Raster, crs: CRS, bounds: Bounds | None, where: str, nearest: bool) -> tuple[Raster, str]:
    """Return the raster on square cells whose edges are multiples of their width, and the interpolation."""
    from rasterio.warp import Resampling

    raster = _turned(raster)
    sides = _sides_m(raster.transform, raster.values.shape, raster.crs, crs)
    step = _step(sides)
    if nearest:
        method = Resampling.nearest
    else:
        method = Resampling.cubic if step <= _COARSEST_CUBIC * min(sides) else Resampling.bilinear
    transform, shape = _lattice(raster, crs, step, bounds, where)
    target = (transform, shape, crs)
    source = raster if nearest else _continued(raster)
    values = _resampled(source, source.values, target, method)
    if not nearest:
        # As in `Dem.at`: no height outside the cells and where one of the four cells around is unknown.
        known = np.isfinite(raster.values).astype(np.float64)
        values[~(_resampled(raster, known, target, Resampling.bilinear) > _ALL_KNOWN)] = np.nan
    return raster._replace(values=values, transform=transform, crs=crs), str(method.name)


def _continued(raster: Raster) -> Raster:
    """Continue a raster linearly by two cells on all sides, so that its outer half cells are interpolated."""
    values = np.pad(raster.values, 2, mode="reflect", reflect_type="odd")
    return raster._replace(values=values, transform=raster.transform @ Affine.translation(-2, -2))


def _turned(raster: Raster) -> Raster:
    """Return a raster with its middle between 180° W and 180° E."""
    middle = raster.transform.c + 0.5 * raster.values.shape[1] * raster.transform.a
    return raster._replace(
        transform=Affine.translation(-360.0 * math.floor((middle + 180.0) / 360.0), 0.0) @ raster.transform
    )


def _sides_m(transform: Affine, shape: tuple[int, ...], geographic: CRS, crs: CRS) -> tuple[float, float]:
    """Return width and height of the middle cell of a raster in degrees, in a projected CRS [m]."""
    column, row = 0.5 * shape[1], 0.5 * shape[0]
    corners = [transform @ place for place in ((column, row), (column + 1, row), (column, row + 1))]
    transformer = Transformer.from_crs(geographic, crs, always_xy=True)
    (x, x_east, x_south), (y, y_east, y_south) = transformer.transform(*np.transpose(corners))
    return math.hypot(x_east - x, y_east - y), math.hypot(x_south - x, y_south - y)


def _step(sides_m: tuple[float, float]) -> float:
    """Return the width of square cells of the same area, to two digits [m].

    >>> _step((75.3, 92.6))
    84.0
    """
    if not (math.isfinite(sides_m[0]) and math.isfinite(sides_m[1]) and min(sides_m) > 0.0):
        raise InputError(
            f"the raster's middle cell measures {sides_m[0]:g} × {sides_m[1]:g} m in the projected CRS; name its CRS with --crs, or cut a window of the file first (gdal_translate -projwin)."
        )
    width = math.sqrt(sides_m[0] * sides_m[1])
    return round(width, 1 - math.floor(math.log10(width)))


def _lattice(
    raster: Raster, crs: CRS, step: float, bounds: Bounds | None, where: str
) -> tuple[Affine, tuple[int, int]]:
    """Return georeference and shape of the cells over the raster, or over the part of it that is needed."""
    west, south, east, north = _extent(raster, crs)
    if max(east - west, north - south) > _WIDEST_M:
        raise InputError(
            f"{where} is in degrees and measures {max(east - west, north - south) / 1000.0:,.0f} km; one projected CRS shows "
            f"up to {_WIDEST_M / 1000.0:,.0f} km, cut a window in degrees (gdal_translate -projwin) or assign the CRS that its metres count in."
        )
    if bounds is not None:
        margin = _MARGIN_CELLS * step
        west, south = max(west, bounds[0] - margin), max(south, bounds[1] - margin)
        east, north = min(east, bounds[2] + margin), min(north, bounds[3] + margin)
    columns = math.ceil(east / step) - math.floor(west / step)
    rows = math.ceil(north / step) - math.floor(south / step)
    if min(columns, rows) < 2:
        raise InputError(f"{where} lies elsewhere than what is needed of it; check both and their CRS.")
    if columns * rows > LARGEST_CELLS:
        raise CapacityError(
            f"{where} makes {rows:,} × {columns:,} cells of {step:g} m; {LARGEST_CELLS:,} can be held at once, "
            "cut a window (gdal_translate -projwin) first."
        )
    transform = Affine(step, 0.0, math.floor(west / step) * step, 0.0, -step, math.ceil(north / step) * step)
    return transform, (rows, columns)


def _extent(raster: Raster, crs: CRS) -> Bounds:
    """Return the bounds of a raster in another CRS, its edges curved, poles within it included [m]."""
    rows, columns = raster.values.shape
    transformer = Transformer.from_crs(raster.crs, crs, always_xy=True)
    west, north = raster.transform @ (0, 0)
    east, south = raster.transform @ (columns, rows)
    extent: Bounds = transformer.transform_bounds(
        min(west, east), min(south, north), max(west, east), max(south, north), densify_pts=_EDGE_POINTS
    )
    return extent


def _resampled(
    raster: Raster, values: FloatArray, lattice: tuple[Affine, tuple[int, int], CRS], method: Any
) -> FloatArray:
    from rasterio.warp import reproject

    transform, shape, crs = lattice
    result = np.full(shape, np.nan)
    reproject(
        values,
        result,
        src_transform=raster.transform,
        src_crs=raster.crs.to_wkt(),
        dst_transform=transform,
        dst_crs=crs.to_wkt(),
        src_nodata=np.nan,
        dst_nodata=np.nan,
        resampling=method,
        num_threads=1,
        tolerance=_TOLERANCE_CELLS,
    )
    return result
