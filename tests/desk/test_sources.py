"""What the desk can be opened with."""

import json
from zipfile import ZipFile

import numpy as np
import pytest

from desk.plan.exports import PlanExport
from desk.plan.history_file import read_history
from desk.workspace import open_workspace, write_demo
from firnline.actions.requests import RunOptions
from firnline.actions.runs import run_until
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid

MISSION = """
schema_version = 1
name = "small"
fidelity = "ideal"
terrain = { source = "random", size_m = 150.0, step_m = 3.0, length_scale_m = 60.0 }
planner = { pattern = "lawnmower", swaths = 3 }
rover = { max_pitch_deg = 25.0, camera_height_m = 0.9 }
"""


def test_a_mission_brings_its_area_prior_and_settings(tmp_path):
    (tmp_path / "small.toml").write_text(MISSION)
    with open_workspace(tmp_path / "small.toml", tmp_path) as desk:
        document = desk.store.document
        assert document.planner == {"pattern": "lawnmower", "swaths": 3}
        assert document.rover == {"max_pitch_deg": 25.0}
        assert len(desk.planner.quick(document).plan.route.swaths) == 3


def test_a_run_brings_its_area_prior_and_settings(tmp_path):
    (tmp_path / "small.toml").write_text(MISSION)
    run = run_until(tmp_path / "small.toml", "plan", RunOptions(runs=tmp_path / "runs")).run
    with open_workspace(run.path, tmp_path) as desk:
        assert desk.store.document.planner["swaths"] == 3
        assert desk.folder == tmp_path


def test_a_raster_in_degrees_is_projected_as_the_command_does(tmp_path):
    import rasterio
    from rasterio.transform import from_origin

    heights = np.add.outer(np.arange(40.0), np.arange(60.0)).astype(np.float32) + 500
    profile = {
        "driver": "GTiff",
        "dtype": "float32",
        "count": 1,
        "width": 60,
        "height": 40,
        "crs": "EPSG:4326",
    }
    with rasterio.open(
        tmp_path / "degrees.tif", "w", **profile, transform=from_origin(7.9, 46.6, 0.0003, 0.0003)
    ) as file:
        file.write(heights, 1)
    with open_workspace(tmp_path / "degrees.tif", tmp_path) as desk:
        assert desk.crs.to_epsg() == 32632
        assert desk.tiles.png("relief", 0, 0, 0)


def test_a_polar_raster_is_shown_in_its_own_crs(tmp_path):
    grid = Grid((-200_000.0, -2_200_000.0, -198_000.0, -2_198_000.0), 100.0, "EPSG:3413")
    Dem.on(grid, np.add.outer(np.arange(21.0), np.arange(21.0))).write(tmp_path / "polar.tif")
    with open_workspace(tmp_path / "polar.tif", tmp_path) as desk:
        assert desk.crs.to_epsg() == 3413
        assert abs(desk.map_scale - 1.0) < 0.05


def test_the_demo_is_written_once(tmp_path):
    plan = write_demo(tmp_path / "demo")
    before = plan.stat().st_mtime_ns
    assert write_demo(tmp_path / "demo") == plan
    assert plan.stat().st_mtime_ns == before
    with open_workspace(plan, tmp_path) as desk:
        assert desk.store.document.survey_area(desk.crs).ground_area_m2 == pytest.approx(1e6, rel=0.01)


def test_a_plan_whose_raster_is_gone_is_refused_by_its_name(tmp_path):
    plan = write_demo(tmp_path / "demo")
    plan.with_name("srtm_sample.tif").unlink()
    with pytest.raises(InputError, match=r"srtm_sample\.tif"):
        open_workspace(plan, tmp_path)


def edited_mission(folder, before: str, after: str) -> None:
    text = (folder / "small.toml").read_text()
    assert before in text
    (folder / "small.toml").write_text(text.replace(before, after))


