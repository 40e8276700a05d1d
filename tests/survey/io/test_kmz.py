"""KMZ archives: the document in them is read as KML is, and anything else is refused in a sentence."""

import zipfile
from pathlib import Path

import pytest

from survey import SurveyArea
from survey.core.errors import CapacityError, InputError
from survey.io import file_kinds as kmz
from survey.io.vector import layer_names

PLACEMARK = """<Placemark><name>{name}</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
{west},60.44,0 {east},60.44,0 {east},60.45,0 {west},60.45,0 {west},60.44,0
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"""
KML = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'
SQUARE = PLACEMARK.format(name="site", west=-135.0, east=-134.98)
CAMP = "<Placemark><name>camp</name><Point><coordinates>-134.99,60.445,0</coordinates></Point></Placemark>"


def archive(path: Path, **members: str) -> Path:
    """Write a KMZ file with members named by keywords; an underscore stands for the point."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
        for name, text in members.items():
            target.writestr(name.replace("_", "."), text)
    return path


def test_an_area_in_a_kmz_is_that_of_its_kml(tmp_path: Path) -> None:
    (tmp_path / "a.kml").write_text(KML.format(SQUARE))
    plain = SurveyArea.read(tmp_path / "a.kml")
    for name in ("doc_kml", "Site_KML"):
        packed = SurveyArea.read(archive(tmp_path / "a.kmz", icon_png="x", **{name: KML.format(SQUARE)}))
        assert packed.polygon.equals(plain.polygon)
        assert packed.crs == plain.crs


def test_the_folder_with_polygons_is_the_area(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folders = f"<Folder><name>Sites</name>{SQUARE}</Folder><Folder><name>Camps</name>{CAMP}</Folder>"
    file = archive(tmp_path / "a.kmz", doc_kml=KML.format(folders))
    assert layer_names(file) == ["Sites", "Camps"]
    assert len(SurveyArea.read(file).starts) == 0
    assert "has 2 layers; the one with polygons, Sites, is read" in caplog.text


def test_two_folders_with_polygons_are_refused(tmp_path: Path) -> None:
    east = PLACEMARK.format(name="east", west=-134.9, east=-134.8)
    folders = f"<Folder><name>A</name>{SQUARE}</Folder><Folder><name>B</name>{east}</Folder>"
    with pytest.raises(InputError, match=r"has 2 layers \(A, B\); save the one that is meant"):
        SurveyArea.read(archive(tmp_path / "a.kmz", doc_kml=KML.format(folders)))


def test_archives_without_a_readable_document_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = archive(tmp_path / "good.kmz", doc_kml=KML.format(SQUARE))
    (tmp_path / "cut.kmz").write_bytes(good.read_bytes()[:200])
    (tmp_path / "plain.kmz").write_text(KML.format(SQUARE))
    link = KML.format("<NetworkLink><Link><href>http://a/b.kml</href></Link></NetworkLink>")
    for file, words in (
        (archive(tmp_path / "none.kmz", readme_txt="x"), "holds no KML document"),
        (tmp_path / "cut.kmz", "damaged or no KMZ archive"),
        (tmp_path / "plain.kmz", "damaged"),
        (archive(tmp_path / "link.kmz", doc_kml=link), "holds <NetworkLink>"),
    ):
        with pytest.raises(InputError, match=words):
            SurveyArea.read(file)
    monkeypatch.setattr(kmz, "LARGEST_TEXT_BYTES", 100)
    with pytest.raises(CapacityError, match="can be read as text"):
        SurveyArea.read(good)
