"""Reading of elevation rasters through GDAL: values in metres, NaN for nodata, georeference, checksum.

`read_raster` returns one band, or a window of it, and compares the CRC-32 of its values. Cells are read in strips of rows;
`read_window` reads parts of a raster that stays open. Bands, size and vertical datum are read without the cells.
"""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from affine import Affine
from pyproj import CRS, Transformer

from survey.core import UNSTATED, Bounds, CapacityError, FloatArray, InputError, existing_file
from survey.core.crs import datum_named, vertical_datum_of
from survey.core.lengths import log_converted
from survey.core.transformation import geographic_of
from survey.io.arrays_file import refuse_altered
from survey.io.raster.opening import (
    LARGEST_CELLS,
    check_band,
    open_dataset,
    open_list_of_bands,
    refuse_damaged_blocks,
)
from survey.io.raster.values import band_scale, crs_of_raster, refuse_picture, refuse_unmarked, valid_range

NODATA = -9999.0
CRC_TAG = "FIRNLINE_CRC32"
_EDGE_POINTS = 21
_MARGIN_CELLS = 2


class Raster(NamedTuple):
    """One band of a raster.

    `values` (H, W): values [m], NaN for nodata; the first row is the northern one, unless the raster is
    rotated. `transform`: maps (column, row) of a cell's upper left corner to the CRS. `crs`: as the file
    states it. `vertical_datum`: as the file states it; ``""`` when unstated. `stored_as`: data type of the
    file's band. `n_bands`: bands of a file of another program; 0 for firnline's own.
    """

    values: FloatArray
    transform: Affine
    crs: Any
    vertical_datum: str
    stored_as: str = "float64"
    n_bands: int = 0


def read_raster(
    path: str | Path,
    *,
    band: int = 1,
    bounds: Bounds | None = None,
    bounds_crs: CRS | None = None,
    units: str | None = None,
) -> Raster:
    """Read one band with its georeference; scale, offset and unit are applied, nodata becomes NaN.

    A raster whose CRS counts in feet comes in the twin of that CRS in metres. `units`: unit of heights (``m``, ``ft``,
    ``us-ft``) that the file does not state.

    `bounds` (4,): west, south, east, north in the CRS of the result: only the cells from which heights within are
    interpolated are read, and the checksum of the whole band is not verified.

    NetCDF files are read twice, first by a process that may be stopped: see `survey.io.raster.opening`.
    """
    file = existing_file(path, "the raster")
    with open_dataset(file, band) as source:
        in_source = check_band(source, file, band, units)
        system = crs_of_raster(source)
        window = window_of(source, file, _own_bounds(source, bounds, bounds_crs))
        crcs = source.tags().get(CRC_TAG, "").split()
        is_summed = len(crcs) >= band and bounds is None
        if not is_summed:
            refuse_damaged_blocks(source, file, in_source, window)
        values = read_strips(source, in_source, window, units)
        crs = system.crs.to_wkt() if source.crs else None
        datum = stated_datum(source)
        stored = source.transform @ Affine.translation(window[0], window[1])
        transform = stored if system.place_m == 1.0 else Affine.scale(system.place_m) @ stored
        if band == 1:
            log_scale(source, file, units)
        stored_as = str(source.dtypes[in_source - 1])
        n_bands = 0 if crcs else int(source.count)
        stated = datum or (vertical_datum_of(system.crs) if crs else UNSTATED)
    if is_summed:
        refuse_altered(file, crcs[band - 1], checksum_parts(values, transform, datum), f"the tag {CRC_TAG}")
    values, transform = _north_up(values, transform)
    return Raster(values, transform, crs, stated, stored_as, n_bands)


def log_scale(source: Any, file: str | Path, units: str | None) -> None:
    """Log where the places or heights of an open raster are in another unit than metres."""
    heights = band_scale(source, 1, units).factor / float(source.scales[0])
    log_converted(str(file), (("places", crs_of_raster(source).place_m), ("heights", heights)))


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
    if bounds is not None and (foot_m := crs_of_raster(source).place_m) != 1.0:
        return bounds[0] / foot_m, bounds[1] / foot_m, bounds[2] / foot_m, bounds[3] / foot_m
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

    `values` (H, W): a band [m].
    """
    stored = np.where(np.isfinite(values), values, NODATA).astype("<f4")
    return (
        stored,
        np.array(values.shape, dtype="<i8"),
        np.array(transform.to_gdal(), dtype="<f8"),
        vertical_datum,
    )


VERTICAL_TAG = "VERTICAL_DATUM"


class RasterFacts(NamedTuple):
    """Rows and columns of a raster, its CRS where it names one, and its georeference."""

    shape: tuple[int, int]
    crs: Any
    transform: Affine


def stated_datum(source: Any) -> str:
    """Return the vertical datum that an open raster's tags name, or ``""``."""
    tags = source.tags()
    return datum_named(tags.get(VERTICAL_TAG) or tags.get(f"NC_GLOBAL#{VERTICAL_TAG.lower()}") or UNSTATED)


_SOURCE_TAGS = ("SOURCE", "source", "NC_GLOBAL#source")


def stated_source(path: str | Path) -> str:
    """Return how a raster says that it was made, by a tag SOURCE or the attribute ``source`` of CF conventions, or ``""``."""
    with open_dataset(existing_file(path, "the raster"), 1) as source:
        tags = source.tags()
    return next((tags[name].strip() for name in _SOURCE_TAGS if name in tags), "")


def raster_facts(path: str | Path, units: str | None = None) -> RasterFacts:
    """Return what a raster's header says, without reading its cells."""
    with open_raster(existing_file(path, "the raster"), units) as source:
        return _facts(source)


