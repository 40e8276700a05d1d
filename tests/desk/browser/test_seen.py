"""What is seen: styles that are applied, boxes that are neither cut nor overlapping, colours, names as text."""

import json
import shutil

import pytest
import rasterio

from benchmarks.desk_seen import LONG_NAMES, SIZES, faults, states
from desk.plan.document import PlanDocument
from desk.workspace import Workspace, open_workspace
from tests.desk.browser.conftest import DeskPage
from tests.desk.browser.test_planning import set_field
from tests.desk.conftest import SQUARE, DeskServer
from tests.desk.terrain.test_background import halves, write_picture
from tests.desk.test_sources import MISSION, edited_mission

pytestmark = [pytest.mark.walkthrough, pytest.mark.timeout(1500)]


@pytest.mark.parametrize("size", SIZES)
def test_nothing_is_cut_and_nothing_overlaps(browser, dem_file, tmp_path, size):
    document = PlanDocument(areas=((SQUARE,),), planner={"pattern": "lawnmower", "swaths": 4})
    name = f"{LONG_NAMES[0][:60]} {LONG_NAMES[1]}"
    with Workspace(dem_file, tmp_path / f"{name}.desk.json", document) as workspace:
        server = DeskServer(workspace)
        context = browser.new_context(viewport=dict(zip(("width", "height"), size, strict=True)))
        opened = DeskPage(context, server).open()
        opened.wait_for_error()
        found = {state: faults(opened.page) for state in states(opened.page, dem_file)}
        context.close()
        server.stop()
    assert {state: texts for state, texts in found.items() if texts} == {}
    assert len(found) == 8


def test_the_report_of_a_run_has_its_styles_and_pictures(opened):
    page = opened.page
    set_field(opened, "planner-swaths", "2")
    opened.tab("runs")
    page.click("#start-mission")
    page.wait_for_selector("#mission-result a", timeout=600_000)
    with page.context.expect_page() as shown:
        page.click("#mission-result a")
    report = shown.value
    report.wait_for_load_state()
    assert "system-ui" in report.evaluate("getComputedStyle(document.body).fontFamily")
    widths = report.evaluate("[...document.images].map((one) => one.naturalWidth)")
    assert len(widths) > 5
    assert min(widths) > 100


def test_the_colours_of_a_dense_plan_differ(opened):
    set_field(opened, "planner-swaths", "20")
    opened.wait_for_error()
    n_colours, beyond = opened.page.evaluate(
        """async () => {
          const found = await (await fetch("/api/error?detail=fine&exact=1")).json();
          const picture = new Image();
          picture.src = found.image;
          await picture.decode();
          const canvas = new OffscreenCanvas(picture.width, picture.height), context = canvas.getContext("2d");
          context.drawImage(picture, 0, 0);
          const counts = new Map(), { data } = context.getImageData(0, 0, picture.width, picture.height);
          for (let k = 0; k < data.length; k += 4)
            if (data[k + 3]) counts.set(data.slice(k, k + 3).join(), (counts.get(data.slice(k, k + 3).join()) ?? 0) + 1);
          const all = [...counts.values()].reduce((a, b) => a + b);
          return [counts.size, (counts.get("63,38,21") ?? 0) / all];
        }"""
    )
    assert n_colours > 20
    assert beyond <= 0.02  # the last colour is that of what is beyond the limit


def test_what_is_dropped_is_shown(opened, tmp_path):
    from desk.plan.document import PlanDocument

    (west, south), *_ = SQUARE
    small = ((west + 10.0, south + 10.0), (west + 40.0, south + 10.0), (west + 40.0, south + 50.0))
    crs = opened.server.workspace.crs
    PlanDocument(areas=((small,),)).survey_area(crs).write(tmp_path / "small.gpkg")
    before = opened.page.evaluate("globalThis.firnlineDesk.resolution()")
    opened.page.set_input_files("#open-file", tmp_path / "small.gpkg")
    opened.wait_until(f"globalThis.firnlineDesk.resolution() < {before / 5}")
    x, y = opened.page.evaluate("globalThis.firnlineDesk.view().centre")
    assert abs(x - west - 25.0) < 30.0
    assert abs(y - south - 30.0) < 30.0


