"""Drawing in a browser: by mouse, by keyboard, undo, reload."""

import json

import pytest

from tests.desk.conftest import SOUTH, SQUARE, WEST

pytestmark = pytest.mark.walkthrough


def place(x: float, y: float) -> tuple[float, float]:
    return WEST + x, SOUTH + y


def test_the_page_opens_without_a_fault_and_asks_nobody_else(opened):
    opened.wait_for_error()
    assert opened.faults == []
    assert all(url.startswith((opened.server.origin, "data:", "blob:")) for url in opened.requests)


def test_an_area_is_drawn_to_the_metre(opened):
    opened.zoom_out()
    opened.draw("area", [place(250, 720), place(350, 720), place(300, 790)])
    opened.wait_for_revision(1)
    drawn = opened.document["areas"][1][0]
    metre = 1.5 * opened.page.evaluate("globalThis.firnlineDesk.resolution()")
    for (x, y), (u, v) in zip([place(250, 720), place(350, 720), place(300, 790)], drawn, strict=True):
        assert abs(x - u) < metre
        assert abs(y - v) < metre


def test_a_no_go_zone_is_drawn_and_the_route_avoids_it(opened):
    opened.draw("no_go", [place(400, 400), place(500, 400), place(500, 500), place(400, 500)])
    opened.wait_for_revision(1)
    assert len(opened.document["no_go"]) == 1
    opened.wait_for_error()
    from shapely import LineString, Polygon

    live = opened.server.workspace.planner.quick(opened.server.workspace.store.document)
    zone = Polygon(opened.document["no_go"][0][0]).buffer(-1e-3)
    assert not any(LineString(leg.xy).crosses(zone) for leg in live.plan.route.legs)


def test_a_hole_is_drawn_into_the_area(opened):
    opened.draw("hole", [place(400, 400), place(500, 400), place(450, 480)])
    opened.wait_for_revision(1)
    assert len(opened.document["areas"][0]) == 2


def test_a_hole_outside_is_not_drawn(opened):
    opened.draw("hole", [place(220, 720), place(260, 720), place(240, 760)])
    opened.page.wait_for_timeout(200)
    assert opened.server.workspace.store.revision == 0


def test_a_start_is_marked_and_the_route_begins_there(opened):
    opened.page.click("[data-tool=start]")
    opened.click(*place(250, 250))
    opened.wait_for_revision(1)
    (start,) = opened.document["starts"]
    route = opened.server.workspace.planner.quick(opened.server.workspace.store.document).plan.route
    assert route.path(0)[0].tolist() == pytest.approx(start)


def test_a_corner_is_moved_by_the_mouse(opened):
    page = opened.page
    page.mouse.move(*opened.pixel(*SQUARE[3]))
    page.mouse.down()
    page.mouse.move(*opened.pixel(WEST + 260, SOUTH + 640), steps=6)
    page.mouse.up()
    opened.wait_for_revision(1)
    assert opened.document["areas"][0][0][3] == pytest.approx([WEST + 260, SOUTH + 640], abs=4.0)


def test_escape_gives_a_drawing_up(opened):
    opened.page.click("[data-tool=area]")
    opened.click(*place(250, 720))
    opened.page.keyboard.press("Escape")
    opened.click(*place(350, 720))
    assert opened.server.workspace.store.revision == 0
    assert opened.page.get_attribute("[data-tool=select]", "aria-pressed") == "true"


def test_a_selected_area_is_removed_by_a_key_and_comes_back_by_undo(opened):
    opened.click(*place(450, 450))
    opened.page.wait_for_timeout(400)
    opened.page.keyboard.press("Delete")
    opened.wait_for_revision(1)
    assert opened.document["areas"] == []
    opened.page.wait_for_selector("#refusal:not([hidden])")
    assert "no area is drawn" in opened.page.inner_text("#refusal")
    opened.page.keyboard.press("Control+z")
    opened.wait_for_revision(2)
    assert len(opened.document["areas"]) == 1


def test_undo_and_redo_by_buttons_name_what_they_do(opened):
    opened.draw("no_go", [place(400, 400), place(500, 400), place(500, 500)])
    opened.wait_for_revision(1)
    opened.page.click("[aria-label='Undo: Draw a no-go zone']")
    opened.wait_for_revision(2)
    assert opened.document["no_go"] == []
    opened.page.click("[aria-label='Redo: Draw a no-go zone']")
    opened.wait_for_revision(3)
    assert len(opened.document["no_go"]) == 1


def test_corners_are_typed(opened):
    opened.tab("shapes")
    opened.fill("corner-Outline-1-0", str(WEST + 640))
    opened.wait_for_revision(1)
    assert opened.document["areas"][0][0][1] == [WEST + 640, SOUTH + 200]


def test_corners_are_inserted_and_removed_by_keyboard(opened):
    opened.tab("shapes")
    opened.page.focus("[aria-label='Insert a corner after 2']")
    opened.page.keyboard.press("Enter")
    opened.wait_for_revision(1)
    assert opened.document["areas"][0][0][2] == [WEST + 700, SOUTH + 450]
    opened.page.wait_for_selector("[aria-label='Remove corner 5']")  # the page has the answer
    opened.page.focus("[aria-label='Remove corner 3']")
    opened.page.keyboard.press("Enter")
    opened.wait_for_revision(2)
    assert len(opened.document["areas"][0][0]) == 4


