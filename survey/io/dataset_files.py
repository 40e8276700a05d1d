"""Files that form one dataset with a data file: sources of virtual rasters, and files beside it.

The list corresponds to GDAL's ``GetFileList``. A virtual raster (VRT) names the rasters that it is made of; plain mosaics
are read, and every source is checked before GDAL opens any of them. Warped, derived and raw bands, which name programs or
addresses, are refused. Files beside a data file hold its georeference, masks, attributes or SQLite journal.
"""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from survey.core.errors import CapacityError, InputError
from survey.core.files import DamagedError, existing_file, first_line

LARGEST_VRT_BYTES = 32 * 2**20
"""Virtual rasters beyond this are not read: some 50,000 tiles, 0.3 GB while they are parsed."""
_DEEPEST = 8
# Elements of plain mosaics of files.  Warped, derived (pixel functions), raw, pansharpened and processed
# rasters name further files, programs or addresses; they are refused.
_PLAIN_ELEMENTS = frozenset(
    {
        "VRTDataset", "SRS", "GeoTransform", "Metadata", "MDI", "VRTRasterBand", "NoDataValue",
        "HideNoDataValue", "ColorInterp", "ColorTable", "Entry", "Description", "UnitType", "Offset",
        "Scale", "CategoryNames", "Category", "Histograms", "HistItem", "HistMin", "HistMax",
        "BucketCount", "IncludeOutOfRange", "Approximate", "HistCounts", "SimpleSource", "ComplexSource",
        "AveragedSource", "SourceFilename", "SourceBand", "SourceProperties", "SrcRect", "DstRect",
        "NODATA", "ScaleOffset", "ScaleRatio", "UseMaskBand", "MaskBand", "OverviewList", "BlockXSize",
        "BlockYSize", "LUT",
    }
)  # fmt: skip
_BAND_CLASSES = frozenset({"", "VRTSourcedRasterBand"})
_UNLIMITED = (2**31, 2**31)
# GDAL reads these attributes however they are capitalised.
_ATTRIBUTES = {name.lower(): name for name in ("subClass", "relativeToVRT", "key", "domain")}


def raster_sources(path: str | Path) -> list[Path]:
    """List the files that a virtual raster is made of, through virtual rasters among them."""
    found: set[Path] = set()
    _collect((existing_file(path, "the virtual raster"),), found)
    return sorted(found)


class VrtPart(NamedTuple):
    """Part of a source that a window of a virtual raster is made of.

    `file`: the source. `band`: counted from 1. `window` (4,) int: first column, first row, width and height
    of the source's cells; may reach a cell beyond them.
    """

    file: Path
    band: int
    window: tuple[int, int, int, int]


def raster_parts(path: Path, band: int, window: Sequence[int]) -> list[VrtPart]:
    """List the parts of the sources that a window of a virtual raster is made of.

    `window`: first column, first row, width and height [cells].
    """
    bands = _parsed(path).findall("VRTRasterBand")
    sources = [element for element in bands[band - 1] if element.find("SourceFilename") is not None]
    parts = [_part(element, path, window) for element in sources]
    return [part for part in parts if min(part.window[2:]) > 0]


def _part(source: ElementTree.Element, file: Path, window: Sequence[int]) -> VrtPart:
    """Return the part of a source under a window; a source without rectangles is all of its file."""
    name = source.find("SourceFilename")
    assert name is not None
    band = int(_number((source.findtext("SourceBand") or "1").rpartition(",")[2]))
    taken, placed = _rectangle(source.find("SrcRect")), _rectangle(source.find("DstRect"))
    if taken is None or placed is None:
        return VrtPart(_local_file(name, file), band, (0, 0, *_UNLIMITED))
    columns, rows = (
        _source_span(window[k], window[k + 2], (placed[k], placed[k + 2]), (taken[k], taken[k + 2]))
        for k in (0, 1)
    )
    return VrtPart(_local_file(name, file), band, (columns[0], rows[0], columns[1], rows[1]))


def _rectangle(element: ElementTree.Element | None) -> tuple[float, ...] | None:
    """Return first column, first row, width and height; None where they are not stated."""
    if element is None:
        return None
    stated = {name.lower(): value for name, value in element.attrib.items()}
    return tuple(_number(stated.get(name, "0")) for name in ("xoff", "yoff", "xsize", "ysize"))


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DamagedError(f"it states {text[:40]!r} where a number was expected")
    return value


def _source_span(
    first: int, n: int, placed: tuple[float, float], taken: tuple[float, float]
) -> tuple[int, int]:
    """Return first cell and number of cells of a source under cells of the virtual raster, one more to each side."""
    low, high = max(first, placed[0]), min(first + n, placed[0] + placed[1])
    if not (low < high and placed[1] > 0.0):
        return 0, 0
    ratio = taken[1] / placed[1]
    begin = max(math.floor(taken[0] + (low - placed[0]) * ratio) - 1, 0)
    return begin, math.ceil(taken[0] + (high - placed[0]) * ratio) + 1 - begin


