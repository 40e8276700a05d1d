"""Writing of rasters: Cloud-Optimized GeoTIFF, Esri ASCII grid, NetCDF, and categorical GeoTIFF.

Elevations are written as float32 with CRS, vertical datum and checksum, NetCDF by `survey.io.raster.netcdf`. Categories are
bytes with their names in ``.aux.xml`` beside the GeoTIFF, where GDAL and QGIS look for them; `read_codes` reads them.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS
from pyproj.crs import CompoundCRS

from survey.core import (
    UNSTATED,
    CapacityError,
    FloatArray,
    InputError,
    existing_file,
    projected_crs,
    replacing,
    write_bytes,
)
from survey.core.crs import VERTICAL_CRS
from survey.core.files import unwritable, warnings_logged
from survey.io.arrays_file import checksum
from survey.io.dataset_files import stale_files
from survey.io.raster.netcdf import band_attributes, write_netcdf
from survey.io.raster.opening import LARGEST_CELLS, check_transform, crs_tag, open_dataset, rasterio_errors
from survey.io.raster.reading import CRC_TAG, NODATA, VERTICAL_TAG, Raster, checksum_parts

COG_OPTIONS = {
    "driver": "COG",
    "compress": "deflate",
    "predictor": "yes",
    "overview_resampling": "average",
    "num_threads": "1",
}
"""How GDAL writes Cloud-Optimized GeoTIFFs."""
_METRES = ("elevation", "standard_deviation")
# Nine significant digits bring every float32 back exactly.
ASCII_OPTIONS = {"driver": "AAIGrid", "significant_digits": 9, "force_cellsize": "true"}
"""How GDAL writes Esri ASCII grids."""


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

    `bands`: bands by name [m], NaN for nodata. `transform`: maps (column, row) of a cell's corner to easting
    and northing [m].
    """
    check_transform(transform)
    suffix = Path(path).suffix.lower()
    if suffix == ".nc":
        variables = {name: (values, band_attributes(name, vertical_datum)) for name, values in bands.items()}
        write_netcdf(path, variables, transform, written_crs(crs, vertical_datum), vertical_datum)
        return
    if suffix == ".asc" and len(bands) != 1:
        raise InputError(f"{path}: an ASCII grid holds one band, not {len(bands)}; write them one by one.")
    options = ASCII_OPTIONS if suffix == ".asc" else COG_OPTIONS
    written = (
        projected_crs(crs, "the raster to write") if suffix == ".asc" else written_crs(crs, vertical_datum)
    )
    _write_gdal(
        Path(path), bands, {**options, "transform": transform, "crs": written.to_wkt()}, crs, vertical_datum
    )


def write_bytes_raster(
    path: Path, name: str, codes: npt.NDArray[np.uint8], transform: Affine, crs: CRS
) -> None:
    """Write one band of bytes as a Cloud-Optimized GeoTIFF without nodata.

    `codes` (H, W): values. `transform`: maps (column, row) of a cell's corner to easting and northing [m].
    """
    check_transform(transform)
    written = written_crs(crs, UNSTATED).to_wkt()
    options = {"dtype": "uint8", "nodata": None, "overview_resampling": "mode"}
    _write_gdal(
        path,
        {name: codes.astype(np.float64)},
        {**COG_OPTIONS, **options, "transform": transform, "crs": written},
        crs,
        UNSTATED,
    )


def _tags(
    bands: Mapping[str, FloatArray], transform: Affine, crs: CRS, vertical_datum: str
) -> dict[str, str]:
    """Return what a GeoTIFF says of itself: the CRS, the vertical datum and a checksum for each band."""
    crcs = " ".join(checksum(checksum_parts(values, transform, vertical_datum)) for values in bands.values())
    return {CRC_TAG: crcs, **crs_tag(crs), **({VERTICAL_TAG: vertical_datum} if vertical_datum else {})}


