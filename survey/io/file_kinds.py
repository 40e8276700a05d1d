"""Allow-list of file formats: each suffix stands for one GDAL driver, and the content is checked before GDAL opens it.

GDAL recognises a file by its content, and many of its formats name other files or addresses. A file is opened by the
driver of its suffix; nothing that a data file names is opened but plain files beside it, and no address at all.
JSON and XML are checked for size, CRS, entities and what GDAL would leave out of them; KMZ is unpacked; every number of an Esri
ASCII grid is checked, because GDAL reads letters and missing numbers as 0.
"""

import json
import math
import re
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, NamedTuple
from xml.parsers import expat

import numpy as np

from survey.core import CapacityError, FloatArray, InputError, first_line, printable
from survey.core.crs import known_crs
from survey.io.dataset_files import files_beside, raster_sources

RASTER_DRIVERS: Mapping[str, str] = MappingProxyType(
    {
        ".asc": "AAIGrid", ".bil": "EHdr", ".dem": "USGSDEM", ".dt0": "DTED", ".dt1": "DTED",
        ".dt2": "DTED", ".flt": "EHdr", ".hgt": "SRTMHGT", ".nc": "netCDF", ".tif": "GTiff",
        ".tiff": "GTiff", ".vrt": "VRT",
    }
)  # fmt: skip
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
    b"<vrtdataset", b"<ogrvrt", b"<gdal_", b"<ogrwfs", b"<wms_", b"<wmt_", b"<capabilities", b"<gdalwms",
    b"<ogcapi", b"<metacrs", b"gdal_streamed_alg", b"stac_version", b"<gdaltileindexdataset",
)  # fmt: skip


def check_raster_file(file: Path, *, as_source: bool = False) -> None:
    """Refuse a raster whose content is not of the format of its suffix, or which leads to other places than its own files."""
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


def check_vector_file(file: Path, what: str) -> int:
    """Refuse a vector file whose content is not of the format of its suffix, or which names an address.

    Returns the number of features that GeoJSON holds; 0 for other formats.
    """
    suffix = file.suffix.lower()
    if suffix not in VECTOR_SUFFIXES:
        raise InputError(
            f"{what} {file} ends in {file.suffix!r}; one of {', '.join(VECTOR_SUFFIXES)} was expected, "
            "convert it to GeoPackage (ogr2ogr)."
        )
    _check_content(file, what)
    if suffix in (".geojson", ".json"):
        return check_json(file, what)
    if suffix == ".gpx":
        check_xml(small_text(file, what), "gpx", f"{what} {file}")
    return 0


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


LARGEST_TEXT_BYTES = 256 * 2**20
"""JSON and XML files beyond this are not read: while they are parsed they take some ten times their size."""
_CRS_MEMBERS = frozenset({"type", "properties", "name", "href", "url", "link"})


def small_text(file: Path, what: str) -> bytes:
    """Read a JSON or XML file, or refuse one that is too large to be parsed."""
    n_bytes = file.stat().st_size
    if n_bytes > LARGEST_TEXT_BYTES:
        raise CapacityError(
            f"{what} {file} has {n_bytes:,} bytes; {LARGEST_TEXT_BYTES:,} can be read as text, save it as GeoPackage."
        )
    return file.read_bytes()


def check_json(file: Path, what: str) -> int:
    """Refuse GeoJSON with a CRS that is a link, which GDAL would follow, or an unknown name, which it would ignore.

    A key that an object has twice is refused too: GDAL takes one of its values. Returns the number of features.
    """
    content = small_text(file, what)
    if b"gdal_streamed_alg" in content:
        raise InputError(
            f"{what} {file} holds a GDAL pipeline; run it first and name the file that it writes."
        )
    where = f"{what} {file}"
    try:
        inner, outer, n_features = _crs_members(content, where)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where} is damaged or no JSON ({first_line(error)}); get it again.") from error
    # A property of a feature may be called crs as well: there only what GDAL could follow is looked at.
    for crs in [*(crs for crs in inner if isinstance(crs, dict)), *outer]:
        if crs is not None:
            _check_named_crs(crs, where)
    return n_features


def _crs_members(content: bytes, where: str) -> tuple[list[Any], list[Any], int]:
    """Return all values of keys ``crs`` in a JSON text, of inner objects and of the outermost one, and the number of features."""
    found: list[list[Any]] = []
    n_features = 0

    def collect(members: list[tuple[str, Any]]) -> Any:
        nonlocal n_features
        values = dict(members)
        if len(values) < len(members):
            keys = [key for key, _ in members]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise InputError(
                f"{where} gives the key {printable(twice)!r} twice in one object; delete the one that is not meant."
            )
        n_features += values.get("type") == "Feature" and "geometry" in values
        found.append([values["crs"]] if "crs" in values else [])
        # Members of a CRS are needed, all others are skipped.
        return values if values.keys() <= _CRS_MEMBERS else None

    text = content.decode("utf-8-sig", "replace").strip()
    while text:  # a sequence of features has one object after the other
        _, end = json.JSONDecoder(object_pairs_hook=collect).raw_decode(text)
        text = text[end:].strip()
    return [crs for values in found[:-1] for crs in values], found[-1] if found else [], n_features


