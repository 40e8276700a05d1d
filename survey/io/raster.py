"""Elevation rasters: whatever GDAL reads; written as Cloud-Optimized GeoTIFF, Esri ASCII grid or NetCDF."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from affine import Affine
from pyproj import CRS
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError

from survey.core.arrays import FloatArray
from survey.core.checksum import checksum, refuse_altered
from survey.core.errors import CapacityError, InputError
from survey.core.files import DamagedError, existing_file, first_line, replacing, unwritable, warnings_logged
from survey.core.geodesy import UNSTATED, VERTICAL_CRS, projected_crs, vertical_datum_of
from survey.io.hdf5 import refuse_endless

NODATA = -9999.0
LARGEST_CELLS = 160_000_000
"""Rasters beyond this are not read whole: 1.3 GB as numbers of double precision."""
_STRIP_CELLS = 4_000_000
_LARGEST_BLOCK_BYTES = 2**29
# GDAL keeps blocks that it has read in up to a twentieth of the machine's memory unless told otherwise.
_CACHE_BYTES = 64 * 2**20
_VERTICAL_TAG = "VERTICAL_DATUM"
_CRC_TAG = "FIRNLINE_CRC32"

_COG = {
    "driver": "COG",
    "compress": "deflate",
    "predictor": "yes",
    "overview_resampling": "average",
    "num_threads": "1",
}
# Nine significant digits bring every float32 back exactly.
_ASCII = {"driver": "AAIGrid", "significant_digits": 9, "force_cellsize": "true"}


class Raster(NamedTuple):
    """One band of a file: values with NaN for nodata, the transform, the CRS, the vertical datum."""

    values: FloatArray
    transform: Affine
    crs: Any
    vertical_datum: str


def read_raster(path: str | Path, *, band: int = 1) -> Raster:
    """Read one band with its georeference; nodata becomes NaN.

    Raises
    ------
    InputError
        The file is missing, empty, damaged, of another kind, or has no such band.

    Notes
    -----
    NetCDF files are read twice, first by a process that may be stopped: see `survey.io.hdf5`.
    """
    import rasterio  # GDAL is loaded when first needed: maps from arrays do without its 20 MB

    file = existing_file(path, "the raster")
    if file.suffix.lower() == ".nc":
        refuse_endless(file)
    try:
        with warnings_logged(), rasterio.open(_dataset(file, band)) as source:
            in_source = _checked_band(source, file, band)
            if source.height * source.width > LARGEST_CELLS:
                raise CapacityError(
                    f"{file} has {source.height:,} × {source.width:,} cells; {LARGEST_CELLS:,} can be read at once, cut a window or average it first."
                )
            values = _read_strips(source, in_source)
            crs = source.crs.to_wkt() if source.crs else None
            datum = stated_datum(source)
            transform = source.transform
            crcs = source.tags().get(_CRC_TAG, "").split()
        if len(crcs) >= band:
            refuse_altered(file, crcs[band - 1], _summed(values, transform, datum), f"the tag {_CRC_TAG}")
        return Raster(values, transform, crs, datum or (vertical_datum_of(crs) if crs else UNSTATED))
    except _gdal_faults() as error:
        raise damaged(file, error) from error


@contextmanager
def opened_raster(file: Path) -> Iterator[Any]:
    """Open a raster for reading in windows; what GDAL then finds damaged is refused in a sentence.

    Raises
    ------
    InputError
        The file is damaged, of another kind, or holds complex numbers.
    """
    import rasterio

    if file.suffix.lower() == ".nc":
        refuse_endless(file)
    try:
        with (
            warnings_logged(),
            rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES),
            rasterio.open(_dataset(file, 1)) as source,
        ):
            _checked_band(source, file, 1)
            yield source
    except _gdal_faults() as error:
        raise damaged(file, error) from error


def damaged(file: Path, error: Exception) -> InputError:
    """Return the refusal of a raster that GDAL cannot read."""
    return InputError(f"{file} is damaged or no raster that GDAL knows ({first_line(error)}); get it again.")


def _dataset(file: Path, band: int) -> str:
    """Return what GDAL is to open: of a NetCDF file with several variables, the one that stands for the band."""
    if file.suffix.lower() != ".nc":
        return str(file)
    import rasterio

    with rasterio.open(file) as whole:
        parts: list[str] = whole.subdatasets
    if not parts:
        return str(file)
    if not 1 <= band <= len(parts):
        raise InputError(f"{file} has {len(parts)} variables; number {band} was asked for.")
    return parts[band - 1]


def _checked_band(source: Any, file: Path, band: int) -> int:
    """Return the number of the band within what was opened, or refuse."""
    number = 1 if source.driver == "netCDF" and source.count == 1 else band
    if not 1 <= number <= source.count:
        raise InputError(f"{file} has {source.count} bands; band {band} was asked for.")
    if np.issubdtype(np.dtype(source.dtypes[number - 1]), np.complexfloating):
        raise InputError(f"{file} holds complex numbers; elevations in metres were expected.")
    bands = source.count if str(source.interleaving).lower().endswith("pixel") else 1
    block_bytes = (
        math.prod(source.block_shapes[number - 1]) * np.dtype(source.dtypes[number - 1]).itemsize * bands
    )
    if block_bytes > _LARGEST_BLOCK_BYTES:
        raise CapacityError(
            f"{file} keeps its cells in blocks of {block_bytes / 1e9:.1f} GB ({source.count} bands); it is damaged, or to be rewritten in tiles (gdal_translate -co TILED=YES)."
        )
    return number


def _read_strips(source: Any, band: int) -> FloatArray:
    """Read a band strip by strip, so that memory follows what the file holds and not what its header claims."""
    from rasterio.windows import Window

    values = np.empty((source.height, source.width))
    rows = max(1, _STRIP_CELLS // source.width)
    for first in range(0, source.height, rows):
        window = Window(0, first, source.width, min(rows, source.height - first))
        values[first : first + rows] = read_window(source, band, window)
    return values


def _summed(values: FloatArray, transform: Affine, vertical_datum: str) -> tuple[Any, ...]:
    """Return what a band's checksum is taken of: the numbers as they are stored, their place and datum."""
    stored = np.where(np.isfinite(values), values, NODATA).astype("<f4")
    return (
        stored,
        np.array(values.shape, dtype="<i8"),
        np.array(transform.to_gdal(), dtype="<f8"),
        vertical_datum,
    )


