"""A surveyor's first day: checkpoints of a receiver, an accuracy statement, two elevation models."""

from pathlib import Path

import pytest

from tests.first_day.conftest import Firnline

pytestmark = pytest.mark.walkthrough


def test_a_receivers_export_gives_a_report_in_the_words_of_the_standard(
    firnline: Firnline, here: Path
) -> None:
    judged = firnline(
        "score", "map.tif", "--checkpoints", "gnss.csv", "--class", "0.10", "--datum", "EGM96 height",
        "--by", "slope", "--report", "accuracy", "--language", "de",
    )  # fmt: skip
    assert "columns read as x_m = Easting, y_m = Northing, z_m = Elevation" in judged.stderr
    assert "  RMSE               0.047 m" in judged.stdout
    assert "0 to 5°" in judged.stdout
    page = (here / "accuracy" / "index.html").read_text()
    assert "tested to meet" in page
    assert 'lang="de"' in page
    assert (here / "accuracy" / "report.pdf").read_bytes().startswith(b"%PDF")
    assert {f.name for f in (here / "accuracy" / "tables").iterdir()} >= {"residuals.csv"}
    assert len(list((here / "accuracy" / "figures").iterdir())) >= 3


def test_two_elevation_models_give_a_change_with_its_interval_and_a_report(
    firnline: Firnline, here: Path
) -> None:
    said = firnline(
        "change", "2026.tif", "2024.tif", "--outline", "glacier.gpkg", "--align", "--report", "change.pdf"
    ).stdout
    assert "North glacier: " in said
    assert "95 % between" in said
    assert (here / "change.pdf").read_bytes().startswith(b"%PDF")
    assert (here / "change" / "change.csv").is_file()


def test_statistics_come_by_class_of_land_cover(firnline: Firnline) -> None:
    said = firnline("score", "map.tif", "--truth", "lidar.tif", "--by", "cover.gpkg").stdout
    assert "cover" in said
    assert "rock" in said
