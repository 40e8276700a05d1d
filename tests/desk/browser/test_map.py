"""Map in a browser: layers, swipe, contours, colours of the view, the drive in time, stakes and checkpoints."""

import pytest

from tests.desk.conftest import SOUTH, WEST

pytestmark = pytest.mark.walkthrough


def place(x: float, y: float) -> tuple[float, float]:
    return WEST + x, SOUTH + y


def open_drive(opened) -> None:
    opened.page.click("[aria-label^='The drive in time']")
    opened.page.wait_for_selector("#drive .curve")


def test_layers_are_shown_and_hidden(opened):
    opened.page.check("#show-slope")
    assert "45° or more" in opened.page.inner_text("#legend")
    opened.page.uncheck("#show-relief")
    assert "Elevation" not in opened.page.inner_text("#legend")


def test_a_swipe_uncovers_one_layer_beside_the_other(opened):
    opened.wait_for_error()
    opened.page.uncheck("#show-route")
    box = opened.page.locator("#map").bounding_box()
    area = {"x": box["x"] + 300, "y": box["y"] + 250, "width": 60, "height": 60}
    covered = opened.page.screenshot(clip=area)
    opened.page.check("#swipe-on")
    opened.page.select_option("#swipe-right", "slope")
    assert opened.page.is_checked("#show-slope")
    opened.page.focus("#swipe")
    opened.page.keyboard.press("Home")
    opened.page.wait_for_timeout(300)
    assert opened.page.screenshot(clip=area) != covered
    opened.page.uncheck("#swipe-on")
    opened.page.uncheck("#show-slope")
    opened.page.wait_for_timeout(300)
    assert opened.page.screenshot(clip=area) == covered


def test_the_colours_follow_the_view(opened):
    opened.wait_until("document.documentElement.dataset.terrain !== undefined")
    before = opened.page.inner_text("#legend")
    opened.page.evaluate("globalThis.firnlineDesk.map.getView().setResolution(0.1)")
    opened.wait_for(lambda: opened.page.inner_text("#legend") != before, "other colours")


def test_contours_carry_their_height(opened):
    opened.page.check("#show-contours")
    count = "globalThis.firnlineDesk.map.getLayers().getArray().find(l => l.getZIndex() === 4).getSource().getFeatures().length"
    opened.wait_until(f"{count} > 5")


def test_the_time_drives_the_rover_by_keyboard(opened):
    open_drive(opened)
    before = opened.page.inner_text("#drive-text")
    assert before.startswith("0 h 00 min")
    opened.page.focus("#time")
    opened.page.keyboard.press("End")
    after = opened.page.inner_text("#drive-text")
    assert float(after.split("·")[1].split()[0]) > 2.0
    assert "kWh used" in after


def test_the_time_stays_where_it_is_when_the_plan_changes(opened):
    open_drive(opened)
    opened.page.focus("#time")
    opened.page.keyboard.press("End")
    before = opened.page.inner_text("#drive-text")
    opened.fill("planner-swaths", "6")
    opened.wait_for(lambda: opened.page.inner_text("#drive-text") != before, "drive of the changed plan")
    assert float(opened.page.inner_text("#drive-text").split("·")[1].split()[0]) > 2.0


def test_the_profile_of_a_swath_is_dragged(opened):
    open_drive(opened)
    opened.page.select_option("#drive-part", label="Swath 2")
    chart = opened.page.locator("#drive .chart")
    opened.wait_for(lambda: chart.bounding_box() is not None, "chart")
    box = chart.bounding_box()
    opened.page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 60)
    opened.page.mouse.down()
    opened.page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 60, steps=4)
    opened.page.mouse.up()
    km = float(opened.page.inner_text("#drive-text").split("·")[1].split()[0])
    assert 0.5 < km < 1.3


def test_every_tool_can_be_reached_beside_the_drive(opened):
    open_drive(opened)
    opened.page.click("[data-tool=measure]")
    opened.page.click("[aria-label^='The drive in time']")
    assert opened.page.is_hidden("#drive")
    open_drive(opened)
    opened.page.click("[aria-label='Close the drive']")
    assert opened.page.is_hidden("#drive")


def test_playing_moves_the_rover_and_pauses(opened):
    open_drive(opened)
    opened.page.click("#play")
    opened.wait_for(lambda: not opened.page.inner_text("#drive-text").startswith("0 h 00"), "the drive")
    opened.page.click("#play")
    assert "Play" in opened.page.inner_text("#play")


def test_the_battery_is_shown_in_the_drive(opened):
    store = opened.server.workspace.store
    changes = {"starts": (place(210, 210),), "rover": {"battery_j": 1.1e6}}
    store.edit(0, "Battery", store.document.model_copy(update=changes))
    opened.page.reload()
    opened.page.wait_for_selector("html[data-forms]", state="attached")
    open_drive(opened)
    assert "battery 100 %" in opened.page.inner_text("#drive-text")


def test_stakes_and_checkpoints_are_marked_moved_and_undone(opened):
    page = opened.page
    page.keyboard.press("k")
    opened.click(*place(300, 300))
    opened.wait_for_revision(1)
    opened.click(*place(500, 300))
    opened.wait_for_revision(2)
    page.keyboard.press("c")
    opened.click(*place(400, 500))
    opened.wait_for_revision(3)
    page.keyboard.press("Escape")
    document = opened.document
    assert len(document["stakes"]) == 2
    assert document["checkpoints"][0] == pytest.approx(place(400, 500), abs=2.0)
    opened.tab("shapes")
    page.select_option("#shape", "checkpoints-0")
    opened.fill("corner-Checkpoint-0-0", str(WEST + 420))
    opened.wait_for_revision(4)
    assert opened.document["checkpoints"][0][0] == WEST + 420
    page.click("#history button:first-child")
    opened.wait_for_revision(5)
    assert opened.document["checkpoints"][0] == document["checkpoints"][0]
