"""Missions on measured terrain: right CRS in every file, and nothing scored outside the area."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio

from sim.mission.runs import open_run, read_mission
from sim.mission.stages import run_mission
from survey import Reconstruction, SurveyArea

SLOVENIA = """
schema_version = 1
name = "slovenia"
seed = 3
[terrain]
source = "dem"
file = "{data}/dem_slovenia_lidar_1m/TM1_564_146.tif"
[area]
bounds_m = [564100.0, 146200.0, 564700.0, 146800.0]
[planner]
pattern = "lawnmower"
swaths = 4
[reconstruction]
grid_step_m = 6.0
"""
# The kernel is stated: its selection costs more than all else and is no matter of CRS or area.
KERNEL = """
[reconstruction.gp]
fit = false
variance_m2 = 25.0
length_scale_m = 60.0
nugget_m = 0.1
"""
TIROL = """
schema_version = 1
name = "tirol"
seed = 3
[terrain]
source = "dem"
file = "{data}/dem_avaframe_tirol/avaHit.asc"
crs = "EPSG:31287"
[area]
file = "{data}/dem_avaframe_tirol/polygons/relHit.shp"
clip_to_terrain = true
[planner]
pattern = "lawnmower"
spacing_m = 60.0
[reconstruction]
grid_step_m = 10.0
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "epsg", "until"),
    [
        pytest.param(SLOVENIA, 3794, "score", id="slovenia"),
        pytest.param(TIROL, 31287, "score", id="tirol"),
        pytest.param(SLOVENIA, 3794, "report", id="slovenia with report", marks=pytest.mark.exhaustive),
    ],
)
def test_real_terrain_from_plan_to_report(real_data, tmp_path, text, epsg, until):
    (tmp_path / "m.toml").write_text(text.format(data=real_data) + KERNEL)
    mission = read_mission(tmp_path / "m.toml", ["sensors.landmarks_per_m=0.3"])
    run = open_run(mission, tmp_path / "runs")
    run_mission(mission, run, until=until)
    rasters = sorted(run.path.rglob("*.tif"))
    assert len(rasters) >= 4
    for file in rasters:
        with rasterio.open(file) as raster:
            assert raster.crs.to_epsg() == epsg, file
    score = json.loads((run.folder("score") / "score.json").read_text())
    area = SurveyArea.read(run.folder("plan") / "area.gpkg")
    nodes = Reconstruction.read(run.folder("reconstruct")).mean.xy
    inside = area.contains(nodes)
    assert score["elevation"]["n"] == int(inside.sum())
    assert score["n_outside"] == int((~inside).sum())
    assert score["n_unknown"] == 0
    assert score["elevation"]["rmse_m"] < 3.0
    if until == "report":
        assert Path(run.folder("report") / "index.html").stat().st_size > 100_000
    assert np.isfinite(score["calibration"]["coverage_95"])
