"""Real measurements: files, map, score, next swath."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.data.dem import Dem
from tests.desk.conftest import SOUTH, WEST, hills
from tests.desk.jobs.test_jobs import edit, events_of


def measured_table(step_m: float, offset_m: float = 0.0) -> bytes:
    """Points along four lines over the square of the tests, with heights of the hills."""
    x = WEST + 210.0 + np.arange(0.0, 480.0, step_m)
    xy = np.vstack([np.column_stack([x, np.full(len(x), SOUTH + y)]) for y in (260.0, 380.0, 520.0, 640.0)])
    heights = hills().at(xy) + offset_m
    rows = [f"{x:.3f},{y:.3f},{z:.3f},0.05" for (x, y), z in zip(xy, heights, strict=True)]
    return "\n".join(["x_m,y_m,z_m,sigma_z_m", *rows, ""]).encode()


def take(page, role: str, name: str, content: bytes) -> str:
    answer = page.post(f"/api/measured/{role}?name={name}", content)
    assert answer.status_code == 200, answer.text
    stored = answer.json()["file"]
    measured = page.get("/api/plan").json()["document"]["measured"]
    edit(page, measured={**measured, role: stored})
    return stored


def test_points_are_stored_shown_and_found_again(page, workspace):
    assert take(page, "points", "day%201%20(GNSS).csv", measured_table(20.0)) == "day-1-GNSS.csv"
    assert (workspace.measurements / "day-1-GNSS.csv").exists()
    (found,) = page.get("/api/measured").json()["files"]
    assert found["n_points"] == 96


@pytest.mark.parametrize(
    ("role", "name", "content", "status"),
    [
        ("points", "a.csv", b"a,b\n1,2\n", 422),
        ("points", "../../x.sh", b"x", 422),
        ("other", "a.csv", b"x", 422),
        ("driven", "a.geojson", b"{}", 422),
        ("checkpoints", "a.gpkg", b"broken", 422),
    ],
)
def test_a_wrong_file_is_refused_and_not_stored(page, workspace, role, name, content, status):
    answer = page.post(f"/api/measured/{role}?name={name}", content)
    assert answer.status_code == status
    assert "firnline-desk-" not in answer.json()["error"]
    assert not workspace.measurements.exists()


@pytest.mark.parametrize("name", ["../secret.csv", "/etc/passwd", "a/b.csv", ""])
def test_a_document_names_no_file_elsewhere(page, name):
    state = page.get("/api/plan").json()
    document = {**state["document"], "measured": {"points": name}}
    answer = page.post("/api/edit", {"revision": 0, "title": "x", "document": document})
    assert answer.status_code == 422


def test_the_map_is_that_of_the_command_and_is_judged_at_checkpoints(page, workspace, monkeypatch):
    take(page, "points", "points.csv", measured_table(20.0))
    take(page, "checkpoints", "checks.csv", measured_table(97.0, 0.02))
    done = events_of(page, "map")[-1]
    assert done["kind"] == "done", done
    assert any("checkpoints the map has an RMSE" in sentence for sentence in done["sentences"])
    assert done["elevation"]["image"].startswith("data:image/png")
    monkeypatch.chdir(workspace.measurements)
    command = done["commands"][0].replace("-o map", "-o again")
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    assert result.exit_code == 0, result.output
    assert Path("again/dem.tif").read_bytes() == Path("map/dem.tif").read_bytes()
    assert CliRunner().invoke(app, shlex.split(done["commands"][1])[1:]).exit_code == 0
    assert Dem.read("map/dem.tif").at(np.array([[WEST + 450.0, SOUTH + 380.0]])) == pytest.approx(
        hills().at(np.array([[WEST + 450.0, SOUTH + 380.0]])), abs=1.0
    )


def test_the_next_swath_is_proposed(page, workspace):
    take(page, "points", "points.csv", measured_table(10.0))
    edit(page, requirement={"require": "1.0", "probability": 0.8, "max_swaths": 12})
    done = events_of(page, "next")[-1]
    assert done["kind"] == "done", done
    assert "counts as driven" in done["sentence"]
    if done["lines"]:
        assert json.loads((workspace.measurements / done["file"]).read_text())["features"]


def test_nothing_is_proposed_without_points_or_requirement(page):
    assert "no measured points" in events_of(page, "map")[-1]["error"]
    assert "no measured points" in events_of(page, "next")[-1]["error"]
    take(page, "points", "points.csv", measured_table(40.0))
    assert "no class is required" in events_of(page, "next")[-1]["error"]


def test_checkpoints_are_proposed_inside_the_area(page):
    places = np.array(page.post("/api/checkpoints", {"n": 8}).json()["places"])
    assert places.shape == (8, 2)
    assert (places > [WEST + 200.0, SOUTH + 200.0]).all()
    assert (places < [WEST + 700.0, SOUTH + 700.0]).all()
    assert page.post("/api/checkpoints", {"n": 0}).status_code == 422


def test_what_fits_is_proposed_on_a_tongue_and_what_is_lost_said(page):
    tongue = [
        [WEST + 50.0, SOUTH + 60.0],
        [WEST + 850.0, SOUTH + 820.0],
        [WEST + 840.0, SOUTH + 840.0],
        [WEST + 40.0, SOUTH + 80.0],
    ]
    edit(page, areas=[[tongue]])
    found = page.post("/api/checkpoints", {"n": 30, "max_slope_deg": 60.0}).json()
    assert len(found["places"]) == 30
    assert "of the diagonal" in found["note"]
    assert "[" not in found["note"]
    found = page.post("/api/checkpoints", {"n": 200, "max_slope_deg": 60.0}).json()
    assert f"{len(found['places'])} of 200 fit" in found["note"]
    answer = page.post("/api/checkpoints", {"n": 30, "max_slope_deg": 0.001})
    assert "allow steeper ground" in answer.json()["error"]


def test_checkpoints_lie_within_reach_of_the_route(page, workspace):
    from shapely import MultiLineString, Point

    places = page.post("/api/checkpoints", {"n": 8, "max_slope_deg": 40.0, "reach_m": 15.0}).json()["places"]
    legs = workspace.planner.quick(workspace.store.document).plan.route.legs
    lines = MultiLineString([leg.xy for leg in legs])
    assert max(lines.distance(Point(place)) for place in places) <= 15.1
