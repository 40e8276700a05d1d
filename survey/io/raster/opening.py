"""Opening of rasters by the driver of their suffix, and detection of damage that GDAL does not report.

A raster is opened after the check of its content; georeference, axes, blocks and band are checked before its cells are
read. Two checks go beyond GDAL: a tag with the CRS, because a single flipped bit of the GeoTIFF key names another zone;
and the Adler-32 checksums of deflate-compressed TIFF blocks. NetCDF is first read in another process
(`survey.io.raster.netcdf_trial`).
"""

import math
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine
from pyproj import CRS
from pyproj.exceptions import CRSError

from survey.core.crs import equal_crs
from survey.core.errors import CapacityError, InputError
from survey.core.files import DamagedError, warnings_logged
from survey.core.foreign import refusing_damage
from survey.io.dataset_files import VrtPart, raster_parts
from survey.io.file_kinds import OFFLINE, RASTER_DRIVERS, check_raster_file
from survey.io.raster.netcdf_trial import refuse_unreadable
from survey.io.raster.values import band_scale, refuse_depths, refuse_picture

LARGEST_CELLS = 40_000_000
"""Largest raster or window that is read at once: 0.32 GB as float64, some 2.2 GB while a survey is planned on it."""
_LARGEST_BLOCK_BYTES = 2**29
# GDAL holds blocks that it has read in up to a twentieth of the machine's memory by default.
_CACHE_BYTES = 64 * 2**20


@contextmanager
def open_dataset(file: Path, band: int) -> Iterator[Any]:
    """Open a raster by the driver of its suffix, after its content has been checked."""
    import rasterio  # GDAL is loaded when first needed: maps from arrays do without its 20 MB

    with _checked(file), rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES, **OFFLINE), _dataset(file, band) as source:
        if source.tags(ns="OVERVIEWS"):
            raise InputError(f"{file} names a file of overviews; write it again (gdal_translate).")
        refuse_altered_crs(source, file)
        yield source


@contextmanager
def open_list_of_bands(file: Path) -> Iterator[Any]:
    """Open a raster for its bands alone: a NetCDF file with several variables lists them as data sets."""
    import rasterio

    driver = RASTER_DRIVERS[file.suffix.lower()]
    with (
        _checked(file),
        rasterio.Env(**OFFLINE),
        rasterio.open(str(file.absolute()), driver=driver) as source,
    ):
        yield source


@contextmanager
def _checked(file: Path) -> Iterator[None]:
    """Check a raster's content before it is opened; refuse a damaged one in one sentence."""
    check_raster_file(file)
    if file.suffix.lower() == ".nc":
        refuse_unreadable(file, LARGEST_CELLS)
    with refusing_damage(str(file), "raster of the format of its suffix"), warnings_logged():
        yield


def _dataset(file: Path, band: int) -> Any:
    """Return the open data set: of a NetCDF file with several variables, the one that stands for the band."""
    import rasterio

    driver = RASTER_DRIVERS[file.suffix.lower()]
    # GDAL would put 0 in the place of numbers beyond the valid range where no nodata is declared.
    options = {"HONOUR_VALID_RANGE": "NO"} if driver == "netCDF" else {}
    path = str(file.absolute())  # a relative name could be taken for an address
    whole = rasterio.open(path, driver=driver, **options)
    if driver != "netCDF" or not whole.subdatasets:
        return whole
    parts: list[str] = whole.subdatasets
    whole.close()
    if not 1 <= band <= len(parts):
        raise InputError(f"{file} has {len(parts)} variables; number {band} was asked for.")
    return rasterio.open(parts[band - 1], driver=driver, **options)


def check_band(source: Any, file: Path, band: int, units: str | None = None) -> int:
    """Return the number of the band within what was opened, or refuse."""
    number = 1 if source.driver == "netCDF" and source.count == 1 else band
    if not 1 <= number <= source.count:
        raise InputError(f"{file} has {source.count} bands; band {band} was asked for.")
    if np.issubdtype(np.dtype(source.dtypes[number - 1]), np.complexfloating):
        raise InputError(f"{file} holds complex numbers; elevations in metres were expected.")
    refuse_picture(source, number)
    band_scale(source, number, units)
    refuse_depths(source, number)
    _refuse_other_axes(source, file)
    _refuse_large_blocks(source, file, number)
    return number


def _refuse_other_axes(source: Any, file: Path) -> None:
    """Refuse NetCDF coordinates that are not in metres though the CRS is: GDAL takes them for metres."""
    tags = source.tags()
    for key, name in tags.items():
        variable, _, attribute = key.partition("#")
        is_axis = attribute == "standard_name" and name in (
            "projection_x_coordinate",
            "projection_y_coordinate",
        )
        unit = tags.get(f"{variable}#units", "m")
        if is_axis and unit.lower() not in ("m", "metre", "meter", "metres", "meters"):
            raise InputError(
                f"{file} has the coordinate {variable} in {unit[:40]!r}; metres were expected, convert it and write the file again."
            )


def _refuse_large_blocks(source: Any, file: Path, band: int) -> None:
    bands = source.count if str(source.interleaving).lower().endswith("pixel") else 1
    cell_bytes = np.dtype(source.dtypes[band - 1]).itemsize
    block_bytes = math.prod(source.block_shapes[band - 1]) * cell_bytes * bands
    if block_bytes > _LARGEST_BLOCK_BYTES:
        raise CapacityError(
            f"{file} stores its cells in blocks of {block_bytes / 1e9:.1f} GB ({source.count} bands), and {_LARGEST_BLOCK_BYTES / 1e9:.1f} GB can be read; "
            "it is damaged, or to be rewritten in tiles (gdal_translate -co TILED=YES)."
        )


