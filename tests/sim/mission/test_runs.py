import json
import logging
from pathlib import Path

import numpy as np
import pytest

from firnline.actions.runs import logged_to
from sim.config.mission import MissionConfig
from sim.mission.runs import current_versions, input_checksums, open_run, refuse_other_versions
from sim.mission.stages import run_mission
from survey import Dem, Grid, InputError
from survey.core.config import validated

MISSION = {
    "schema_version": 1,
    "name": "small",
    "fidelity": "ideal",
    "terrain": {"source": "random", "size_m": 150.0, "step_m": 3.0},
    "planner": {"pattern": "lawnmower", "swaths": 2},
}


def mission(**changes: object) -> MissionConfig:
    return validated(MissionConfig, MISSION | changes, "the test")


def from_dem(folder: Path) -> MissionConfig:
    grid = Grid((0.0, 0.0, 147.0, 147.0), 3.0, "EPSG:32608")
    Dem.on(grid, np.random.default_rng(1).random(grid.shape)).write(folder / "dem.tif")
    terrain = {"source": "dem", "file": str(folder / "dem.tif")}
    return mission(terrain=terrain, satellite={"cell_m": 15.0})


def test_a_companion_of_an_input_file_gives_the_mission_another_run(tmp_path):
    given = from_dem(tmp_path)
    without = open_run(given, tmp_path / "runs").path
    assert open_run(given, tmp_path / "runs").path == without
    (tmp_path / "dem.tif.aux.xml").write_text("<PAMDataset></PAMDataset>")
    assert open_run(given, tmp_path / "runs").path != without


def test_companions_are_named_relative_to_their_file(tmp_path):
    (tmp_path / "dem.asc").write_text("x")
    (tmp_path / "dem.prj").write_text("y")
    found = input_checksums({"terrain.file": tmp_path / "dem.asc"})
    assert list(found) == ["terrain.file", "terrain.file/dem.prj"]


def other_numpy() -> dict[str, str]:
    return {**current_versions(), "numpy": "1.0"}


def test_stages_of_other_versions_are_not_continued(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("sim.mission.runs.current_versions", other_numpy)
        run = open_run(mission(), tmp_path)
    run_mission(mission(), run, until="plan")
    run_mission(mission(), run, until="plan")  # nothing is left to do
    with pytest.raises(InputError, match=r"numpy 1\.0 \(now .*--fresh.*--from STAGE"):
        run_mission(mission(), run, until="simulate")
    again = open_run(mission(), tmp_path, first="simulate")
    run_mission(mission(), again, until="simulate")
    assert again.has("simulate")


def test_versions_name_every_package_that_differs():
    assert "matplotlib" not in current_versions()
    refuse_other_versions(current_versions(), "the run", "stop")
    with pytest.raises(InputError, match=r"numpy 1\.0 \(now .*\), old 2 \(now not installed\)"):
        refuse_other_versions({**current_versions(), "numpy": "1.0", "old": "2"}, "the run", "stop")


def test_a_place_below_a_file_is_refused_before_the_world_is_built(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        open_run(mission(), tmp_path / "file" / "runs")


def test_the_manifest_lists_inputs_and_versions(tmp_path):
    run = open_run(from_dem(tmp_path), tmp_path / "runs")
    content = json.loads((run.path / "manifest.json").read_text())
    assert list(content["inputs_sha256"]) == ["terrain.file"]
    assert content["versions"] == current_versions()


@pytest.mark.parametrize("level", [logging.NOTSET, logging.ERROR])
def test_levels_of_loggers_are_restored_after_a_run(tmp_path, level):
    logger = logging.getLogger("survey")
    before = logger.level
    logger.setLevel(level)
    try:
        with logged_to(tmp_path / "log.jsonl", None):
            logging.getLogger("survey.core").debug("an event")
        assert logger.level == level
    finally:
        logger.setLevel(before)
    assert "an event" in (tmp_path / "log.jsonl").read_text()