def _check_named_crs(crs: Any, where: str) -> None:
    """Refuse a GeoJSON ``crs`` member that is not the name of a CRS that PROJ knows."""
    match crs:
        case {"type": "name", "properties": {"name": str(name)}}:
            _check_crs_name(name, where)
        case _:
            raise InputError(
                f"{where} has a linked or malformed 'crs' member, and links are not followed; name an EPSG code in it, or save the file as GeoPackage."
            )


def _check_crs_name(name: str, where: str) -> None:
    """Refuse the name of a CRS that PROJ does not know: GDAL would take the places for degrees."""
    known_crs(name, where)


_SHAPES = frozenset(
    {"Point", "LineString", "LinearRing", "Polygon", "MultiGeometry", "Model", "Track", "MultiTrack"}
)
# Of these children an element of KML has one at most; of several GDAL keeps the last.
_SINGLE: Mapping[str, frozenset[str]] = {
    "Placemark": _SHAPES,
    "Polygon": frozenset({"outerBoundaryIs"}),
    "outerBoundaryIs": frozenset({"LinearRing"}),
    "innerBoundaryIs": frozenset({"LinearRing"}),
    **dict.fromkeys(("Point", "LineString", "LinearRing"), frozenset({"coordinates"})),
}
_NAME_END = re.compile(rb"[\s/>]")


class _Element(NamedTuple):
    """Element of XML that is open: its local name, its name as written, and its single children so far."""

    name: str
    written: bytes
    children: list[str]


def check_xml(content: bytes, root: str, where: str) -> bytes:
    """Refuse XML that begins with another element, declares entities, or links to other documents.

    Returns the document. Google Earth writes all holes of a polygon into one ``innerBoundaryIs``, of which GDAL keeps the
    last: each gets one of its own. Other elements of KML of which GDAL would keep the last are refused.
    """
    path: list[_Element] = []
    cuts: list[tuple[int, bytes]] = []
    parser = expat.ParserCreate(namespace_separator=" ")

    def begin(name: str, _: Any) -> None:
        local, at = name.rsplit(" ", 1)[-1], parser.CurrentByteIndex
        if (not path and local != root) or local == "NetworkLink":
            raise InputError(
                f"{where} holds <{local[:40]}>; a <{root}> document with the features themselves was expected."
            )
        if path and local in _SINGLE.get(path[-1].name, ()):
            path[-1].children.append(local)
            if len(path[-1].children) > 1:
                cuts.append((at, _divided(path[-1], where)))
        path.append(_Element(local, _NAME_END.split(content[at + 1 : at + 80], maxsplit=1)[0], []))

    def doctype(*_: Any) -> None:
        raise InputError(f"{where} declares a document type or XML entities; remove the declaration.")

    parser.StartElementHandler, parser.StartDoctypeDeclHandler = begin, doctype
    parser.EndElementHandler = lambda _: path.pop()
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(f"{where} is damaged or no XML ({error}); get it again.") from error
    except InputError:
        raise
    except (LookupError, ValueError) as error:
        # Python looks up encodings that expat does not know, and refuses some itself.
        raise InputError(
            f"{where} states an encoding that cannot be read ({error}); save it as UTF-8."
        ) from error
    ends = [0, *(at for at, _ in cuts), len(content)]
    pieces = [content[begin:end] for begin, end in pairwise(ends)]
    return pieces[0] + b"".join(tag + piece for (_, tag), piece in zip(cuts, pieces[1:], strict=True))


def _divided(parent: _Element, where: str) -> bytes:
    """Return the tags between two rings of a boundary of holes; refuse other elements with several children."""
    if parent.name == "innerBoundaryIs" and parent.written.endswith(b"innerBoundaryIs"):
        return b"</" + parent.written + b"><" + parent.written + b">"
    kinds = " and ".join(f"<{name}>" for name in dict.fromkeys(parent.children))
    raise InputError(
        f"{where} holds a <{parent.name}> with {len(parent.children)} of {kinds}, where one was expected; "
        "give each shape a placemark of its own and save it again, as UTF-8."
    )


# zipfile raises RuntimeError for an encrypted member and NotImplementedError for an unknown compression.
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError)


def kml_document(file: Path, what: str) -> bytes:
    """Return the checked document of a KML or KMZ file."""
    content = _unpacked(file, what) if file.suffix.lower() == ".kmz" else small_text(file, what)
    return check_xml(content, "kml", f"{what} {file}")


