"""The desk, the command and the library make the same plan."""

import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import planners
from desk.plan.document import PlanDocument
from desk.plan.live import LivePlanner
from desk.plan.request import command_of
from firnline.cli.main import app
from survey.data.dem import Dem
from tests.desk.conftest import SOUTH, SQUARE, WEST

HOLE = ((WEST + 400.0, SOUTH + 400.0), (WEST + 450.0, SOUTH + 400.0), (WEST + 450.0, SOUTH + 460.0))
DOCUMENTS = {
    "plain": {"planner": {"pattern": "lawnmower", "swaths": 5}},
    "hole and heading": {
        "areas": ((SQUARE, HOLE),),
        "planner": {"pattern": "lawnmower", "spacing_m": 90, "heading_deg": 20.5, "inset_share": 0.4},
    },
    "fleet": {
        "starts": ((WEST + 210.0, SOUTH + 210.0),),
        "fleet": {"rovers": 2},
        "rover": {"turn_radius_m": 2.0, "battery_j": 2e6},
    },
    "limits": {"rover": {"max_pitch_deg": 8, "max_roll_deg": 8.5}, "no_go": (((HOLE),),)},
    "wavy": {"planner": {"pattern": "wavy", "swaths": 4, "tie_lines": 1}},
}


@pytest.mark.long
@pytest.mark.parametrize("name", DOCUMENTS)
def test_the_same_bytes_by_desk_command_and_library(name, dem_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("hills.tif").write_bytes(dem_file.read_bytes())
    document = PlanDocument(**{"areas": ((SQUARE,),), **DOCUMENTS[name]})
    prior = Dem.read("hills.tif")
    live = LivePlanner(Path("hills.tif"), prior.crs).exact(document).plan
    live.route.write("desk.geojson")
    document.survey_area(prior.crs).write("site.gpkg")
    command = command_of(document, "site.gpkg", "hills.tif", "command.geojson")
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    assert result.exit_code == 0, result.output
    assert Path("desk.geojson").read_bytes() == Path("command.geojson").read_bytes()
    made = planners.plan(
        live.area,
        live.prior,
        _config(document),
        rover=live.rover,
        fleet=_fleet(document),
        model=planners.prior_model(live.prior, live.area),
    )
    made.write("library.geojson")
    assert Path("library.geojson").read_bytes() == Path("command.geojson").read_bytes()


def _config(document):
    kind = {"lawnmower": planners.LawnmowerConfig, "wavy": planners.WavyConfig}[document.planner["pattern"]]
    return kind.model_validate_json(
        PlanDocument(planner=document.planner).model_dump_json(include={"planner"})[len('{"planner":') : -1]
    )


def _fleet(document):
    return planners.Fleet(**document.fleet)
