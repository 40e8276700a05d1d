"""Categorical rasters: bytes as Cloud-Optimized GeoTIFF, with the names of the categories beside them."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS

from survey.core.files.writing import replacing
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