def rasterio_errors() -> tuple[type[Exception], ...]:
    """Return what writing through GDAL may raise; what GDAL itself reports has no public home."""
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError

    return RasterioError, CPLE_BaseError, DamagedError, UnicodeError, MemoryError, CRSError


_SMALLEST_M = 1e-4


def check_transform(t: Affine) -> None:
    """Refuse a transform that is not north-up with square cells.

    `t`: maps (column, row) of a cell's upper left corner to easting and northing [m].

    >>> check_transform(Affine(3.0, 0.0, 500_000.0, 0.0, -3.0, 6_700_000.0))
    """
    if t == Affine.identity():
        raise InputError(
            "the raster has no georeference; assign one (gdal_edit.py -a_ullr), and in NetCDF give the axes the standard_name "
            "projection_x_coordinate and projection_y_coordinate."
        )
    if t.b != 0.0 or t.d != 0.0:
        raise InputError(
            "the raster is rotated; rows must run west to east, warp it to north-up first (gdalwarp does it)."
        )
    if t.a <= 0.0 or t.e >= 0.0:
        raise InputError(
            f"the raster's cell is {t.a:g} by {t.e:g} m; the first row must be the northern one and the first column the western "
            "one, warp it to north-up first (gdalwarp does it)."
        )
    if abs(t.a + t.e) > 1e-3 * t.a:
        raise InputError(
            f"the raster's cells measure {t.a:g} × {-t.e:g} m; square cells are needed, resample the file first (gdalwarp -tr)."
        )
    if t.a < _SMALLEST_M:
        raise InputError(
            f"the raster's cells measure {t.a:g} m, and coordinates cannot resolve cells below {_SMALLEST_M:g} m; check the transform of the file (gdalinfo)."
        )


CRS_TAG = "FIRNLINE_CRS"


def crs_tag(crs: CRS) -> dict[str, str]:
    """Return the tag of a CRS that has a code; none for others.

    >>> crs_tag(CRS("EPSG:32608"))
    {'FIRNLINE_CRS': 'EPSG:32608'}
    """
    authority = crs.to_authority(min_confidence=100)
    return {} if authority is None else {CRS_TAG: ":".join(authority)}


def refuse_altered_crs(source: Any, file: Path) -> None:
    """Refuse an open GeoTIFF whose CRS is not that of its tag."""
    stated = source.tags().get(CRS_TAG)
    if stated is None or _is_same(stated, source.crs):
        return
    raise InputError(
        f"{file} states another CRS than its tag {CRS_TAG} ({stated[:40]!r}); it was changed after firnline wrote it, get it "
        "again."
    )


def _is_same(stated: str, found: Any) -> bool:
    try:
        crs = CRS.from_wkt(found.to_wkt())
        return equal_crs(CRS(stated), crs.sub_crs_list[0] if crs.is_compound else crs)
    except (CRSError, AttributeError):
        return False


_TIFF = ("GTiff", "COG")
_SLICE = 1 << 16


def refuse_damaged_blocks(source: Any, file: Path, band: int, window: Sequence[int]) -> None:
    """Compare the checksums of the deflate-compressed blocks of a TIFF band that a window touches.

    GDAL returns the values of a block whose checksum is wrong, without a warning. Blocks of
    other compressions carry no checksum and pass. The sources of a VRT are compared in the same way.

    `window`: first column, first row, width and height [cells].
    """
    if source.driver == "VRT":
        for part in raster_parts(file, band, window):
            _refuse_damaged_part(part)
    if source.driver not in _TIFF or source.profile.get("compress") != "deflate":
        return
    with file.open("rb") as stream:
        for place, offset, size in _blocks(source, band, window):
            stream.seek(offset)
            if not _is_sound(stream.read(size)):
                raise DamagedError(f"the checksum of block {place} does not fit its content")


def _refuse_damaged_part(part: VrtPart) -> None:
    """Compare the blocks of a source of a VRT, and name the source where one is damaged."""
    import rasterio

    column, row, columns, rows = part.window
    with rasterio.open(part.file, driver=RASTER_DRIVERS[part.file.suffix.lower()]) as source:
        if not 1 <= part.band <= source.count:
            raise DamagedError(f"its source {part.file.name} has no band {part.band}")
        width, height = min(columns, source.width - column), min(rows, source.height - row)
        try:
            refuse_damaged_blocks(source, part.file, part.band, (column, row, width, height))
        except DamagedError as error:
            raise DamagedError(f"its source {part.file.name}: {error}") from error


def _blocks(source: Any, band: int, window: Sequence[int]) -> Iterator[tuple[str, int, int]]:
    """Yield name, offset and size [bytes] of the blocks that the file holds; sparse ones are left out."""
    height, width = source.block_shapes[band - 1]
    column, row, columns, rows = window
    for i, j in product(
        range(row // height, -(-(row + rows) // height)),
        range(column // width, -(-(column + columns) // width)),
    ):
        offset = source.get_tag_item(f"BLOCK_OFFSET_{j}_{i}", "TIFF", bidx=band)
        size = source.get_tag_item(f"BLOCK_SIZE_{j}_{i}", "TIFF", bidx=band)
        if offset and size:
            yield f"{i}, {j}", int(offset), int(size)


def _is_sound(packed: bytes) -> bool:
    """Return whether a zlib stream ends with the checksum of its content; only a slice of it is in memory at a time."""
    unpacker = zlib.decompressobj()
    rest, went_on = packed, True
    try:
        while went_on and not unpacker.eof:
            # The last input may be taken in while there is still output to come.
            went_on = bool(unpacker.decompress(rest, _SLICE)) or bool(rest)
            rest = unpacker.unconsumed_tail
    except zlib.error:
        return False
    return unpacker.eof
