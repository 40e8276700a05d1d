"""Checks of JSON and XML files before a library reads them: size, claimed CRS, entities."""

import json
import re
from pathlib import Path
from typing import Any
from xml.parsers import expat

from survey.core.crs.checks import known_crs
from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line

LARGEST_TEXT_BYTES = 256 * 2**20
"""JSON and XML files beyond this are not read: while they are parsed they take some ten times their size."""
ROOTS = {".kml": "kml", ".kmz": "kml", ".gpx": "gpx"}
_PLAIN_CRS = re.compile(
    rb'"crs"\s*:\s*\{\s*"type"\s*:\s*"name"\s*,\s*"properties"\s*:\s*\{\s*"name"\s*:\s*"([^"\\]*)"\s*\}\s*\}'
)
_CRS_MEMBERS = frozenset({"type", "properties", "name", "href", "url", "link"})


def small_text(file: Path, what: str) -> bytes:
    """Read a JSON or XML file, or refuse one that is too large to be parsed."""
    n_bytes = file.stat().st_size
    if n_bytes > LARGEST_TEXT_BYTES:
        raise CapacityError(
            f"{what} {file} has {n_bytes:,} bytes; {LARGEST_TEXT_BYTES:,} can be read as text, save it as GeoPackage."
        )
    return file.read_bytes()


def check_json(file: Path, what: str) -> None:
    """Refuse GeoJSON with a CRS that is a link, which GDAL would follow, or an unknown name, which it would ignore."""
    content = small_text(file, what)
    if b"gdal_streamed_alg" in content:
        raise InputError(
            f"{what} {file} holds a GDAL pipeline; run it first and name the file that it writes."
        )
    if b'"crs"' not in content and b"\\u" not in content:  # other spellings of the key need an escape
        return
    where = f"{what} {file}"
    plain = _PLAIN_CRS.findall(content)
    if len(plain) == content.count(b'"crs"') and b"\\u" not in content:
        for name in set(plain):
            _check_crs_name(name.decode("utf-8", "replace"), where)
        return
    try:
        inner, outer = _crs_members(content)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where} is damaged or no JSON ({first_line(error)}); get it again.") from error
    # A property of a feature may be called crs as well: there only what GDAL could follow is looked at.
    for crs in [*(crs for crs in inner if isinstance(crs, dict)), *outer]:
        if crs is not None:
            _check_named_crs(crs, where)


def _crs_members(content: bytes) -> tuple[list[Any], list[Any]]:
    """Return all values of keys ``crs`` in a JSON text: those of inner objects, and of the outermost one."""
    found: list[list[Any]] = []

    def collect(members: list[tuple[str, Any]]) -> Any:
        found.append([value for key, value in members if key == "crs"])
        # Members of a CRS are needed, all others are skipped.
        return dict(members) if {key for key, _ in members} <= _CRS_MEMBERS else None

    json.loads(content, object_pairs_hook=collect)
    return [crs for values in found[:-1] for crs in values], found[-1] if found else []


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


def check_xml(content: bytes, root: str, where: str) -> None:
    """Refuse XML that begins with another element, declares entities, or links to other documents."""
    names: list[str] = []
    parser = expat.ParserCreate(namespace_separator=" ")

    def element(name: str, _: Any) -> None:
        local = name.rsplit(" ", 1)[-1]
        if (not names and local != root) or local == "NetworkLink":
            raise InputError(
                f"{where} holds <{local[:40]}>; a <{root}> document with the features themselves was expected."
            )
        names.append(local) if not names else None

    def doctype(*_: Any) -> None:
        raise InputError(f"{where} declares a document type or XML entities; remove the declaration.")

    parser.StartElementHandler, parser.StartDoctypeDeclHandler = element, doctype
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
