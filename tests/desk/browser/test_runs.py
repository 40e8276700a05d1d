"""Simulated runs and real measurements in a browser."""

import pytest

from tests.desk.browser.test_access import violations
from tests.desk.browser.test_planning import set_field
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
    assert "Map after 2 of 2 swaths" in page.inner_text("label[for=growth]")
    page.focus("#growth")
    page.keyboard.press("Home")
    assert "Map after 1 of 2 swaths" in page.inner_text("label[for=growth]")
    assert page.is_checked("#show-growth-sigma")
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
