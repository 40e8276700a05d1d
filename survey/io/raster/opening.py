"""Opening of rasters by the driver of their suffix, and checks of a band before its cells are read."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from pyproj.exceptions import CRSError

from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import DamagedError, first_line, warnings_logged
from survey.io.file_kinds import OFFLINE, RASTER_DRIVERS, check_raster_file
from survey.io.raster.crs_tag import refuse_altered_crs
from survey.io.raster.hdf5 import refuse_unreadable
from survey.io.raster.values import band_scale, refuse_depths, refuse_picture

LARGEST_CELLS = 40_000_000
"""Largest raster or window that is read at once: 0.32 GB as float64, some 2.2 GB while a survey is planned on it."""
_LARGEST_BLOCK_BYTES = 2**29
# GDAL holds blocks that it has read in up to a twentieth of the machine's memory by default.
_CACHE_BYTES = 64 * 2**20


@contextmanager
def opened_dataset(file: Path, band: int) -> Iterator[Any]:
    """Open a raster by the driver of its suffix, after its content has been checked."""
    import rasterio  # GDAL is loaded when first needed: maps from arrays do without its 20 MB

    with _checked(file), rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES, **OFFLINE), _dataset(file, band) as source:
        if source.tags(ns="OVERVIEWS"):
            raise InputError(f"{file} names a file of overviews; write it again (gdal_translate).")
        refuse_altered_crs(source, file)
        yield source


@contextmanager
def opened_list_of_bands(file: Path) -> Iterator[Any]:
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
    try:
        with warnings_logged():
            yield
    except gdal_faults() as error:
        raise damaged(file, error) from error


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


def checked_band(source: Any, file: Path, band: int) -> int:
    """Return the number of the band within what was opened, or refuse."""
    number = 1 if source.driver == "netCDF" and source.count == 1 else band
    if not 1 <= number <= source.count:
        raise InputError(f"{file} has {source.count} bands; band {band} was asked for.")
    if np.issubdtype(np.dtype(source.dtypes[number - 1]), np.complexfloating):
        raise InputError(f"{file} holds complex numbers; elevations in metres were expected.")
    refuse_picture(source, number)
    band_scale(source, number)
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


def damaged(file: Path, error: Exception) -> InputError:
    """Return the refusal of a raster that GDAL cannot read.

    Parameters
    ----------
    file : pathlib.Path
        The raster.
    error : Exception
        What GDAL raised.

    Returns
    -------
    InputError
        Names the file and the reason.
    """
    if isinstance(error, MemoryError):
        return CapacityError(
            f"{file} does not fit the memory ({first_line(error)}); cut a window (gdal_translate -projwin) first."
        )
    return InputError(
        f"{file} is damaged or no raster of the format of its suffix ({first_line(error)}); get it again."
    )


def gdal_faults() -> tuple[type[Exception], ...]:
    """Return what reading and writing through GDAL may raise; what GDAL itself reports has no public home."""
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError

    # Texts of a damaged header, or the file's own name, may not be UTF-8, and its claims may exceed the memory.
    return RasterioError, CPLE_BaseError, DamagedError, UnicodeError, MemoryError, CRSError
