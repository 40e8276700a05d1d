"""``firnline plan --require``: guarantees, refusals, and a survey planned swath by swath."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid, Route, SurfacePoints, SurveyArea
from survey.core.streams import stream
from survey.terrain import random_dem, satellite_copy

CRS = "EPSG:32608"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A smooth site of 300 m with a prior of 50 m cells."""
    folder = tmp_path_factory.mktemp("site")
    terrain = random_dem(
        "squared-exponential", Grid((0.0, 0.0, 300.0, 300.0), 5.0, CRS), stream(3), 12.0, length_scale_m=80.0
    )
    satellite_copy(terrain, rng=stream(4), cell_m=50.0, sigma_m=0.5).write(folder / "prior.tif")
    SurveyArea.rectangle((0.0, 0.0, 300.0, 300.0), CRS).write(folder / "site.gpkg")
    return folder, terrain


def firnline(folder, *options: str, code: int = 0):
    common = ["plan", str(folder / "site.gpkg"), "--prior", str(folder / "prior.tif"), "--prior-sigma", "0.5"]
    result = CliRunner().invoke(app, [*common, *options, "--json"])
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def guaranteed(site):
    """A route that guarantees a class, and the facts that the command prints."""
    folder, _ = site
    out = folder / "guaranteed.geojson"
    return out, json.loads(firnline(folder, "--require", "class-3", "-o", str(out)).stdout)


def test_a_class_is_guaranteed_with_its_assumptions(guaranteed):
    out, facts = guaranteed
    assert min(facts["probability"], facts["simulated_share"]) >= 0.9
    assert "fitted to the prior" in facts["assumed"]
    assert facts["likely_rmse_m"] <= facts["rmse_m"]
    least = facts["options"][0]
    assert set(least["by_level"]) == {"prior", "checkpoint", "stake", "benchmark"}
    assert facts["prior_level_m"] > 0.5
    assert least["by_level"]["prior"]["probability"] < least["by_level"]["stake"]["probability"]
    assert Route.read(out).ground_length_m == pytest.approx(facts["length_m"])
    assert out.with_suffix(".png").stat().st_size > 10_000


def test_what_cannot_be_guaranteed_is_refused_in_one_sentence_and_nothing_is_written(site):
    folder, _ = site
    out = folder / "refused.geojson"
    result = firnline(folder, "--require", "0.02", "--noise", "1.0", "-q", "-o", str(out), code=5)
    sentence, assumed, *options, level = result.stderr.strip().splitlines()
    assert "cannot be guaranteed" in sentence
    assert "they reach" in sentence
    assert "assumed" in assumed
    assert len(options) >= 2
    assert all("with the level of the prior alone" in one for one in options)
    assert "with one stake or RTK" in level
    assert not out.exists()
    assert "no map class" in firnline(folder, "--require", "class-9", code=4).stderr


def test_a_survey_is_planned_swath_by_swath_until_the_guarantee_holds(site):
    folder, terrain = site
    part, files = folder / "next.geojson", (folder / "driven.geojson", folder / "samples.csv")
    options = ["--require", "0.3", "--adaptive", "--force", "-o", str(part)]
    firnline(folder, *options)
    driven = Route.read(part)
    for _ in range(8):
        xy = driven.sample(10.0).xy
        heights = terrain.at(xy) + 0.1 * stream(7, len(xy)).standard_normal(len(xy))
        driven.write(files[0])
        SurfacePoints(np.column_stack([xy, heights]), sigma_m=np.full(len(xy), 0.1), crs=CRS).write(files[1])
        facts = json.loads(
            firnline(folder, *options, "--driven", str(files[0]), "--measured", str(files[1])).stdout
        )
        if "done" in facts:
            break
        driven = Route((*driven.legs, *Route.read(part).legs), CRS, "adaptive")
    assert facts["probability"] >= 0.9
    assert 2 <= len(driven.swaths) <= 9
    assert isinstance(terrain, Dem)


def test_options_that_the_guarantee_decides_are_refused(site):
    folder, _ = site
    said = firnline(folder, "--require", "class-3", "--swaths", "4", code=4).stderr
    assert "leave out --swaths" in said
    assert (
        "leave out --assume"
        in firnline(folder, "--require", "1", "--adaptive", "--assume", "whittle", code=4).stderr
    )
    assert "leave out --set" in firnline(folder, "--require", "1", "--set", "aids.stakes=2", code=4).stderr


