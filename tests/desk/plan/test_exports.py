"""Files that the desk hands out are those that the commands write."""

import io
import shlex
import zipfile
from collections import Counter
from pathlib import Path

import pytest
from typer.testing import CliRunner

from desk.plan.document import PlanDocument
from desk.plan.exports import KINDS, PlanExport
from desk.plan.live import LivePlanner
from desk.plan.request import command_of
from firnline.cli.main import app
from survey.core.errors import InputError
from survey.data.dem import Dem
from tests.desk.conftest import SOUTH, SQUARE, WEST

STARTS = ((WEST + 210.0, SOUTH + 210.0), (WEST + 690.0, SOUTH + 210.0))
OTHERS = (".gpx", ".kml", ".csv", ".wkt", ".plan", ".waypoints")


def run(command: str) -> None:
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    assert result.exit_code == 0, result.output


@pytest.fixture
def place(dem_file, tmp_path, monkeypatch) -> Path:
    """Folder with the terrain, as the current one."""
    monkeypatch.chdir(tmp_path)
    Path("hills.tif").write_bytes(dem_file.read_bytes())
    return tmp_path


def export_of(document: PlanDocument) -> PlanExport:
    terrain = Path("hills.tif")
    live = LivePlanner(terrain, Dem.read(terrain).crs).exact(document)
    live.plan.area.write("site.gpkg")
    return PlanExport(live, document, "site", terrain)


def test_routes_for_other_tools_have_the_bytes_of_the_commands(place):
    document = PlanDocument(areas=((SQUARE,),), planner={"pattern": "lawnmower", "swaths": 3})
    export = export_of(document)
    run(command_of(document, "site.gpkg", "hills.tif", "route.geojson"))
    Path("made").mkdir()
    for suffix in OTHERS:
        run(f"firnline export route.geojson made/site{suffix} --area site.gpkg --dem hills.tif")
        assert export.file(suffix).content == Path(f"made/site{suffix}").read_bytes(), suffix


def test_sheets_and_error_have_the_bytes_of_the_command(place):
    document = PlanDocument(areas=((SQUARE,),), planner={"pattern": "lawnmower", "swaths": 3})
    packed = export_of(document).file(".pdf")
    Path("made").mkdir()
    Path("site.gpkg").rename("site_area.gpkg")
    run(command_of(document, "site_area.gpkg", "hills.tif", "made/site.pdf"))
    with zipfile.ZipFile(io.BytesIO(packed.content)) as archive:
        assert set(archive.namelist()) == {"site.pdf", "site.geojson", "site_sigma.tif"}
        for name in ("site.pdf", "site.geojson", "site_sigma.tif"):
            assert archive.read(name) == Path("made", name).read_bytes(), name


def test_a_fleet_gets_a_mission_for_each_rover(place):
    document = PlanDocument(areas=((SQUARE,),), starts=STARTS, fleet={"rovers": 2})
    packed = export_of(document).file(".plan")
    with zipfile.ZipFile(io.BytesIO(packed.content)) as archive:
        assert archive.namelist() == ["site_rover1.plan", "site_rover2.plan"]


def test_the_mission_runs_to_the_same_route(place):
    document = PlanDocument(
        areas=((SQUARE,),), planner={"pattern": "lawnmower", "swaths": 3}, rover={"speed_m_s": 0.5}
    )
    packed = export_of(document).file("mission.zip")
    with zipfile.ZipFile(io.BytesIO(packed.content)) as archive:
        archive.extractall("mission")
    run("firnline plan mission/site.toml --runs runs -q")
    from survey.data.route import Route

    made = Route.read("runs/site/latest/1-plan/route.geojson")
    expected = export_of(document).live.plan.route
    assert [leg.xy.tolist() for leg in made.legs] == [leg.xy.tolist() for leg in expected.legs]


def test_stakes_and_checkpoints_are_written_with_names_and_heights(place):
    document = PlanDocument(areas=((SQUARE,),), stakes=STARTS[:1], checkpoints=STARTS)
    export = export_of(document)
    rows = export.file("points.csv").content.decode().splitlines()
    assert [row.split(",")[0] for row in rows] == ["name", "S01", "C01", "C02"]
    assert float(rows[1].split(",")[-1]) > 700.0
    assert b"<wpt" in export.file("points.gpx").content
    with pytest.raises(InputError, match="no stake"):
        export_of(PlanDocument(areas=((SQUARE,),))).file("points.csv")


def test_the_simulation_of_the_mission_is_that_of_the_document(place):
    document = PlanDocument(areas=((SQUARE,),), simulation={"seed": 7, "fidelity": "ideal"})
    packed = export_of(document).file("mission.zip")
    with zipfile.ZipFile(io.BytesIO(packed.content)) as archive:
        text = archive.read("site.toml").decode()
    assert "seed = 7" in text
    assert 'fidelity = "ideal"' in text


def test_every_kind_is_written(place):
    planner = {"pattern": "lawnmower", "swaths": 2}
    export = export_of(PlanDocument(areas=((SQUARE,),), checkpoints=STARTS, planner=planner))
    for kind in KINDS:
        file = export.file(kind)
        assert len(file.content) > 100, kind
        assert file.name.startswith("site"), kind


def test_a_mission_takes_autopilot_and_speed(page):
    made = page.get("/api/export/.plan?autopilot=ardupilot&speed_m_s=0.7&returns=false").json()["mission"]
    assert made["firmwareType"] == 3
    assert made["cruiseSpeed"] == 0.7
    for query in ("autopilot=none", "speed_m_s=0", "speed_m_s=nan", "speed_m_s=fast", "other=1"):
        answer = page.get(f"/api/export/.plan?{query}")
        assert answer.status_code == 422, query
        assert answer.json()["error"].endswith(".")


def test_no_two_kinds_have_one_name(place):
    export = export_of(
        PlanDocument(areas=((SQUARE,),), checkpoints=STARTS, planner={"pattern": "lawnmower", "swaths": 2})
    )
    names = Counter(export.file(kind).name for kind in KINDS)
    assert names.most_common(1)[0][1] == 1
    assert {"site.gpkg", "site_area.gpkg", "site.kml", "site_area.kml"} <= set(names)


@pytest.mark.parametrize("kind", ["exe", "..%2F..%2Fetc%2Fpasswd", ".toml"])
def test_an_unknown_kind_is_refused_before_anything_is_computed(page, workspace, monkeypatch, kind):
    monkeypatch.setattr(type(workspace.planner), "exact", lambda *_: pytest.fail("a plan was computed"))
    answer = page.get(f"/api/export/{kind}")
    assert answer.status_code in (404, 422)
    if answer.status_code == 422:
        assert "is not known" in answer.json()["error"]