def test_two_plans_are_compared_under_a_swipe(opened):
    page = opened.page
    opened.tab("compare")
    page.fill("#variant-name", "four")
    page.click("#add-variant")
    page.wait_for_selector("#variants >> text=four")
    opened.tab("settings")
    set_field(opened, "planner-swaths", "9")
    opened.tab("compare")
    page.click("[aria-label='Show four beside this plan']")
    page.wait_for_selector("#differences table")
    assert "swaths\t9\t4" in page.inner_text("#differences")
    assert page.is_checked("#swipe-on")
    assert (page.input_value("#swipe-left"), page.input_value("#swipe-right")) == (
        "beside-this",
        "beside-other",
    )
    opened.tab("settings")
    set_field(opened, "planner-swaths", "8")  # the comparison of another plan would be stale
    opened.wait_for(lambda: page.locator("#differences table").count() == 0, "end of the comparison")
    assert not page.is_checked("#swipe-on")
    assert page.locator("#show-beside-this").count() == 0


def test_a_dot_of_the_curve_becomes_the_plan_by_one_click(opened):
    opened.tab("compare")
    opened.page.click("#start-curve")
    opened.page.wait_for_selector("#start-curve:not([disabled])")
    opened.page.locator("#page-compare circle:not(.chosen)").first.click()
    opened.wait_for_revision(1)
    assert opened.document["planner"]["swaths"] != 4


def test_a_note_is_stored(opened):
    opened.tab("compare")
    opened.fill("notes", "crevasse in the north <img src=x onerror=alert(1)>")
    opened.wait_for_revision(1)
    assert opened.document["notes"].startswith("crevasse")
    opened.page.reload()
    opened.page.wait_for_selector("html[data-forms]", state="attached")
    assert opened.page.input_value("#notes").startswith("crevasse")


def test_a_mission_that_was_edited_is_announced_and_the_drawn_plan_offered(browser, tmp_path):
    (tmp_path / "small.toml").write_text(MISSION)
    with open_workspace(tmp_path / "small.toml", tmp_path) as workspace:
        workspace.store.write()
    edited_mission(tmp_path, "swaths = 3", "swaths = 5")
    with open_workspace(tmp_path / "small.toml", tmp_path) as workspace:
        server, context = DeskServer(workspace), browser.new_context()
        opened = DeskPage(context, server).open()
        assert "small.toml has changed" in opened.page.inner_text("#notice")
        assert opened.page.input_value("#planner-swaths") == "5"
        opened.page.click("#show-drawn")
        opened.wait_for(lambda: opened.page.input_value("#planner-swaths") == "3", "drawn plan")
        assert not opened.page.is_visible("#notice")
        context.close()
        server.stop()


def test_the_mission_is_for_the_autopilot_that_is_chosen(opened):
    opened.tab("files")
    opened.page.select_option("#mission-autopilot", "ardupilot")
    opened.fill("mission-speed_m_s", "0.7")
    with opened.page.expect_download() as saved:
        opened.page.click("[data-kind='.plan']")
    mission = json.loads(saved.value.path().read_text())["mission"]
    assert (mission["firmwareType"], mission["cruiseSpeed"]) == (3, 0.7)


HOSTILE = "<img src=x onerror=globalThis.wasRun=1><script>globalThis.wasRun=1</script>"


