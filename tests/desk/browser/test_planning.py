"""Planning in a browser: settings, refusals, requirement, fleet, curve, variants, files."""

import zipfile
from pathlib import Path

import pytest

from tests.desk.conftest import SOUTH, SQUARE, WEST

pytestmark = pytest.mark.walkthrough


def facts(opened) -> dict[str, str]:
    found = opened.page.evaluate(
        "Object.fromEntries([...document.querySelectorAll('.fact b')].map(b => [b.id, b.textContent]))"
    )
    return dict(found)


def set_field(opened, field: str, value: str) -> None:
    revision = opened.server.workspace.store.revision
    opened.fill(field, value)
    opened.wait_for_revision(revision + 1)


def test_more_swaths_lower_the_error_and_lengthen_the_route(opened):
    opened.wait_for_error()
    before = facts(opened)
    set_field(opened, "planner-swaths", "9")
    opened.wait_for_error()
    after = facts(opened)
    assert float(after["rmse"].split()[0]) < float(before["rmse"].split()[0])
    assert float(after["fact-length_m"].split()[0]) > float(before["fact-length_m"].split()[0])


def test_the_error_map_has_a_legend_in_metres(opened):
    opened.wait_for_error()
    legend = opened.page.inner_text("#legend")
    assert "Predicted standard deviation" in legend
    assert "m or more" in legend


@pytest.mark.parametrize("pattern", ["wavy", "best", "piecewise-continuous"])
def test_a_pattern_is_chosen(opened, pattern):
    opened.page.select_option("#planner-pattern", pattern)
    opened.wait_for_revision(1)
    assert opened.document["planner"]["pattern"] == pattern
    opened.wait_for(lambda: (opened.state("route") or "").startswith("1"), "route")
    assert opened.page.is_hidden("#refusal")


def test_the_density_is_given_as_a_spacing(opened):
    opened.page.select_option("#planner-size_by", "spacing_m")
    opened.wait_for_revision(1)
    set_field(opened, "planner-spacing_m", "100")
    assert opened.document["planner"] == {"pattern": "lawnmower", "spacing_m": 100}
    opened.wait_for(lambda: "--spacing 100" in opened.page.text_content("#command"), "command")


def test_a_setting_that_is_emptied_returns_to_its_default(opened):
    set_field(opened, "planner-heading_deg", "30")
    set_field(opened, "planner-heading_deg", "")
    assert "heading_deg" not in opened.document["planner"]


def test_what_is_being_typed_stays_when_the_answer_to_an_edit_arrives(opened):
    set_field(opened, "planner-heading_deg", "30")
    opened.page.wait_for_selector('#planner-heading_deg[value="30"]')
    opened.page.focus("#planner-inset_share")
    opened.page.keyboard.type("0.2")
    revision = opened.server.workspace.store.revision
    # Another field changes while the focus stays.
    opened.page.evaluate(
        "const input = document.querySelector('#planner-heading_deg'); input.value = '40'; input.dispatchEvent(new Event('change'))"
    )
    opened.wait_for_revision(revision + 1)
    opened.page.wait_for_selector('#planner-heading_deg[value="40"]')
    opened.page.keyboard.type("5")
    assert opened.page.input_value("#planner-inset_share") == "0.25"
    opened.page.keyboard.press("Tab")
    opened.wait_for_revision(revision + 2)
    assert opened.document["planner"]["inset_share"] == 0.25


def test_a_setting_out_of_range_is_refused_in_a_sentence_and_undone(opened):
    set_field(opened, "planner-swaths", "-3")
    opened.page.wait_for_selector("#refusal:not([hidden])")
    assert "swaths" in opened.page.inner_text("#refusal")
    opened.page.click("#history button:first-child")
    opened.page.wait_for_selector("#refusal", state="hidden")


def test_every_field_shows_its_help(opened):
    opened.page.focus("#rover-max_pitch_deg")
    assert "Largest slope" in opened.page.inner_text("#rover-max_pitch_deg-help")
    described = opened.page.evaluate(
        "[...document.querySelectorAll('.field :is(input, select)')].every(i => document.getElementById(i.getAttribute('aria-describedby') ?? '')?.textContent || i.id === 'shape')"
    )
    assert described


