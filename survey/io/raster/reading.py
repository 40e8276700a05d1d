"""Reading of elevation rasters through GDAL: values in metres, NaN for nodata, georeference, checksum."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from affine import Affine
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from survey.core.arrays import Bounds, FloatArray
from survey.core.checksum import refuse_altered
from survey.core.crs.choice import geographic_of
from survey.core.crs.vertical_datum import UNSTATED, vertical_datum_of
from survey.core.files.reading import existing_file
from survey.io.raster.deflate_blocks import refuse_damaged_blocks
from survey.io.raster.facts import stated_datum
from survey.io.raster.opening import checked_band, damaged, opened_dataset
from survey.io.raster.strips import read_strips, window_of

NODATA = -9999.0
CRC_TAG = "FIRNLINE_CRC32"
_EDGE_POINTS = 21
_MARGIN_CELLS = 2


class Raster(NamedTuple):
    """One band of a raster.

    Parameters
    ----------
    values : (H, W) ndarray
        Values [m], NaN for nodata; the first row is the northern one, unless the raster is rotated.
    transform : affine.Affine
        Maps (column, row) of a cell's upper left corner to the CRS.
    crs : str or pyproj.CRS or None
        As the file states it.
    vertical_datum : str
        As the file states it; ``""`` when unstated.
    stored_as : str
        Data type of the file's band.
    """

    values: FloatArray
    transform: Affine
    crs: Any
    vertical_datum: str
    stored_as: str = "float64"


def read_raster(
    path: str | Path, *, band: int = 1, bounds: Bounds | None = None, bounds_crs: CRS | None = None
) -> Raster:
    """Read one band with its georeference; scale, offset and unit are applied, nodata becomes NaN.

    Parameters
    ----------
    path : str or pathlib.Path
        A file whose suffix is in `survey.io.file_kinds.RASTER_DRIVERS`.
    band : int
        Counted from 1; of NetCDF files with several variables, the number of the variable.
    bounds : (4,) tuple of float, optional
        West, south, east, north in the raster's CRS: only the cells from which heights within
        are interpolated are read, and the checksum of the whole band is not verified.
    bounds_crs : pyproj.CRS, optional
        The projected CRS of the bounds, for rasters in degrees; others have bounds in their own CRS.

    Returns
    -------
    Raster
        Values in metres.

    Raises
    ------
    InputError
        The file is missing, empty, damaged, of another kind, leads to other places than its own
        files, has no such band, or the band is a picture or in a unit that is no length.
    CapacityError
        More than `LARGEST_CELLS` cells are to be read.

    Notes
    -----
    NetCDF files are read twice, first by a process that may be stopped: see `survey.io.raster.hdf5`.
    """
    file = existing_file(path, "the raster")
    with opened_dataset(file, band) as source:
        in_source = checked_band(source, file, band)
        window = window_of(source, file, _own_bounds(source, bounds, bounds_crs))
        crcs = source.tags().get(CRC_TAG, "").split()
        is_summed = len(crcs) >= band and bounds is None
        if not is_summed:
            refuse_damaged_blocks(source, file, in_source, window)
        values = read_strips(source, in_source, window)
        crs = source.crs.to_wkt() if source.crs else None
        datum = stated_datum(source)
        transform = source.transform @ Affine.translation(window[0], window[1])
        stored_as = str(source.dtypes[in_source - 1])
    if is_summed:
        refuse_altered(file, crcs[band - 1], checksum_parts(values, transform, datum), f"the tag {CRC_TAG}")
    try:
        datum = datum or (vertical_datum_of(crs) if crs else UNSTATED)
    except CRSError as error:
        raise damaged(file, error) from error
    values, transform = _north_up(values, transform)
    return Raster(values, transform, crs, datum, stored_as)


def _north_up(values: FloatArray, transform: Affine) -> tuple[FloatArray, Affine]:
    """Return a raster whose first row is the southern one with its rows the other way round; others as they are."""
    t = transform
    is_south_up = t.b == t.d == 0.0 and t.a > 0.0 and t.e > 0.0
    if not is_south_up or t == Affine.identity():  # which stands for no georeference
        return values, transform
    turned = transform @ Affine.translation(0, len(values)) @ Affine.scale(1.0, -1.0)
    return np.ascontiguousarray(values[::-1]), turned


def _own_bounds(source: Any, bounds: Bounds | None, crs: CRS | None) -> Bounds | None:
    """Return bounds in the raster's own CRS; in degrees they take in two cells more."""
    if bounds is None or crs is None or not source.crs or not source.crs.is_geographic:
        return bounds
    to_degrees = Transformer.from_crs(crs, geographic_of(source.crs.to_wkt()), always_xy=True)
    west, south, east, north = to_degrees.transform_bounds(*bounds, densify_pts=_EDGE_POINTS)
    t = source.transform
    middle = t.c + 0.5 * source.width * t.a
    if east < west:  # bounds across 180 degrees
        east += 360.0
    turn = 360.0 * round((middle - 0.5 * (west + east)) / 360.0)
    x, y = _MARGIN_CELLS * abs(t.a), _MARGIN_CELLS * abs(t.e)
    return west + turn - x, south - y, east + turn + x, north + y


def checksum_parts(values: FloatArray, transform: Affine, vertical_datum: str) -> tuple[Any, ...]:
    """Return what a band's checksum is taken of: the numbers as they are stored, their place and datum.

    Parameters
    ----------
    values : (H, W) ndarray
        A band [m].
    transform : affine.Affine
        Its georeference.
    vertical_datum : str
        Its vertical datum.

    Returns
    -------
    tuple
        For `survey.core.checksum.checksum`.
    """
    stored = np.where(np.isfinite(values), values, NODATA).astype("<f4")
    return (
        stored,
        np.array(values.shape, dtype="<i8"),
        np.array(transform.to_gdal(), dtype="<f8"),
        vertical_datum,
    )
