"""GeoJSON, KML and GPX are checked before a library reads them."""

from pathlib import Path

import pytest

from survey.core.errors import CapacityError, InputError
from survey.io import file_kinds as document_checks
from survey.io.file_kinds import check_json, check_xml

NAMED = '{"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": "%s"}}, "features": []}'


def written(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    "text",
    [
        '{"type": "FeatureCollection", "features": []}',
        NAMED % "EPSG:32608",
        NAMED % "urn:ogc:def:crs:OGC:1.3:CRS84",
        # A property of a feature may be called crs.
        '{"features": [{"properties": {"crs": "unknown"}}]}',
    ],
)
def test_plain_geojson_passes(tmp_path: Path, text: str) -> None:
    check_json(written(tmp_path, "a.geojson", text), "the area")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (NAMED % "EPSG:99999999", "EPSG:99999999"),
        ('{"crs": {"type": "link", "properties": {"href": "http://a.b/c"}}}', "links are not followed"),
        ('{"crs": {"type": "name"}}', "linked or malformed"),
        ('{"\\u0063rs": {"type": "link", "properties": {}}}', "links are not followed"),
        ('{"crs": ', "is damaged or no JSON"),
        ('{"type": "gdal_streamed_alg"}', "holds a GDAL pipeline"),
    ],
)
def test_what_gdal_would_follow_or_pass_over_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_json(written(tmp_path, "a.geojson", text), "the area")


def test_plain_xml_passes(tmp_path: Path) -> None:
    check_xml(b"<kml><Document/></kml>", "kml", "the area a.kml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<html><body/></html>", "holds <html>; a <kml> document"),
        ("<kml><NetworkLink/></kml>", "holds <NetworkLink>"),
        ('<!DOCTYPE kml [<!ENTITY a "b">]><kml>&a;</kml>', "declares a document type or XML entities"),
        ("<kml><Document></kml>", "is damaged or no XML"),
    ],
)
def test_other_documents_links_and_entities_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_xml(text.encode(), "kml", "the area a.kml")


def test_a_text_that_is_too_large_to_parse_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(document_checks, "LARGEST_TEXT_BYTES", 10)
    with pytest.raises(CapacityError, match="save it as GeoPackage"):
        check_json(written(tmp_path, "a.geojson", NAMED % "EPSG:32608"), "the area")


@pytest.mark.parametrize("encoding", ["utb-8", "utf-7", "hex", "idna"])
def test_xml_in_an_encoding_that_cannot_be_read_is_refused(encoding: str) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?><kml><Document/></kml>'
    with pytest.raises(InputError, match="states an encoding that cannot be read"):
        check_xml(text.encode(), "kml", "the area a.kml")
