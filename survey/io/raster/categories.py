"""Categorical rasters: bytes as Cloud-Optimized GeoTIFF, with the names of the categories beside them."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS

from survey.core.errors import CapacityError, InputError
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing
from survey.io.raster.opening import LARGEST_CELLS, opened_dataset
from survey.io.raster.writing import write_bytes_raster


def write_categories(
    path: str | Path,
    codes: npt.NDArray[np.uint8],
    categories: Sequence[str],
    *,
    transform: Affine,
    crs: CRS,
) -> None:
    """Write codes as bytes, and the names of the categories in ``.aux.xml`` beside, where GDAL and QGIS look for them.

    Parameters
    ----------
    path : str or pathlib.Path
        A GeoTIFF.
    codes : (H, W) ndarray of uint8
        Numbers of categories.
    categories : sequence of str
        Their names, counted from 0.
    transform : affine.Affine
        Maps (column, row) of a cell's corner to easting and northing [m].
    crs : pyproj.CRS
        Projected, in metres.

    Raises
    ------
    InputError
        When the raster is not north-up with square cells, or the file cannot be written.
    """
    file = Path(path)
    write_bytes_raster(file, file.stem, np.asarray(codes, dtype=np.uint8), transform, crs)
    root = ET.Element("PAMDataset")
    names = ET.SubElement(ET.SubElement(root, "PAMRasterBand", band="1"), "CategoryNames")
    for category in categories:
        ET.SubElement(names, "Category").text = category
    ET.indent(root)
    with replacing(file.with_name(f"{file.name}.aux.xml")) as draft:
        draft.write_bytes(ET.tostring(root, encoding="utf-8") + b"\n")


class Codes(NamedTuple):
    """Whole numbers of a categorical raster with its placement; `unknown` stands for no category."""

    values: npt.NDArray[np.int64]
    transform: Affine
    crs: CRS
    unknown: int | None


def read_codes(path: str | Path) -> Codes:
    """Read the codes of a categorical raster, such as land cover, in any CRS.

    Parameters
    ----------
    path : str or pathlib.Path
        Raster of whole numbers; its first band is read.

    Returns
    -------
    Codes
        Codes (H, W) with their placement.

    Raises
    ------
    InputError
        Missing, damaged, without a CRS, or with decimals.
    CapacityError
        More than `LARGEST_CELLS` cells.
    """
    file = existing_file(path, "the raster of classes")
    with opened_dataset(file, 1) as source:
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