def _unpacked(file: Path, what: str) -> bytes:
    """Return the document of a KMZ file; refuse several, of which others would be left out."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = [
                member
                for member in archive.infolist()
                if member.filename.lower().endswith(".kml")
                and not Path(member.filename).name.startswith("._")
            ]
            if len(members) != 1:
                found = f"{len(members)} KML documents" if members else "no KML document (doc.kml)"
                raise InputError(
                    f"{what} {file} holds {found}, and one was expected; save the placemarks as one KMZ or KML again."
                )
            if members[0].file_size > LARGEST_TEXT_BYTES:
                raise CapacityError(
                    f"{what} {file} holds a document of {members[0].file_size:,} bytes; {LARGEST_TEXT_BYTES:,} can be "
                    "read as text, save it as GeoPackage."
                )
            return archive.read(members[0])
    except _DAMAGE as error:
        raise InputError(
            f"{what} {file} is damaged or no KMZ archive ({first_line(error)}); get it again."
        ) from error


_KEYS = frozenset(
    [
        "ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy",
        "nodata_value",
    ]
)  # fmt: skip
_LONGEST_HEADER = 16
_LONGEST_LINE = 64 * 2**20


def check_ascii_grid(file: Path) -> None:
    """Refuse an ASCII grid that holds anything but the numbers that its header announces."""
    with file.open("rb") as stream, warnings.catch_warnings():
        # NumPy warns of text behind the numbers, and will refuse it.
        warnings.simplefilter("error", DeprecationWarning)
        header, first = _header(stream, file)
        counts = [len(row) for row in _rows(stream, first, file, len(header) + 1)]
    _check_place(header, file)
    columns, rows = _whole(header, "ncols", file), _whole(header, "nrows", file)
    if sum(counts) != columns * rows:
        raise InputError(
            f"{file} holds {sum(counts):,} numbers where its header names {rows:,} rows of {columns:,}; it was cut off or changed, get it again."
        )
    uneven = next((k for k, n in enumerate(counts) if n != columns), None)
    if len(counts) == rows and uneven is not None:
        raise InputError(
            f"{file}, row {uneven + 1}: {counts[uneven]:,} numbers where the header names {columns:,}; correct the row."
        )


def _check_place(header: dict[str, float], file: Path) -> None:
    """Refuse a header without a place: GDAL puts the grid at 0, 0 where corner and centre are mixed."""
    if not any({f"xll{at}", f"yll{at}"} <= header.keys() for at in ("corner", "center")):
        raise InputError(
            f"{file} has a header with {', '.join(key for key in header if key.startswith(('xll', 'yll'))) or 'no place'}; xllcorner and yllcorner, "
            "or xllcenter and yllcenter, were expected."
        )


def _header(stream: IO[bytes], file: Path) -> tuple[dict[str, float], bytes]:
    """Return the values of the header, and the first line behind it."""
    header: dict[str, float] = {}
    for _ in range(_LONGEST_HEADER):
        line = stream.readline(_LONGEST_LINE)
        words = line.split()
        if not words and line:
            continue
        if not words or not words[0][:1].isalpha() or words[0].lower() in (b"nan", b"inf"):
            return header, line
        key = words[0].decode("ascii", "replace").lower()
        if len(words) != 2 or key not in _KEYS or key in header:
            found = line.decode("ascii", "replace").strip()[:60]
            raise InputError(
                f"{file} has the header line {found!r}; each of ncols, nrows, xllcorner, yllcorner, cellsize and nodata_value was expected once with one number."
            )
        header[key] = float(_numbers(words[1], file, len(header) + 1)[0])
    raise InputError(f"{file} has a header of more than {_LONGEST_HEADER} lines; it is no ASCII grid.")


def _rows(stream: IO[bytes], first: bytes, file: Path, number: int) -> Iterator[FloatArray]:
    """Yield the numbers of each line that holds any."""
    line = first
    while line:
        if len(line) >= _LONGEST_LINE:
            raise InputError(
                f"{file}, line {number}: it is longer than {_LONGEST_LINE:,} bytes; write one line per row."
            )
        if not line.isspace():
            yield _numbers(line, file, number)
        line, number = stream.readline(_LONGEST_LINE), number + 1


def _numbers(text: bytes, file: Path, number: int) -> FloatArray:
    try:
        values: FloatArray = np.fromstring(text, dtype=np.float64, sep=" ")
    except (DeprecationWarning, ValueError):
        values = np.empty(0)
    if len(values) == 0:
        raise InputError(
            f"{file}, line {number}: {_first_wrong(text)!r} is no number; correct it, or get the file again."
        )
    if not np.isfinite(values).all():
        raise InputError(
            f"{file}, line {number}: it holds nan or inf, which GDAL may read as 0; write the number that nodata_value names."
        )
    return values


def _first_wrong(text: bytes) -> str:
    for word in text.split():
        try:
            float(word)
        except ValueError:
            return word.decode("utf-8", "replace")[:40]
    return text[:40].decode("utf-8", "replace")


def _whole(header: dict[str, float], key: str, file: Path) -> int:
    value = header.get(key, math.nan)
    if not (value >= 1 and value.is_integer()):
        raise InputError(f"{file} has the {key} {value:g}; a whole number of at least 1 was expected.")
    return int(value)
