"""Virtual rasters (VRT): the files that they are made of, checked before GDAL opens any of them."""

import os
from pathlib import Path
from xml.etree import ElementTree

from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line
from survey.core.files.reading import existing_file

LARGEST_VRT_BYTES = 32 * 2**20
"""Virtual rasters beyond this are not read: some 50,000 tiles, 0.3 GB while they are parsed."""
_DEEPEST = 8
# Elements of plain mosaics of files.  Warped, derived (pixel functions), raw, pansharpened and processed
# rasters name further files, programs or addresses; they are refused.
_PLAIN_ELEMENTS = frozenset(
    {
        "VRTDataset",
        "SRS",
        "GeoTransform",
        "Metadata",
        "MDI",
        "VRTRasterBand",
        "NoDataValue",
        "HideNoDataValue",
        "ColorInterp",
        "ColorTable",
        "Entry",
        "Description",
        "UnitType",
        "Offset",
        "Scale",
        "CategoryNames",
        "Category",
        "Histograms",
        "HistItem",
        "HistMin",
        "HistMax",
        "BucketCount",
        "IncludeOutOfRange",
        "Approximate",
        "HistCounts",
        "SimpleSource",
        "ComplexSource",
        "AveragedSource",
        "SourceFilename",
        "SourceBand",
        "SourceProperties",
        "SrcRect",
        "DstRect",
        "NODATA",
        "ScaleOffset",
        "ScaleRatio",
        "UseMaskBand",
        "MaskBand",
        "OverviewList",
        "BlockXSize",
        "BlockYSize",
        "LUT",
    }
)
_BAND_CLASSES = frozenset({"", "VRTSourcedRasterBand"})
# GDAL reads these attributes however they are capitalised.
_ATTRIBUTES = {name.lower(): name for name in ("subClass", "relativeToVRT", "key", "domain")}


def raster_sources(path: str | Path) -> list[Path]:
    """List the files that a virtual raster is made of, through virtual rasters among them.

    Parameters
    ----------
    path : str or pathlib.Path
        A ``.vrt`` file.  Nothing but this file and virtual rasters that it names is opened.

    Returns
    -------
    list of pathlib.Path
        Absolute paths in order of their names, virtual rasters among them included, `path` itself not.

    Raises
    ------
    InputError
        The file is damaged, is no plain mosaic, or names a source that is no local file.
    CapacityError
        It is too large to be parsed.
    """
    found: set[Path] = set()
    _collect(existing_file(path, "the virtual raster"), found, 0)
    return sorted(found)


def _collect(file: Path, found: set[Path], depth: int) -> None:
    if depth > _DEEPEST:
        raise InputError(
            f"{file} is a virtual raster of virtual rasters more than {_DEEPEST} levels deep; convert one of them to GeoTIFF (gdal_translate)."
        )
    for source in _named_sources(file):
        if source in found:
            continue
        found.add(source)
        if source.suffix.lower() == ".vrt":
            _collect(source, found, depth + 1)


def _named_sources(file: Path) -> list[Path]:
    """Return the sources that one virtual raster names."""
    root = _parsed(file)
    for element in root.iter():
        _refuse_other_element(element, file)
    return list(dict.fromkeys(_local_file(element, file) for element in root.iter("SourceFilename")))


def _parsed(file: Path) -> ElementTree.Element:
    n_bytes = file.stat().st_size
    if n_bytes > LARGEST_VRT_BYTES:
        raise CapacityError(
            f"{file} is a virtual raster of {n_bytes:,} bytes; {LARGEST_VRT_BYTES:,} can be read, make it of fewer tiles."
        )
    content = file.read_bytes()
    if b"<!" in content.replace(b"<!--", b"").replace(b"<![CDATA[", b""):
        raise InputError(f"{file} declares XML entities or a document type; remove them.")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(
            f"{file} is damaged or no virtual raster ({first_line(error)}); make it again (gdalbuildvrt)."
        ) from error
    if root.tag != "VRTDataset":
        raise InputError(f"{file} holds <{root.tag[:40]}>; a virtual raster begins with <VRTDataset>.")
    return root


def _refuse_other_element(element: ElementTree.Element, file: Path) -> None:
    for name in element.attrib:
        if _ATTRIBUTES.get(name.lower(), name) != name:
            raise InputError(f"{file} spells {_ATTRIBUTES[name.lower()]} as {name[:40]}; correct it.")
    kind = element.get("subClass", "")
    if element.tag not in _PLAIN_ELEMENTS or kind not in _BAND_CLASSES:
        raise InputError(
            f"{file} holds <{str(element.tag)[:40]}{f' subClass={kind[:40]!r}' if kind else ''}>, and only plain mosaics of files are read; convert it to GeoTIFF (gdal_translate)."
        )
    if (element.tag == "MDI" and (element.get("key") or "").upper() == "OVERVIEW_FILE") or (
        element.tag == "Metadata" and (element.get("domain") or "").upper() == "OVERVIEWS"
    ):
        raise InputError(f"{file} names a file of overviews; convert it to GeoTIFF (gdal_translate).")


def _local_file(element: ElementTree.Element, file: Path) -> Path:
    """Return the path that a source names; refuse what GDAL would not read as a plain local file."""
    name = element.text or ""
    stated = Path(name)
    if not name or name != name.strip() or name.startswith(("/vsi", "<", "{")) or ":" in name or "\0" in name:
        raise InputError(
            f"{file} names the source {name[:80]!r}, which is no local file; download it first and name the file."
        )
    path = file.parent / stated if element.get("relativeToVRT") == "1" else stated
    return Path(os.path.abspath(existing_file(path, f"the source that {file} names,")))  # noqa: PTH100  # links stay as they are