def test_a_slope_limit_leaves_ground_out(opened):
    set_field(opened, "rover-max_pitch_deg", "5")
    opened.wait_for(lambda: "fact-left_out_share" in facts(opened), "share that is left out")
    opened.page.click(".left-out summary")
    assert "too steep" in opened.page.inner_text(".left-out")


def test_a_fleet_without_a_start_is_refused_and_with_one_planned(opened):
    set_field(opened, "fleet-rovers", "2")
    opened.page.wait_for_selector("#refusal:not([hidden])")
    assert "start" in opened.page.inner_text("#refusal")
    opened.page.click("[data-tool=start]")
    opened.click(WEST + 250, SOUTH + 250)
    opened.wait_for_revision(2)
    opened.page.wait_for_selector("#refusal", state="hidden")
    opened.wait_for_error()
    assert (
        opened.server.workspace.planner.quick(opened.server.workspace.store.document).plan.route.n_rovers == 2
    )


def test_a_requirement_finds_a_plan_that_is_used(opened):
    opened.tab("require")
    set_field(opened, "requirement-require", "6")
    set_field(opened, "requirement-max_swaths", "12")
    opened.page.select_option("#requirement-surface", "snow")
    opened.wait_for_revision(3)
    opened.page.click("#start-guarantee")
    opened.page.wait_for_selector("#guarantee-sentence")
    opened.page.click("#use-guarantee")
    opened.wait_for_revision(4)
    assert opened.document["planner"]["swaths"] >= 1
    opened.wait_for_error()


def test_a_requirement_that_cannot_be_met_is_refused_with_what_can_be_reached(opened):
    store = opened.server.workspace.store
    store.edit(
        0, "Require", store.document.model_copy(update={"requirement": {"require": "0.001", "max_swaths": 3}})
    )
    opened.page.reload()
    opened.page.wait_for_selector("html[data-forms]", state="attached")
    opened.tab("require")
    opened.page.click("#start-guarantee")
    opened.page.wait_for_selector("#guarantee-sentence")
    assert "cannot be guaranteed" in opened.page.inner_text("#guarantee-sentence")
    assert opened.page.query_selector("#use-guarantee") is None


def test_the_curve_marks_the_choice_and_another_one_is_used(opened):
    opened.tab("compare")
    opened.page.click("#start-curve")
    opened.page.wait_for_selector("[aria-label='Use 8 swaths']")
    assert opened.page.locator(".chart .chosen").count() == 1
    opened.page.click("[aria-label='Use 8 swaths']")
    opened.wait_for_revision(1)
    assert opened.document["planner"]["swaths"] == 8


def test_variants_stand_side_by_side(opened):
    opened.tab("compare")
    opened.page.fill("#variant-name", "four")
    opened.page.click("#add-variant")
    opened.page.wait_for_selector("#variants >> text=four")
    opened.tab("settings")
    set_field(opened, "planner-swaths", "7")
    opened.tab("compare")
    opened.page.fill("#variant-name", "seven")
    opened.page.click("#add-variant")
    opened.page.wait_for_selector("#variants >> text=seven")
    assert opened.page.locator("#variants tbody tr").count() == 2
    opened.page.click("[aria-label='Show four']")
    opened.wait_for(lambda: opened.document["planner"]["swaths"] == 4, "the variant")
    assert opened.document["planner"]["swaths"] == 4
    opened.page.click("[aria-label='Remove four']")
    opened.page.wait_for_selector("#variants >> text=four", state="detached")


@pytest.mark.parametrize(
    "kind",
    [
        ".plan",
        ".waypoints",
        ".gpx",
        ".kml",
        ".csv",
        ".geojson",
        ".pdf",
        ".qgz",
        "mission.zip",
        "sigma.tif",
        "area.gpkg",
    ],
)
def test_a_file_is_saved_with_the_bytes_of_the_commands(opened, kind, tmp_path):
    from desk.plan.exports import MissionOptions, PlanExport

    opened.tab("files")
    with opened.page.expect_download() as download:
        opened.page.click(f"[data-kind='{kind}']")
    saved = tmp_path / download.value.suggested_filename
    download.value.save_as(saved)
    work = opened.server.workspace
    document = work.store.document
    live = work.planner.exact(document)
    missions = MissionOptions(speed_m_s=live.plan.rover.speed_m_s)  # what the page offers at first
    expected = PlanExport(live, document, work.name, work.terrain, missions).file(kind)
    assert saved.name == expected.name
    assert _content(saved.read_bytes()) == _content(expected.content)