def test_an_area_is_made_by_keyboard_alone(opened):
    page = opened.page
    opened.tab("shapes")
    page.focus("text=Add a no-go zone")
    page.keyboard.press("Enter")
    opened.wait_for_revision(1)
    opened.wait_until("document.querySelector('#shape').value === 'no_go-0'")
    for corner, (x, y) in enumerate([(400, 400), (460, 400), (460, 460), (400, 460)]):
        for axis, value in enumerate(place(x, y)):
            revision = opened.server.workspace.store.revision
            page.focus(f"#corner-Outline-{corner}-{axis}")
            page.keyboard.press("Control+a")
            page.keyboard.type(str(value))
            page.keyboard.press("Enter")
            opened.wait_for_revision(revision + 1)
    assert opened.document["no_go"][0][0] == [
        list(place(*p)) for p in [(400, 400), (460, 400), (460, 460), (400, 460)]
    ]


def test_a_wrong_number_is_marked_and_not_stored(opened):
    opened.tab("shapes")
    opened.page.fill("#corner-Outline-1-0", "")
    opened.page.press("#corner-Outline-1-0", "Tab")
    assert opened.page.get_attribute("#corner-Outline-1-0", "aria-invalid") == "true"
    assert opened.server.workspace.store.revision == 0


def test_a_closed_tab_loses_nothing(opened):
    opened.draw("no_go", [place(400, 400), place(500, 400), place(500, 500)])
    opened.wait_for_revision(1)
    context = opened.page.context
    opened.page.close()
    page = context.new_page()
    page.goto(opened.server.origin)
    page.wait_for_selector("html[data-ready]", state="attached")
    page.wait_for_selector("[aria-label='Undo: Draw a no-go zone']")


def test_a_crash_of_the_server_loses_nothing(opened, browser):
    from desk.workspace import open_workspace
    from tests.desk.browser.conftest import DeskPage, DeskServer

    opened.draw("no_go", [place(400, 400), place(500, 400), place(500, 500)])
    opened.wait_for_revision(1)
    path, terrain = opened.server.workspace.store.path, opened.server.workspace.terrain
    path.with_name("hills.tif").write_bytes(terrain.read_bytes())
    opened.server.stop()
    with open_workspace(path, path.parent) as again:
        server = DeskServer(again)
        page = DeskPage(browser.new_context(), server).open()
        page.page.wait_for_selector("[aria-label='Undo: Draw a no-go zone']")
        assert len(page.document["no_go"]) == 1
        server.stop()


def test_a_server_that_is_gone_is_named(opened):
    opened.wait_for_error()
    opened.server.stop()
    opened.fill("planner-swaths", "6")
    opened.wait_until("document.querySelector('#refusal').textContent.includes('does not answer')")


def test_an_edit_in_another_tab_is_shown_instead_of_lost(opened):
    opened.wait_for_error()
    opened.server.workspace.store.edit(
        0,
        "Elsewhere",
        opened.server.workspace.store.document.model_copy(update={"starts": (place(300, 300),)}),
    )
    opened.fill("planner-swaths", "6")
    opened.page.wait_for_selector("[aria-label='Undo: Elsewhere']")
    assert opened.document["starts"] == [list(place(300, 300))]


def test_keys_pan_and_zoom_the_map(opened):
    page = opened.page
    page.focus("#map")
    before = page.evaluate("globalThis.firnlineDesk.view()")
    page.keyboard.press("ArrowRight")
    opened.wait_until(
        f"JSON.stringify(globalThis.firnlineDesk.view()) !== {json.dumps(json.dumps(before, separators=(',', ':')))}"
    )
    after = page.evaluate("globalThis.firnlineDesk.view()")
    assert after["centre"][0] > before["centre"][0]
    page.keyboard.press("+")
    opened.wait_until(f"globalThis.firnlineDesk.view().resolution < {before['resolution']}")


def test_a_distance_is_measured_on_the_ground(opened):
    opened.page.click("[data-tool=measure]")
    opened.click(*place(250, 300))
    opened.page.mouse.move(*opened.pixel(*place(550, 300)), steps=3)
    opened.wait_until(
        "/^30[0-9.]* m on the ground|^29[0-9.]* m/.test(document.querySelector('#hint').textContent)"
    )


def test_the_place_and_height_under_the_pointer_are_shown(opened):
    opened.page.mouse.move(*opened.pixel(*place(450, 450)))
    opened.wait_until(
        "/E 5004[45]\\d\\.\\d {2}N 67004[45]\\d\\.\\d {2}[78]\\d\\d\\.\\d m/.test(document.querySelector('#place').textContent)"
    )


def test_a_number_that_is_being_typed_is_not_replaced_by_the_answer_to_an_edit(opened):
    page = opened.page
    opened.tab("shapes")
    held = []
    page.route("**/api/edit", lambda route: held.append(route))  # noqa: PLW0108 - playwright wants a function of Python
    for field, text in (("#corner-Outline-0-0", "500001\n"), ("#corner-Outline-0-1", "67")):
        page.focus(field)
        page.keyboard.press("Control+a")
        page.keyboard.type(text)
    held[0].continue_()
    opened.wait_for_revision(1)
    page.wait_for_timeout(500)
    page.keyboard.type("8")
    assert page.input_value("#corner-Outline-0-1") == "678"