def raster_header(path: str | Path) -> RasterFacts:
    """Return what a raster's header says; damage of its cells is not looked for."""
    with open_dataset(existing_file(path, "the raster"), 1) as source:
        return _facts(source)


def _facts(source: Any) -> RasterFacts:
    crs, metres, _ = crs_of_raster(source)
    transform = source.transform if metres == 1.0 else Affine.scale(metres) @ source.transform
    return RasterFacts(
        (int(source.height), int(source.width)), crs.to_wkt() if source.crs else None, transform
    )


def band_count(path: str | Path) -> int:
    """Return the number of bands of a raster, or of variables of a NetCDF file."""
    return len(band_names(path))


# Names of bands that hold standard deviations have one of these words; band_2 is a second band without a name.
_SIGMA_WORDS = re.compile(
    r"(^|[^a-z])(sigma|sd|std|std ?dev|stdev|dev|deviation|uncertainty|err|errors?|rmse)([^a-z]|$)|σ|^band_2$"
)


def sigma_band(path: str | Path) -> int | None:
    """Return the number of the band of standard deviations: the second, unless its name says something else."""
    second = "".join(band_names(path)[1:2]).casefold()
    return 2 if _SIGMA_WORDS.search(second) else None


def band_names(path: str | Path) -> list[str]:
    """Return the names of the bands of a raster; numbered where it gives none."""
    with open_list_of_bands(existing_file(path, "the raster")) as source:
        if source.subdatasets:
            return [part.rsplit(":", 1)[1] for part in source.subdatasets]
        described = [d or "" for d in source.descriptions]
    if len(described) == 1 and not described[0]:
        return ["elevation"]
    return [name or f"band_{k}" for k, name in enumerate(described, start=1)]


_STRIP_CELLS = 4_000_000


@contextmanager
def open_raster(file: Path, units: str | None = None) -> Iterator[Any]:
    """Open a raster for reading in windows by `read_window`; what GDAL then finds damaged is refused in a sentence."""
    with open_dataset(file, 1) as source:
        check_band(source, file, 1, units)
        refuse_damaged_blocks(source, file, 1, (0, 0, source.width, source.height))
        yield source


def window_of(source: Any, file: Path, bounds: Bounds | None) -> tuple[int, int, int, int]:
    """Return first column, first row, width and height of what is to be read, or refuse as too large."""
    window = (0, 0, int(source.width), int(source.height))
    t = source.transform
    if bounds is not None and t.b == t.d == 0.0 and t.a > 0.0 and t.e != 0.0:
        window = _window_over(bounds, t, source.width, source.height, file)
    _, _, width, height = window
    if height * width > LARGEST_CELLS:
        raise CapacityError(
            f"{file} has {height:,} × {width:,} cells {'there' if bounds else 'in all'}; {LARGEST_CELLS:,} can be read at once "
            f"({8 * LARGEST_CELLS / 1e9:.2f} GB), cut a window (gdal_translate -projwin) or average it (gdalwarp -tr) first."
        )
    return window


def _window_over(bounds: Bounds, t: Affine, width: int, height: int, file: Path) -> tuple[int, int, int, int]:
    """Return the cells from which heights within the bounds are interpolated: one more to each side."""
    west, south, east, north = bounds
    columns = _span((west - t.c) / t.a, (east - t.c) / t.a, width)
    edges = sorted(((north - t.f) / t.e, (south - t.f) / t.e))  # the first row may be the southern one
    rows = _span(edges[0], edges[1], height)
    if min(columns[1], rows[1]) < 2:
        south, north = sorted((t.f, t.f + height * t.e))
        raise InputError(
            f"{file} lies elsewhere than the bounds ({', '.join(f'{b:.7g}' for b in bounds)}): it reaches from "
            f"{t.c:.7g}, {south:.7g} to {t.c + width * t.a:.7g}, {north:.7g}; check both and their CRS."
        )
    return columns[0], rows[0], columns[1], rows[1]


def _span(low: float, high: float, n: int) -> tuple[int, int]:
    """Return the first cell and the number of cells between two places counted in cells, one more to each side."""
    if not (low < n and high > 0.0):
        return 0, 0
    first, last = max(0, math.floor(low) - 1), min(n, math.ceil(high) + 1)
    return first, last - first


def read_strips(source: Any, band: int, window: Sequence[int], units: str | None = None) -> FloatArray:
    """Read a band strip by strip, so that memory follows what the file holds and not what its header claims."""
    from rasterio.windows import Window

    column, row, width, height = window
    values = np.empty((height, width))
    rows = max(1, _STRIP_CELLS // width)
    for first in range(0, height, rows):
        strip = Window(column, row + first, width, min(rows, height - first))
        values[first : first + rows] = read_window(source, band, strip, units)
    return values


def read_window(source: Any, band: int, window: Any, units: str | None = None) -> FloatArray:
    """Read a window of an open raster.

    Returns (h, w): values [m], scale, offset and unit applied; NaN for nodata.
    """
    refuse_picture(source, band)
    strip = source.read(band, window=window, masked=True, out_dtype=np.float64)
    stored: FloatArray = strip.filled(np.nan)
    stored[~np.isfinite(stored)] = np.nan
    low, high = valid_range(source, band)
    stored[(stored < low) | (stored > high)] = np.nan
    scale = band_scale(source, band, units)
    refuse_unmarked(stored, source.name, source.dtypes[band - 1], in_metres=scale == (1.0, 0.0))
    return scale.applied(stored)