def test_names_in_files_are_shown_as_text_and_not_run(opened, tmp_path, dem_file):
    import numpy as np
    import shapely

    from survey.io.vector import write_features

    page, (west, south) = opened.page, SQUARE[0]
    boxes = [shapely.box(west + 60 * k, south, west + 60 * k + 50, south + 50) for k in range(2)]
    names = np.array([f"{HOSTILE}{k}" for k in range(2)], dtype=object)
    for suffix in (".geojson", ".kml"):
        write_features(
            tmp_path / f"names{suffix}", boxes, {"name": names}, opened.server.workspace.crs, layer="names"
        )
        page.set_input_files("#open-file", tmp_path / f"names{suffix}")
        page.wait_for_selector("#outline-choice")
        assert "onerror" in page.inner_text("#outline-choice")
        page.click("#outlines button[value='take']")
        page.wait_for_selector("#outlines", state="detached")
    shutil.copy(dem_file, tmp_path / "copy.tif")
    page.set_input_files(
        "#open-file",
        {"name": f"{HOSTILE[:34]}.tif", "mimeType": "image/tiff", "buffer": dem_file.read_bytes()},
    )
    page.click("#raster-kind button[value=elevations]")
    opened.tab("compare")
    page.fill("#variant-name", HOSTILE)
    page.click("#add-variant")
    page.wait_for_selector("#variants tbody tr")
    opened.fill("notes", HOSTILE)
    page.reload()
    page.wait_for_selector("html[data-forms]", state="attached")
    page.wait_for_selector("#variants tbody tr", state="attached")
    assert page.evaluate("globalThis.wasRun") is None
    assert page.locator("img[src=x]").count() == 0


def test_hostile_names_of_pictures_plans_runs_and_events_are_not_run(browser, dem_file, tmp_path):
    name = HOSTILE[:34]  # a slash is no part of a file's name
    document = PlanDocument(areas=((SQUARE,),), planner={"pattern": "lawnmower", "swaths": 4}, notes=HOSTILE)
    row = {"name": "run-0", "title": HOSTILE, "facts": {HOSTILE: HOSTILE}, "folder": "/", "has_report": True}
    lines = [
        {"kind": "watch", "text": HOSTILE, "do": HOSTILE},
        {"kind": "refused", "error": HOSTILE},
    ]
    with Workspace(dem_file, tmp_path / f"{name}.desk.json", document) as workspace:
        workspace.notice = HOSTILE
        server, context = DeskServer(workspace), browser.new_context()
        opened = DeskPage(context, server)
        page = opened.page
        page.route("**/api/runs", lambda route: route.fulfill(json={"runs": [row, row | {"error": HOSTILE}]}))
        events = "".join(f"data: {json.dumps(line)}\n\n" for line in lines)
        page.route("**/events", lambda route: route.fulfill(body=events, content_type="text/event-stream"))
        opened.open()
        picture = write_picture(tmp_path / "ortho.tif", halves())
        with rasterio.open(picture, "r+") as target:
            target.update_tags(TIFFTAG_IMAGEDESCRIPTION=HOSTILE, TIFFTAG_ARTIST=HOSTILE)
        page.set_input_files(
            "#open-file", {"name": f"{name}.tif", "mimeType": "image/tiff", "buffer": picture.read_bytes()}
        )
        page.wait_for_selector("#show-background", state="attached")
        opened.tab("runs")
        page.wait_for_selector(".run >> text=onerror")
        opened.tab("watch")
        page.click("#start-watch")
        page.wait_for_selector("#watch-lines >> text=onerror")
        assert "onerror" in page.inner_text("#notice")
        assert "onerror" in page.inner_text("#name")
        assert page.evaluate("globalThis.wasRun") is None
        assert page.locator("img[src=x]").count() == 0
        context.close()
        server.stop()


def test_scripts_in_a_report_do_not_run(opened, tmp_path):
    (tmp_path / "index.html").write_text(f"<p>{HOSTILE}</p><svg onload='globalThis.wasRun=1'></svg>")
    (tmp_path / "plan.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><script>globalThis.wasRun=1</script></svg>'
    )
    job = opened.server.workspace.jobs.start(lambda _: {})
    job.files["report"] = tmp_path
    for name in ("index.html", "plan.svg"):
        shown = opened.page.context.new_page()
        shown.goto(f"{opened.server.origin}/api/jobs/{job.name}/report/{name}")
        shown.wait_for_timeout(300)
        assert shown.evaluate("globalThis.wasRun") is None