@pytest.mark.long
def test_shared_errors_are_predicted_with_swaths_and_stakes(site):
    folder, _ = site
    out = folder / "joint.geojson"
    options = ["--require", "2.0", "--joint", "--set", "aids.base_station=true", "-o", str(out)]
    facts = json.loads(firnline(folder, *options).stdout)
    assert [way["stakes"] for way in facts["ways"]] == [0, 2, 4]
    assert all(way["chance"] >= 0.9 for way in facts["ways"])
    assert len(Route.read(out).swaths) == min(way["swaths"] for way in facts["ways"])
    assert "leave out --adaptive" in firnline(folder, *options, "--adaptive", code=4).stderr


@pytest.mark.long
def test_shared_errors_are_predicted_on_a_concave_area_of_any_size(site, tmp_path):
    folder, _ = site
    bay = shapely.Polygon(
        [(5, 5), (292, 5), (292, 263), (190, 263), (190, 95), (110, 95), (110, 263), (5, 263)]
    )
    SurveyArea(bay, CRS).write(tmp_path / "bay.gpkg")
    options = ["--require", "2.0", "--joint", "--prior", str(folder / "prior.tif"), "--prior-sigma", "0.5"]
    out = tmp_path / "route.geojson"
    result = CliRunner().invoke(app, ["plan", str(tmp_path / "bay.gpkg"), *options, "-o", str(out), "--json"])
    assert result.exit_code == 0, result.output
    way = json.loads(result.stdout)["ways"][0]
    assert way["pieces"] == len(Route.read(out).swaths) > way["swaths"]


def test_fewer_swaths_are_named_only_where_the_likeliest_covariance_needs_fewer(site, guaranteed):
    folder, _ = site
    out, facts = folder / "words.geojson", guaranteed[1]
    common = ["plan", str(folder / "site.gpkg"), "--prior", str(folder / "prior.tif"), "--prior-sigma", "0.5"]
    result = CliRunner().invoke(app, [*common, "--require", "class-3", "-o", str(out), "--force"])
    fewer = facts["likely_swaths"] < facts["lines"]
    assert (f"and {facts['likely_swaths']} swaths are enough" in result.stdout) == fewer
    assert ("swaths are enough" in result.stdout) == fewer


def test_a_probability_that_is_no_guarantee_is_refused(site):
    folder, _ = site
    for probability in ("1e-300", "0.5", "1"):
        result = firnline(folder, "--require", "class-3", "--probability", probability, code=4)
        assert "above 0.5 and at most 0.999" in result.stderr
    mission = CliRunner().invoke(
        app,
        [
            "plan",
            str(Path(__file__).parents[3] / "examples/small_survey.toml"),
            "--require",
            "class-3",
            "--probability",
            "0",
        ],
    )
    assert mission.exit_code == 4


@pytest.fixture(scope="module")
def lidar(site):
    """A mission with a small LiDAR."""
    file = site[0] / "lidar.toml"
    file.write_text(
        """schema_version = 1
name = "lidar"
terrain = { source = "srtm-sample" }
planner = { pattern = "lawnmower", swaths = 4 }

[sensors.lidar]
beams = 12
columns = 60
rate_hz = 0.25
range_m = 25.0
"""
    )
    return ["--lidar", str(file)]


@pytest.mark.long
def test_swaths_are_as_far_apart_as_the_map_of_a_lidar_allows(site, lidar):
    folder, _ = site
    out = folder / "lidar.geojson"
    facts = json.loads(firnline(folder, "--require", "0.3", *lidar, "--no-pictures", "-o", str(out)).stdout)
    assert facts["lidar_rmse_m"] <= 0.3
    assert facts["spacing_m"] <= facts["lidar_spacing_m"]
    assert facts["lidar_paper_width_m"] > 0.0
    assert Route.read(out).prediction["lidar_rmse_m"] == pytest.approx(facts["lidar_rmse_m"])


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        pytest.param(
            ["--require", "0.0001"],
            5,
            "no distance between swaths is predicted to map the area",
            marks=pytest.mark.long,
        ),
        (["--require", "0.3", "--adaptive"], 4, "leave out --adaptive"),
        (["--require", "0.3", "--set", "sensors.lidar.beams=0"], 4, "has no LiDAR"),
        ([], 4, "--lidar goes with --require"),
    ],
)
def test_a_lidar_plan_that_cannot_be_made_is_refused_in_one_sentence(site, lidar, options, code, words):
    folder, _ = site
    out = folder / "refused_lidar.geojson"
    assert words in " ".join(firnline(folder, *options, *lidar, "-o", str(out), code=code).output.split())
    assert not out.exists()