def read_window(source: Any, band: int, window: Any) -> FloatArray:
    """Read a window of an open raster as (h, w) floats with NaN for nodata."""
    strip = source.read(band, window=window, masked=True, out_dtype=np.float64)
    values: FloatArray = strip.filled(np.nan)
    values[~np.isfinite(values)] = np.nan
    return values


def stated_datum(source: Any) -> str:
    """Return the vertical datum that an open raster's tags name, or ``""``."""
    tags = source.tags()
    return str(tags.get(_VERTICAL_TAG) or tags.get(f"NC_GLOBAL#{_VERTICAL_TAG.lower()}") or UNSTATED)


class RasterFacts(NamedTuple):
    """Rows and columns of a raster, and its CRS where it names one."""

    shape: tuple[int, int]
    crs: Any


def raster_facts(path: str | Path) -> RasterFacts:
    """Return what a raster's header says, without reading its cells.

    Raises
    ------
    InputError
        The file is missing, empty or damaged.
    """
    with opened_raster(existing_file(path, "the raster")) as source:
        crs = source.crs.to_wkt() if source.crs else None
        return RasterFacts((int(source.height), int(source.width)), crs)


def band_count(path: str | Path) -> int:
    """Return the number of bands of a raster that `read_raster` has read."""
    import rasterio

    with rasterio.open(path) as source:
        return int(source.count) or len(source.subdatasets)


def band_names(path: str | Path) -> list[str]:
    """Return the names of the bands of a raster that `read_raster` has read; numbered where it gives none."""
    import rasterio

    with rasterio.open(path) as source:
        if source.subdatasets:
            return [part.rsplit(":", 1)[1] for part in source.subdatasets]
        described = [d or "" for d in source.descriptions]
    if len(described) == 1 and not described[0]:
        return ["elevation"]
    return [name or f"band_{k}" for k, name in enumerate(described, start=1)]