def _collect(chain: tuple[Path, ...], found: set[Path]) -> None:
    """Collect the sources of the last of some virtual rasters, each of which is a source of the one before."""
    file = chain[-1]
    if len(chain) > _DEEPEST + 1:
        raise InputError(
            f"{file} is a virtual raster of virtual rasters more than {_DEEPEST} levels deep; convert one of them to GeoTIFF (gdal_translate)."
        )
    for source in _named_sources(file):
        if any(source.samefile(one) for one in chain):
            raise InputError(
                f"{file} names {source.name} as a source, which is made of {file.name} itself; make it again of rasters (gdalbuildvrt)."
            )
        if source in found:
            continue
        found.add(source)
        if source.suffix.lower() == ".vrt":
            _collect((*chain, source), found)


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


# What stands beside a raster, by the whole name or by the name without its suffix.
_RASTER_BY_NAME = (".aux.xml", ".msk", ".aux", ".prj")
_RASTER_BY_STEM = (".aux.xml", ".aux", ".prj", ".wld", ".tab", ".hdr", ".clr", ".stx")
_VECTOR_BY_STEM = {".shp": (".shx", ".dbf", ".prj", ".cpg", ".cst")}
# SQLite writes changes that are not yet in the main file beside it.
_VECTOR_BY_NAME = {".gpkg": ("-wal", "-journal")}
_STALE_BY_NAME = (".aux.xml", ".msk", ".ovr", "-wal", "-journal", "-shm")
_STALE_BY_STEM = {".shp": (".shx", ".dbf", ".prj", ".cpg", ".cst", ".qix", ".sbn", ".sbx"), ".asc": (".prj",)}
_ALONE = frozenset(
    (".csv", ".geojson", ".gpx", ".json", ".kml", ".las", ".laz", ".npz", ".ply", ".toml", ".txt", ".tum")
)


def companion_files(path: str | Path) -> list[Path]:
    """List every other file whose bytes decide what is read from a data file.

    Returns: existing files, without `path` itself, in a fixed order: what stands beside it (``.prj``,
    ``.aux.xml``, world files, masks, ``.dbf``, ``.shx``, SQLite's journals, …) and, for a ``.vrt``, its
    sources with what stands beside these. Overviews are left out where they are not read, which is but for
    sources of a ``.vrt``.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("dem.asc", "dem.prj", "dem.asc.aux.xml", "dem_2.prj"):
    ...     _ = (folder / name).write_text("x")
    >>> [file.name for file in companion_files(folder / "dem.asc")]
    ['dem.asc.aux.xml', 'dem.prj']
    """
    file = existing_file(path, "the file")
    found = dict.fromkeys(files_beside(file))
    if file.suffix.lower() == ".vrt":
        for source in raster_sources(file):
            # A mosaic that changes the resolution reads the overviews of its sources.
            found.update(dict.fromkeys((source, *files_beside(source, overviews=True))))
    found.pop(file, None)
    return list(found)


def files_beside(file: Path, *, overviews: bool = False) -> list[Path]:
    """List the files of one data set with `file`: those in its folder whose names follow from its own."""
    names = _companion_names(file)
    if names and overviews:
        names |= {f"{file.name.lower()}.ovr"}
    if not names:
        return []
    return sorted(other for other in file.parent.iterdir() if other.name.lower() in names and other.is_file())


def stale_files(path: str | Path) -> list[Path]:
    """List the files that belong to the file at `path` alone, and are wrong once it is replaced."""
    file = Path(path)
    name, stem, suffix = file.name.lower(), file.stem.lower(), file.suffix.lower()
    names = {name + ending for ending in _STALE_BY_NAME}
    names |= {stem + ending for ending in _STALE_BY_STEM.get(suffix, ())}
    if not file.parent.is_dir():
        return []
    return sorted(other for other in file.parent.iterdir() if other.name.lower() in names and other.is_file())


def _companion_names(file: Path) -> frozenset[str]:
    """Return the names, in lower case, of all files that may stand beside a data file."""
    name, stem, suffix = file.name.lower(), file.stem.lower(), file.suffix.lower()
    if suffix in _ALONE:
        return frozenset()
    if suffix in _VECTOR_BY_STEM:
        return frozenset(stem + ending for ending in _VECTOR_BY_STEM[suffix])
    if suffix in _VECTOR_BY_NAME:
        return frozenset(name + ending for ending in _VECTOR_BY_NAME[suffix])
    names = {name + ending for ending in _RASTER_BY_NAME} | {stem + ending for ending in _RASTER_BY_STEM}
    return frozenset((names | _world_files(stem, suffix)) - {name})


def _world_files(stem: str, suffix: str) -> set[str]:
    """Return the names of world files: ``a.tfw``, ``a.tifw``."""
    letters = suffix.removeprefix(".")
    return {f"{stem}.{letters[0]}{letters[-1]}w", f"{stem}.{letters}w"} if letters else set()
