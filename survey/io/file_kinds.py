"""Allow-list of file formats: each suffix stands for one GDAL driver, and the content is checked before GDAL opens it.

GDAL recognises a file by its content, and many of its formats name other files or addresses. A file is opened
by the driver of its suffix; nothing that a data file names is opened but plain files beside it, and no address at all.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from survey.core.errors import InputError
from survey.io.ascii_grid import check_ascii_grid
from survey.io.companions import files_beside
from survey.io.document_checks import ROOTS, check_json, check_xml, small_text
from survey.io.kmz import kml_document
from survey.io.vrt import raster_sources

RASTER_DRIVERS: Mapping[str, str] = MappingProxyType(
    {
        ".asc": "AAIGrid",
        ".bil": "EHdr",
        ".dem": "USGSDEM",
        ".dt0": "DTED",
        ".dt1": "DTED",
        ".dt2": "DTED",
        ".flt": "EHdr",
        ".hgt": "SRTMHGT",
        ".nc": "netCDF",
        ".tif": "GTiff",
        ".tiff": "GTiff",
        ".vrt": "VRT",
    }
)
"""GDAL's driver for each suffix of a raster."""
VECTOR_SUFFIXES = (".fgb", ".geojson", ".gpkg", ".gpx", ".json", ".kml", ".kmz", ".shp")
"""Suffixes of vector files."""
OFFLINE: Mapping[str, str] = MappingProxyType(
    {
        # No address may be read as a file; whatever else asks for one meets a proxy that does not exist.
        "CPL_VSIL_CURL_ALLOWED_FILENAME": "none",
        "GDAL_HTTP_PROXY": "http://0.0.0.0:1",
        "GDAL_HTTP_MAX_RETRY": "0",
        "GDAL_VRT_ENABLE_PYTHON": "NO",
        "GDAL_VRT_ENABLE_RAWRASTERBAND": "NO",
    }
)
"""Configuration options of GDAL under which data files are read."""

_HEAD_BYTES = 65_536
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_SIGNATURES: Mapping[str, tuple[bytes, ...]] = {
    ".tif": _TIFF,
    ".tiff": _TIFF,
    ".msk": _TIFF,
    ".ovr": _TIFF,
    ".nc": (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF\r\n\x1a\n"),
    ".gpkg": (b"SQLite format 3\0",),
    ".fgb": (b"fgb\x03",),
    ".kmz": (b"PK\x03\x04", b"PK\x05\x06"),
    ".shp": (b"\x00\x00\x27\x0a",),
}
# By words like these GDAL takes a file for a format that reads other files, programs or addresses.
_FOREIGN = (
    b"<vrtdataset",
    b"<ogrvrt",
    b"<gdal_",
    b"<ogrwfs",
    b"<wms_",
    b"<wmt_",
    b"<capabilities",
    b"<gdalwms",
    b"<ogcapi",
    b"<metacrs",
    b"gdal_streamed_alg",
    b"stac_version",
    b"<gdaltileindexdataset",
)


def check_raster_file(file: Path, *, as_source: bool = False) -> None:
    """Refuse a raster whose content is not of the format of its suffix, or which leads to other places than its own files.

    Parameters
    ----------
    file : pathlib.Path
        An existing file. Sources of virtual rasters are checked by `as_source`, where only
        formats that GDAL cannot mistake for others pass.

    Raises
    ------
    InputError
        Another suffix, another content, or a companion that is not what it should be.
    """
    suffix = file.suffix.lower()
    if suffix not in RASTER_DRIVERS or (as_source and suffix == ".nc"):
        raise InputError(
            f"{file} ends in {file.suffix!r}; a raster ending in {', '.join(RASTER_DRIVERS)} was expected, "
            "convert it to GeoTIFF (gdal_translate)."
        )
    if suffix != ".vrt":
        _check_content(file)
    elif not as_source:
        _check_sources(file)
    if suffix == ".asc":
        check_ascii_grid(file)
    for other in files_beside(file, overviews=True):
        _check_companion(other)


def check_vector_file(file: Path, what: str) -> None:
    """Refuse a vector file whose content is not of the format of its suffix, or which names an address.

    Parameters
    ----------
    file : pathlib.Path
        An existing file.
    what : str
        What it is, for the message.

    Raises
    ------
    InputError
        Another suffix, another content, a linked CRS, a declaration of XML entities.
    """
    suffix = file.suffix.lower()
    if suffix not in VECTOR_SUFFIXES:
        raise InputError(
            f"{what} {file} ends in {file.suffix!r}; one of {', '.join(VECTOR_SUFFIXES)} was expected, "
            "convert it to GeoPackage (ogr2ogr)."
        )
    _check_content(file, what)
    if suffix in (".geojson", ".json"):
        check_json(file, what)
    elif suffix in ROOTS:
        content = kml_document(file, what) if suffix == ".kmz" else small_text(file, what)
        check_xml(content, ROOTS[suffix], f"{what} {file}")


def _check_content(file: Path, what: str = "the raster") -> None:
    """Refuse a file that begins otherwise than files of its suffix, or with the words of another format."""
    with file.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    signatures = _SIGNATURES.get(file.suffix.lower())
    if signatures is not None and not head.startswith(signatures):
        raise InputError(
            f"{what} {file} is damaged or no {what.removeprefix('the ')} of the kind {file.suffix.lower()} (it begins with {head[:16]!r}); get it again."
        )
    found = next((words for words in _FOREIGN if words in head.lower()), None)
    if found is not None:
        raise InputError(
            f"{what} {file} holds {found.decode()!r}, which belongs to a format that reads other files or addresses; "
            "download the data itself and name that file."
        )


def _check_sources(file: Path) -> None:
    for source in raster_sources(file):
        check_raster_file(source, as_source=True)


def _check_companion(file: Path) -> None:
    """Refuse a companion that GDAL would take for another format, or that names other files."""
    suffix = file.suffix.lower()
    if suffix in _SIGNATURES:
        _check_content(file)
        for other in files_beside(file, overviews=True):
            _check_companion(other)
    elif suffix == ".xml":
        content = small_text(file, "the file").lower()
        if b"overview_file" in content or b"/vsi" in content or b"<!" in content.replace(b"<!--", b""):
            raise InputError(
                f"{file} names other files or declares XML entities; delete it, or take that out of it."
            )
    elif suffix == ".prj":
        _check_content(file)
