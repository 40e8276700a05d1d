"""``firnline plan --season``: swaths, stakes and days for a wanted error of the mass balance."""

import csv
import json

import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from tests.planners.guarantee.smooth_site import AREA, coarse, smooth_terrain


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("season")
    coarse(smooth_terrain()).write(folder / "prior.tif")
    AREA.write(folder / "site.gpkg")
    return folder


def season(folder, *options: str, code: int = 0):
    common = ["plan", str(folder / "site.gpkg"), "--prior", str(folder / "prior.tif"), "--max-swaths", "5"]
    result = CliRunner().invoke(app, [*common, *options])
    assert result.exit_code == code, result.output
    return result


DATES = ("--dates", "2026-05-01,2026-09-18", "--surface", "bare-ice")


def test_a_season_is_designed_as_a_table_and_a_picture(folder):
    out = folder / "plan.geojson"
    facts = json.loads(season(folder, "--season", "0.5", *DATES, "-o", str(out), "--json").stdout)
    with (folder / "plan_season.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    chosen = [
        row for row in rows if (int(row["stakes"]), int(row["swaths"])) == (facts["stakes"], facts["swaths"])
    ]
    assert float(chosen[0]["error"]) == facts["error"] <= 0.5
    assert {row["stakes"] for row in rows} == {"0", "2", "5", "10", "20"}
    assert (folder / "plan_season.png").stat().st_size > 10_000
    assert out.exists()


def test_a_change_of_volume_is_asked_for_in_percent(folder):
    out = folder / "percent.geojson"
    result = season(folder, "--season", "10%", *DATES, "-o", str(out))
    assert "10 wanted" in result.stdout
    assert "  first survey       2026-05-01" in result.stdout
    assert "whittle (weight 0.5)" in result.stdout
    assert "correlated to a half at 150 m" in result.stdout


def test_what_cannot_be_reached_is_refused_with_the_largest_error(folder):
    out = folder / "refused.geojson"
    result = season(folder, "--season", "0.05", *DATES, "-o", str(out), code=5)
    assert "the largest part of that is" in result.stderr
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--season", "0.2"), "--season and --dates belong together"),
        (("--season", "much", *DATES), "is no error"),
        (("--season", "0.2", "--dates", "May"), "are not two days"),
        (("--season", "0.2", "--dates", "2026-05-01,2026-09-18"), "the surface of a season is unknown"),
        (("--season", "0.2", *DATES, "--require", "class-3"), "leave out --require"),
        (("--season", "0.2", *DATES, "--set", "planner.swaths=3"), "leave out --set"),
    ],
)
def test_options_that_contradict_a_season_are_refused(folder, options, words):
    assert words in season(folder, *options, code=4).stderr