def write_raster(
    path: str | Path,
    bands: Mapping[str, FloatArray],
    transform: Affine,
    crs: CRS,
    vertical_datum: str = UNSTATED,
) -> None:
    """Write named bands of float32 in the format that the file's ending names, or leave what was there.

    ``.asc`` is an Esri ASCII grid of one band with its CRS in a ``.prj`` beside it, which states no
    vertical datum; ``.nc`` is NetCDF; everything else is a Cloud-Optimized GeoTIFF.

    Raises
    ------
    InputError
        When the file cannot be written, several bands are to go to an ASCII grid, or what
        NetCDF needs is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".nc":
        from survey.io.netcdf import write_netcdf

        write_netcdf(path, bands, transform, _written_crs(crs, vertical_datum), vertical_datum)
        return
    if suffix == ".asc" and len(bands) != 1:
        raise InputError(f"{path}: an ASCII grid holds one band, not {len(bands)}; write them one by one.")
    options = _ASCII if suffix == ".asc" else _COG
    written = (
        projected_crs(crs, "the raster to write") if suffix == ".asc" else _written_crs(crs, vertical_datum)
    )
    _write_gdal(
        Path(path), bands, {**options, "transform": transform, "crs": written.to_wkt()}, vertical_datum
    )


def _tags(bands: Mapping[str, FloatArray], transform: Affine, vertical_datum: str) -> dict[str, str]:
    """Return what a GeoTIFF says of itself: the vertical datum and a checksum for each band."""
    crcs = " ".join(checksum(_summed(values, transform, vertical_datum)) for values in bands.values())
    return {_CRC_TAG: crcs, **({_VERTICAL_TAG: vertical_datum} if vertical_datum else {})}


def _write_gdal(
    path: Path, bands: Mapping[str, FloatArray], options: Mapping[str, Any], vertical_datum: str
) -> None:
    import rasterio

    height, width = next(iter(bands.values())).shape
    profile = {"height": height, "width": width, "count": len(bands), "dtype": "float32", "nodata": NODATA}
    with replacing(path) as draft:
        try:
            with warnings_logged(), rasterio.open(draft, "w", **profile, **options) as target:
                if options["driver"] == "COG":
                    target.update_tags(**_tags(bands, options["transform"], vertical_datum))
                for index, (name, values) in enumerate(bands.items(), start=1):
                    target.write(np.where(np.isfinite(values), values, NODATA).astype(np.float32), index)
                    if options["driver"] == "COG":
                        target.set_band_description(index, name)
        except _gdal_faults() as error:
            raise unwritable(path, error) from error
        if not draft.is_file() or draft.stat().st_size == 0:
            raise unwritable(path, "nothing arrived on the disk")


def reprojected(raster: Raster, crs: CRS, step_m: float) -> Raster:
    """Resample a raster (in degrees, say) to square cells of a projected CRS, bilinearly.

    The error of the resampling comes on top of the raster's own: use it for priors.
    """
    from rasterio.transform import array_bounds
    from rasterio.warp import Resampling, calculate_default_transform, reproject

    rows, columns = raster.values.shape
    bounds = array_bounds(rows, columns, raster.transform)
    transform, width, height = calculate_default_transform(
        raster.crs, crs.to_wkt(), columns, rows, *bounds, resolution=step_m
    )
    values = np.full((height, width), np.nan)
    reproject(
        raster.values,
        values,
        src_transform=raster.transform,
        src_crs=raster.crs,
        dst_transform=transform,
        dst_crs=crs.to_wkt(),
        src_nodata=np.nan,
        dst_nodata=np.nan,
        resampling=Resampling.bilinear,
        num_threads=1,
    )
    return Raster(values, transform, crs, raster.vertical_datum)


def _written_crs(crs: CRS, vertical_datum: str) -> CRS:
    horizontal = projected_crs(crs, "the raster to write")
    # GDAL keeps the vertical part of a CRS only when it has a code of its own.
    code = VERTICAL_CRS.get(vertical_datum)
    if code is None:
        return horizontal
    return CompoundCRS(f"{horizontal.name} + {vertical_datum}", [horizontal, CRS.from_user_input(code)])


def _gdal_faults() -> tuple[type[Exception], ...]:
    """Return what reading and writing through GDAL may raise; what GDAL itself reports has no public home."""
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError

    # Texts of a damaged header may not be UTF-8, and its claims may exceed the memory.
    return RasterioError, CPLE_BaseError, DamagedError, UnicodeDecodeError, MemoryError, CRSError
