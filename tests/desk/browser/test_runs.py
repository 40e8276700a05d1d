"""Simulated runs and real measurements in a browser."""

import pytest

from benchmarks.desk_seen import SIZES, faults
from live.watch.log import line_of
from tests.desk.browser.test_access import violations
from tests.desk.browser.test_planning import set_field
from tests.desk.conftest import SQUARE
from tests.desk.jobs.test_jobs import driven_entries
from tests.desk.measured.test_measured import measured_table

pytestmark = [pytest.mark.walkthrough, pytest.mark.timeout(1500)]
LONG_MS = 600_000  # a mission on a loaded machine


def run_mission(opened) -> None:
    """Run the mission of the plan and wait for its score."""
    opened.page.click("#start-mission")
    opened.page.wait_for_selector("#mission-result a", timeout=LONG_MS)


def test_runs_are_watched_listed_and_compared(opened):
    page = opened.page
    set_field(opened, "planner-swaths", "2")
    opened.tab("runs")
    run_mission(opened)
    assert "RMSE" in page.inner_text("#mission-result")
    check_replay(page)
    page.click("#replay-close")
    assert not page.is_visible("#replay")
    assert page.locator("#show-replay-sigma").count() == 0
    page.locator(".run button", has_text="Drive").first.click()
    opened.wait_for(
        lambda: "after 2 of 2" in page.inner_text("label[for=replay]"), "replay of an earlier run"
    )
    check_replay(page)
    with page.context.expect_page() as report:
        page.click("#mission-result a")
    report.value.wait_for_load_state()
    assert "hills" in report.value.content()
    set_field(opened, "simulation-seed", "5")
    run_mission(opened)
    page.wait_for_selector(".run >> nth=1", timeout=LONG_MS)
    for box in page.locator(".run input").all():
        box.check()
    page.click("#show-difference")
    opened.wait_for(lambda: "differ by" in page.inner_text("#difference"), "difference")
    assert page.locator("#comparison th[scope=row]").count() > 5
    page.locator(".run button", has_text="Error").first.click()
    page.wait_for_selector("#legend >> text=Error of the map")
    assert violations(page) == []


def check_replay(page) -> None:
    """Move through the drive of two swaths by the keyboard: rover, ellipse, paths and map of each time."""
    assert "map after 2 of 2 swaths" in page.inner_text("label[for=replay]")
    assert page.evaluate(DRAWN) == ["ellipse", "path", "rover", "true"]
    end = page.evaluate(ROVER)
    page.focus("#replay")
    page.keyboard.press("Home")
    assert "no map yet" in page.inner_text("label[for=replay]")
    assert page.evaluate(DRAWN) == ["ellipse", "rover"]
    assert page.evaluate(ROVER) != end
    for _ in range(7):
        page.keyboard.press("PageUp")
    assert "map after 1 of 2 swaths" in page.inner_text("label[for=replay]")
    assert "(95 %)" in page.inner_text("label[for=replay]")
    assert page.is_checked("#show-replay-sigma")
    page.keyboard.press("End")


FEATURES = """globalThis.firnlineDesk.map.getLayers().getArray().filter((one) => one.getZIndex() === 29)
  .flatMap((one) => one.getSource().getFeatures())"""
DRAWN = f"{FEATURES}.map((one) => one.get('kind')).sort()"
ROVER = f"{FEATURES}.find((one) => one.get('kind') === 'rover').getGeometry().getCoordinates()"


def test_a_drive_is_watched_while_it_goes_on_and_replayed(opened):
    page, workspace = opened.page, opened.server.workspace
    lines = [line_of(entry) for entry in driven_entries(workspace)]
    label = "label[for=watched]"
    with (workspace.folder / "hills.watch.jsonl").open("w") as log:
        log.writelines(lines[:20])
        log.flush()
        opened.tab("watch")
        page.click("#start-watch")
        page.wait_for_selector(label)
        (west, south), *_ = SQUARE
        opened.wait_until(f"{ROVER}[0] > {west + 60.0}")
        assert page.evaluate(ROVER)[1] == pytest.approx(south + 125.0, abs=0.1)
        assert "no map yet" in page.inner_text(label)
        log.writelines(lines[20:60])
        log.flush()
        opened.wait_until(f"{ROVER}[0] > {west + 200.0}")  # the latest place is followed
        page.focus("#watched")
        page.keyboard.press("Home")
        log.writelines(lines[60:])
    page.wait_for_selector("#watch-lines >> text=STOP")
    assert page.evaluate(ROVER)[0] == pytest.approx(west, abs=0.1)  # what is looked at stays
    page.focus("#watched")
    page.keyboard.press("End")
    opened.wait_for(lambda: "map after 2 of 2 swaths" in page.inner_text(label), "map")
    assert page.is_checked("#show-watched-sigma")
    assert opened.faults == []
    assert violations(page) == []
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(250)
        assert faults(page) == []
    page.focus("#watched")
    page.keyboard.press("Home")
    page.click("#watched-play")
    opened.wait_until(f"{ROVER}[0] > {west + 5.0}")
    page.click("#watched-play")


def test_measured_points_become_a_map_with_its_score(opened, tmp_path):
    page = opened.page
    (tmp_path / "points.csv").write_bytes(measured_table(20.0))
    (tmp_path / "checks.csv").write_bytes(measured_table(97.0, 0.02))
    opened.tab("measured")
    page.set_input_files("#measured-points", tmp_path / "points.csv")
    opened.wait_for(lambda: "96 points" in page.inner_text("#taken-points"), "points")
    page.set_input_files("#measured-checkpoints", tmp_path / "checks.csv")
    opened.wait_for(lambda: "points" in page.inner_text("#taken-checkpoints"), "checkpoints")
    page.click("#start-map")
    page.wait_for_selector("#measured-result .command", timeout=LONG_MS)
    assert "checkpoints the map has an RMSE" in page.inner_text("#measured-result")
    assert page.is_checked("#show-measured-elevation")
    assert violations(page) == []
    page.reload()
    page.wait_for_selector("html[data-forms]", state="attached")
    opened.tab("measured")
    opened.wait_for(lambda: "96 points" in page.inner_text("#taken-points"), "points after a reload")


def test_the_next_swath_is_proposed_in_the_page(opened, tmp_path):
    (tmp_path / "points.csv").write_bytes(measured_table(10.0))
    store = opened.server.workspace.store
    requirement = {"require": "1.0", "probability": 0.8, "max_swaths": 12}
    store.edit(0, "Require", store.document.model_copy(update={"requirement": requirement}))
    opened.page.reload()
    opened.page.wait_for_selector("html[data-forms]", state="attached")
    opened.tab("measured")
    opened.page.set_input_files("#measured-points", tmp_path / "points.csv")
    opened.wait_for_revision(2)
    opened.page.click("#start-next")
    opened.page.wait_for_selector("#next-sentence", timeout=LONG_MS)


def test_a_wrong_file_of_measurements_is_refused(opened, tmp_path):
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    opened.tab("measured")
    opened.page.set_input_files("#measured-points", tmp_path / "bad.csv")
    opened.page.wait_for_selector("#refusal:not([hidden])")
    assert "bad.csv" in opened.page.inner_text("#refusal")
    assert opened.server.workspace.store.revision == 0


def test_checkpoints_are_proposed_and_undone(opened):
    opened.tab("shapes")
    opened.page.click("#page-shapes summary")
    opened.page.click("#propose-checkpoints")
    opened.wait_for_revision(1)
    assert len(opened.document["checkpoints"]) == 30
    opened.page.click("#history button:first-child")
    opened.wait_for_revision(2)
    assert opened.document["checkpoints"] == []
