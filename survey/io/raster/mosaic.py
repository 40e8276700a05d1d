"""Virtual rasters (VRT): mosaics of GeoTIFF tiles, with virtual overviews."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

from affine import Affine
from pyproj import CRS

from survey.core.files.writing import replacing
from survey.io.companions import stale_files
from survey.io.raster.crs_tag import crs_tag
from survey.io.raster.facts import VERTICAL_TAG


class MosaicTile(NamedTuple):
    """A raster of a mosaic: its file, first column and first row (from the north) in the mosaic, width and height."""

    file: Path
    column: int
    row: int
    width: int
    height: int


class MosaicBand(NamedTuple):
    """A band of a mosaic: name, data type as GDAL names it, and the number that stands for no data, if any."""

    name: str
    kind: str
    nodata: float | None


def write_mosaic(
    path: Path,
    tiles: Sequence[MosaicTile],
    bands: Sequence[MosaicBand],
    *,
    shape: tuple[int, int],
    transform: Affine,
    crs: CRS,
    vertical_datum: str = "",
) -> None:
    """Write a virtual raster that consists of rasters in its folder or below.

    Parameters
    ----------
    path : pathlib.Path
        The ``.vrt`` file.
    tiles : sequence of MosaicTile
        Rasters with these bands, which do not overlap.
    bands : sequence of MosaicBand
        Bands of every tile, in their order.
    shape : (2,) tuple of int
        Rows and columns of the mosaic.
    transform : affine.Affine
        Maps (column, row) of a cell's corner to easting and northing [m].
    crs : pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        Name of the surface that heights count from.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    rows, columns = shape
    root = ET.Element("VRTDataset", rasterXSize=str(columns), rasterYSize=str(rows))
    ET.SubElement(root, "SRS").text = crs.to_wkt("WKT1_GDAL")
    ET.SubElement(root, "GeoTransform").text = ", ".join(f"{v:.16e}" for v in transform.to_gdal())
    tags = {**crs_tag(crs), **({VERTICAL_TAG: vertical_datum} if vertical_datum else {})}
    metadata = ET.SubElement(root, "Metadata")
    for key, value in tags.items():
        ET.SubElement(metadata, "MDI", key=key).text = value
    for number, band in enumerate(bands, 1):
        _add_band(root, number, band, tiles, path.parent)
    ET.SubElement(
        root, "OverviewList", resampling="average" if bands[0].kind == "Float32" else "nearest"
    ).text = _overviews(max(shape))
    ET.indent(root)
    with replacing(path, stale=stale_files(path)) as draft:
        draft.write_bytes(ET.tostring(root, encoding="utf-8"))


def _overviews(side: int) -> str:
    """Return the factors of overviews down to some 512 cells a side."""
    factors = [2]
    while side / factors[-1] > 512:
        factors.append(2 * factors[-1])
    return " ".join(map(str, factors))


def _add_band(
    root: ET.Element, number: int, band: MosaicBand, tiles: Sequence[MosaicTile], folder: Path
) -> None:
    element = ET.SubElement(root, "VRTRasterBand", dataType=band.kind, band=str(number))
    ET.SubElement(element, "Description").text = band.name
    if band.nodata is not None:
        ET.SubElement(element, "NoDataValue").text = f"{band.nodata:g}"
    for tile in tiles:
        source = ET.SubElement(element, "SimpleSource")
        ET.SubElement(source, "SourceFilename", relativeToVRT="1").text = tile.file.relative_to(
            folder
        ).as_posix()
        ET.SubElement(source, "SourceBand").text = str(number)
        _add_rectangle(source, "SrcRect", (0, 0, tile.width, tile.height))
        _add_rectangle(source, "DstRect", (tile.column, tile.row, tile.width, tile.height))


def _add_rectangle(source: ET.Element, name: str, numbers: tuple[int, int, int, int]) -> None:
    element = ET.SubElement(source, name)
    for key, number in zip(("xOff", "yOff", "xSize", "ySize"), numbers, strict=True):
        element.set(key, str(number))
