"""Outlines of glaciers by name."""

from pathlib import Path

import pytest
import shapely
from pyproj import CRS

from survey.core.errors import InputError
from survey.io.vector import write_features
from survey.scoring.differencing.change_files import read_outlines

UTM = CRS.from_epsg(32608)
ICE, ROCK = shapely.box(500_000.0, 6_700_000.0, 500_050.0, 6_700_050.0), shapely.Point(500_000.0, 6_700_000.0)


def written(folder: Path, shapes: list[shapely.Geometry], **columns: list[str]) -> Path:
    file = folder / "outlines.gpkg"
    write_features(file, shapes, columns, UTM, layer="outlines")
    return file


@pytest.mark.parametrize("column", ["name", "glac_name", "rgi_id"])
def test_names_come_from_the_column_of_the_file(tmp_path: Path, column: str) -> None:
    outlines = read_outlines(written(tmp_path, [ICE], **{column: ["North glacier"]}), UTM)
    assert outlines.keys() == {"North glacier"}
    assert outlines["North glacier"].area == pytest.approx(2500.0)


def test_missing_and_repeated_names_are_numbered(tmp_path: Path) -> None:
    file = written(tmp_path, [ICE, ICE, ICE], name=["ice", "ice", ""])
    assert list(read_outlines(file, UTM)) == ["ice", "ice 2", "outline 3"]


def test_an_empty_name_gives_way_to_the_number_of_the_inventory(tmp_path: Path) -> None:
    file = written(
        tmp_path, [ICE, ICE], Name=["", "Hintereisferner"], RGIId=["RGI60-11.00001", "RGI60-11.00897"]
    )
    assert list(read_outlines(file, UTM)) == ["RGI60-11.00001", "Hintereisferner"]


def test_outlines_are_moved_to_the_crs_of_the_surveys(tmp_path: Path) -> None:
    (outline,) = read_outlines(written(tmp_path, [ICE], name=["ice"]), CRS.from_epsg(32607)).values()
    assert outline.area == pytest.approx(2500.0, rel=0.01)
    assert outline.bounds[0] > 800_000.0


def test_a_point_is_no_outline(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the outline 'hut' is a Point; a polygon was expected"):
        read_outlines(written(tmp_path, [ROCK], name=["hut"]), UTM)


def test_an_outline_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    bow = shapely.Polygon([(500_000.0, 6_700_000.0), (500_100.0, 6_700_100.0), (500_100.0, 6_700_000.0), (500_000.0, 6_700_100.0)])  # fmt: skip
    with pytest.raises(InputError, match="not a simple polygon"):
        read_outlines(written(tmp_path, [bow], name=["ice"]), UTM)


def test_an_outline_that_touches_itself_is_read(tmp_path: Path) -> None:
    lobes = shapely.Polygon([(0, 0), (50, 50), (0, 100), (100, 100), (50, 50), (100, 0)])
    moved = shapely.transform(lobes, lambda xy: xy + [500_000.0, 6_700_000.0])
    outline = read_outlines(written(tmp_path, [moved], name=["ice"]), UTM)["ice"]
    assert outline.is_valid
    assert outline.area == pytest.approx(5000.0)