def _content(data: bytes) -> object:
    """Return the files of an archive, or the bytes; inner archives of QGIS hold the time of writing."""
    import io

    if not data.startswith(b"PK"):
        return data
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {
            name: _content(archive.read(name))
            for name in archive.namelist()
            if not name.endswith((".qgz", ".gpkg", ".qgd"))
        }


def test_a_file_of_a_plan_that_is_refused_is_not_saved(opened):
    set_field(opened, "planner-swaths", "-3")
    opened.tab("files")
    opened.page.click("[data-kind='.gpx']")
    opened.page.wait_for_selector("#refusal:not([hidden])")
    assert "swaths" in opened.page.inner_text("#refusal")


def test_the_command_beside_the_plan_is_that_of_its_settings(opened):
    set_field(opened, "rover-max_roll_deg", "20")
    opened.tab("files")
    opened.wait_for(lambda: "rover.max_roll_deg=20" in opened.page.inner_text("#command"), "command")
    assert opened.page.inner_text("#command").startswith(
        "firnline plan hills_area.gpkg --prior hills.tif --pattern lawnmower --swaths 4"
    )


def test_an_outline_that_is_opened_becomes_an_area(opened, tmp_path):
    from desk.plan.document import PlanDocument

    corners = tuple((x - 100.0, y - 100.0) for x, y in SQUARE[:3])
    PlanDocument(areas=((corners,),)).survey_area(opened.server.workspace.crs).write(tmp_path / "site.kml")
    opened.page.set_input_files("#open-file", tmp_path / "site.kml")
    opened.wait_for_revision(1)
    assert len(opened.document["areas"]) == 2


def test_a_raster_that_is_opened_becomes_a_layer(opened, dem_file):
    opened.page.set_input_files("#open-file", dem_file)
    opened.page.click("#raster-kind button[value=elevations]")
    opened.page.wait_for_selector("#layers >> text=hills.tif")
    assert "hills.tif" in opened.page.inner_text("#legend")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("site.kml", b"<kml>"),
        ("notes.txt", b"text"),
        ("map.tif", b"II*\x00broken"),
        ("points.csv", b"a,b\n1,2\n"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(opened, tmp_path: Path, name, content):
    (tmp_path / name).write_bytes(content)
    opened.page.set_input_files("#open-file", tmp_path / name)
    opened.page.wait_for_selector("#refusal:not([hidden])")
    assert name.split(".")[0] in opened.page.inner_text("#refusal")
    assert opened.server.workspace.store.revision == 0


def test_one_glacier_of_an_inventory_is_chosen(opened, tmp_path):
    import numpy as np
    import shapely
    from pyproj import CRS

    from survey.io.vector import write_features

    shapes = [shapely.box(WEST + x, SOUTH + 100.0, WEST + x + 200.0, SOUTH + 300.0) for x in (100.0, 500.0)]
    columns = {"RGIId": ["RGI60-01.00001", "RGI60-01.00002"], "Name": ["Gulkana", "Wolverine"]}
    attributes = {name: np.array(values, dtype=object) for name, values in columns.items()}
    write_features(tmp_path / "rgi.gpkg", shapes, attributes, CRS("EPSG:32608"), layer="rgi")
    revision, n_areas = opened.server.workspace.store.revision, len(opened.document["areas"])
    opened.page.set_input_files("#open-file", tmp_path / "rgi.gpkg")
    opened.page.select_option("#outline-choice", "RGIId=RGI60-01.00002")
    opened.page.click("#outlines button[value=take]")
    opened.wait_for_revision(revision + 1)
    assert len(opened.document["areas"]) == n_areas + 1
    assert min(x for x, _ in opened.document["areas"][-1][0]) == WEST + 500.0
    assert opened.page.query_selector("#outlines") is None