def test_a_mission_that_was_edited_is_shown_as_it_is_now_and_the_drawn_plan_by_undo(tmp_path):
    (tmp_path / "small.toml").write_text(MISSION)
    with open_workspace(tmp_path / "small.toml", tmp_path) as desk:
        drawn = desk.store.document.model_copy(update={"stakes": ((5.0, 5.0),)})
        desk.store.edit(0, "Set a stake", drawn)
        former = Dem.read(desk.terrain).elevation
        assert not desk.notice
    with open_workspace(tmp_path / "small.toml", tmp_path) as desk:
        assert desk.store.document == drawn
        assert not desk.notice
    edited_mission(tmp_path, "swaths = 3", "swaths = 17")
    edited_mission(tmp_path, "length_scale_m = 60.0", "length_scale_m = 40.0")
    with open_workspace(tmp_path / "small.toml", tmp_path) as desk:
        assert "small.toml has changed" in desk.notice
        assert desk.store.document.planner["swaths"] == 17
        assert np.nanmax(np.abs(Dem.read(desk.terrain).elevation - former)) > 0.1
        desk.store.move(0, -1)
        assert desk.store.document == drawn
    with open_workspace(tmp_path / "small.toml", tmp_path) as desk:
        assert not desk.notice
        assert desk.store.document == drawn


def test_a_plan_of_an_earlier_version_does_not_stand_for_the_mission(tmp_path):
    (tmp_path / "small.toml").write_text(MISSION)
    old = {"title": "Open", "document": {"planner": {"pattern": "lawnmower", "swaths": 5}}}
    plan = {"schema_version": 1, "terrain": "small_prior.tif", "at": 0, "steps": [old]}
    (tmp_path / "small.desk.json").write_text(json.dumps(plan, indent=2))
    with open_workspace(tmp_path / "small.toml", tmp_path) as desk:
        assert desk.store.path.name == "small.desk.json"
        assert desk.store.document.planner["swaths"] == 3
        assert desk.store.history.moved(-1).document.planner["swaths"] == 5


def test_missions_of_one_name_have_plans_of_their_own(tmp_path):
    for folder, swaths in (("one", 3), ("two", 5)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "small.toml").write_text(MISSION.replace("swaths = 3", f"swaths = {swaths}"))
        with open_workspace(tmp_path / folder / "small.toml", tmp_path) as desk:
            assert desk.store.document.planner["swaths"] == swaths
            desk.store.write()
    assert {file.name for file in tmp_path.glob("*.desk.json")} == {"small.desk.json", "small-2.desk.json"}
    with open_workspace(tmp_path / "one" / "small.toml", tmp_path) as desk:
        assert desk.store.document.planner["swaths"] == 3


def test_rasters_of_one_name_have_plans_of_their_own(tmp_path):
    grid = Grid((500_000.0, 6_700_000.0, 500_100.0, 6_700_100.0), 10.0, "EPSG:32608")
    Dem.on(grid, np.zeros(grid.shape)).write(tmp_path / "a.tif")
    Dem.on(grid, np.ones(grid.shape)).write(tmp_path / "a.asc")
    for name in ("a.tif", "a.asc"):
        with open_workspace(tmp_path / name, tmp_path) as desk:
            desk.store.write()
    assert read_history(tmp_path / "a.desk.json").terrain == "a.tif"
    assert read_history(tmp_path / "a-2.desk.json").terrain == "a.asc"


def test_a_shared_plan_is_the_same_plan_elsewhere(tmp_path):
    with open_workspace(write_demo(tmp_path / "demo"), tmp_path) as desk:
        document = desk.store.document.model_copy(update={"notes": "for Ada"})
        live = desk.planner.exact(document)
        shared = PlanExport(live, document, desk.name, desk.terrain).file("desk.zip")
    assert shared.name == "srtm_sample.desk.zip"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / shared.name).write_bytes(shared.content)
    with open_workspace(elsewhere / shared.name, elsewhere) as desk:
        assert desk.folder == elsewhere / "srtm_sample"
        assert desk.store.document == document
        again = desk.planner.exact(desk.store.document).plan.route
        assert again.prediction == live.plan.route.prediction
        desk.store.edit(0, "Edit", document.model_copy(update={"notes": "kept"}))
    with open_workspace(elsewhere / shared.name, elsewhere) as desk:
        assert desk.store.document.notes == "kept"


@pytest.mark.parametrize(
    "names", [["a.tif"], ["../a.desk.json", "a.tif"], ["a.desk.json", "b.desk.json"], []]
)
def test_an_archive_that_is_no_shared_plan_is_refused(tmp_path, names):
    with ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in names:
            archive.writestr(name, "x")
    with pytest.raises(InputError, match=r"a\.zip is damaged or no plan of the desk"):
        open_workspace(tmp_path / "a.zip", tmp_path)
    assert not (tmp_path / "a").exists()