def _write_gdal(
    path: Path, bands: Mapping[str, FloatArray], options: Mapping[str, Any], crs: CRS, vertical_datum: str
) -> None:
    import rasterio

    height, width = next(iter(bands.values())).shape
    profile = {"height": height, "width": width, "count": len(bands), "dtype": "float32", "nodata": NODATA}
    profile |= options
    with replacing(path, stale=stale_files(path)) as draft:
        try:
            with warnings_logged(), rasterio.open(draft, "w", **profile) as target:
                if options["driver"] == "COG":
                    target.update_tags(**_tags(bands, options["transform"], crs, vertical_datum))
                for index, (name, values) in enumerate(bands.items(), start=1):
                    target.write(
                        np.where(np.isfinite(values), values, NODATA).astype(profile["dtype"]), index
                    )
                    if options["driver"] == "COG":
                        target.set_band_description(index, name)
                        if "elevation" in bands and name in _METRES:
                            target.set_band_unit(index, "m")
        except rasterio_errors() as error:
            raise unwritable(path, error) from error
        if not draft.is_file() or draft.stat().st_size == 0:
            raise unwritable(path, "nothing arrived on the disk")


def reproject(raster: Raster, crs: CRS, step_m: float) -> Raster:
    """Resample a raster (in degrees, say) to square cells of a projected CRS, bilinearly.

    The error of the resampling comes on top of the raster's own: use it for priors.

    `step_m`: side of its cells [m]. Returns: North-up, NaN where the raster does not reach.
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


def written_crs(crs: CRS, vertical_datum: str) -> CRS:
    """Return the CRS that a file states: with its vertical part where the datum has a code."""
    horizontal = projected_crs(crs, "the raster to write")
    # GDAL writes the vertical part of a CRS only when it has a code of its own.
    code = VERTICAL_CRS.get(vertical_datum)
    if code is None:
        return horizontal
    return CompoundCRS(f"{horizontal.name} + {vertical_datum}", [horizontal, CRS.from_user_input(code)])


def write_categories(
    path: str | Path, codes: npt.NDArray[np.uint8], categories: Sequence[str], *, transform: Affine, crs: CRS
) -> None:
    """Write codes as bytes, and the names of the categories in ``.aux.xml`` beside, where GDAL and QGIS look for them.

    `codes` (H, W): numbers of categories. `transform`: maps (column, row) of a cell's corner to easting and
    northing [m].
    """
    file = Path(path)
    write_bytes_raster(file, file.stem, np.asarray(codes, dtype=np.uint8), transform, crs)
    root = ET.Element("PAMDataset")
    names = ET.SubElement(ET.SubElement(root, "PAMRasterBand", band="1"), "CategoryNames")
    for category in categories:
        ET.SubElement(names, "Category").text = category
    ET.indent(root)
    write_bytes(file.with_name(f"{file.name}.aux.xml"), ET.tostring(root, encoding="utf-8") + b"\n")


class Codes(NamedTuple):
    """Whole numbers of a categorical raster with its placement; `unknown` stands for no category."""

    values: npt.NDArray[np.int64]
    transform: Affine
    crs: CRS
    unknown: int | None


def read_codes(path: str | Path) -> Codes:
    """Read the codes of a categorical raster, such as land cover, in any CRS."""
    file = existing_file(path, "the raster of classes")
    with open_dataset(file, 1) as source:
        if source.width * source.height > LARGEST_CELLS:
            raise CapacityError(
                f"{file} has {source.width * source.height:,} cells; {LARGEST_CELLS:,} can be read at once, cut it to the area."
            )
        if not np.issubdtype(np.dtype(source.dtypes[0]), np.integer):
            raise InputError(
                f"{file} holds numbers with decimals; a raster of classes holds whole numbers, write it as integers."
            )
        if source.crs is None:
            raise InputError(f"{file} carries no coordinate reference system; write it with one.")
        unknown = None if source.nodata is None else int(source.nodata)
        values = source.read(1).astype(np.int64)
        return Codes(values, source.transform, CRS.from_wkt(source.crs.to_wkt()), unknown)
